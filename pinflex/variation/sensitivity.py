"""Relative sensitivities: per cent of an output for one per cent of a parameter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description.description import Description
from pinflex.description.reading.parameters import Parameter, parameters
from pinflex.errors import ConvergenceError, DescriptionError, SceneError
from pinflex.levels.modes import default_step
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.report import Report, Reported, Words, table
from pinflex.solver.solve import default_motion
from pinflex.text import frozen, number
from pinflex.threads import one_blas_thread
from pinflex.variation.evaluator import DEFAULT, check_names, measure, of_a_run, units
from pinflex.variation.peaks import Peaks, Slope, extrapolated, of_frequencies
from pinflex.variation.variants import Variants, variants

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BY = ("flexible.*.section.*", "flexible.*.material.E", "joints.*.drive.stiffness")
_NONE = 1e-6  # a relative sensitivity that nobody would act on


@frozen
class Sensitivities(Reported):
    """Relative sensitivities d ln(output) / d ln(parameter) about one design.

    Attributes:
        parameters: Key paths, with their values in `at`, shape (parameters,).
        outputs: Names, with their values, shape (outputs,).
        table: The sensitivities, shape (parameters, outputs).
        error: Their estimated errors, same shape: of the differences between designs, of the steps
            of runs, of the instants of peaks.
        units: Of the outputs, by name.
        remarks: Sentences on peaks that take turns, and on what the errors leave out.
    """

    parameters: tuple[str, ...]
    at: Array
    outputs: tuple[str, ...]
    values: Array
    table: Array
    error: Array
    units: Mapping[str, str]
    remarks: tuple[str, ...] = ()

    def __getitem__(self, pair: tuple[str, str]) -> float:
        """The sensitivity of (output, parameter)."""
        output, parameter = pair
        return float(self.table[self.parameters.index(parameter), self.outputs.index(output)])

    def as_report(self) -> Report:
        """The table and a sentence on what matters."""
        rows = [*zip(self.parameters, self.at.tolist(), self.table.tolist(), strict=True)]
        outputs = [
            (name, lambda row, k=k: row[2][k], "{:+.3f}".format)
            for k, name in enumerate(self.outputs)
        ]
        note = f"Errors of these numbers: at most {np.nanmax(self.error):.1g}."
        if any(map(of_a_run, self.outputs)):
            note += " Peaks are found between the samples of a run, which may be a little lower."
        return Report("sensitivities", (
            table(
                "Change of an output [%] for one per cent more of a parameter", rows,
                ("parameter", itemgetter(0)), ("value", itemgetter(1)), *outputs,
                names=(min(max(map(len, self.parameters)), 44),),
            ),
            Words("\n".join([self.sentence(), note, *self.remarks])),
        ))  # fmt: skip

    def sentence(self) -> str:
        """The parameter that matters most for each output."""
        said = []
        for k, output in enumerate(self.outputs):
            column = np.nan_to_num(self.table[:, k])
            best = int(np.argmax(np.abs(column)))
            if abs(column[best]) < _NONE:
                said.append(f"Nothing here changes {output}.")
                continue
            value = f"{number(float(self.values[k]))} {self.units[output]}".rstrip()
            said.append(
                f"{output} ({value}) answers most to {self.parameters[best]}: 1 % more gives "
                f"{column[best]:+.2f} %."
            )
        return "\n".join(said)

    def plot(
        self, path: str | Path | None = None, *, panel: str | None = None, ax: Axes | None = None
    ) -> Any:
        """Draw a tornado chart, one panel per output; returns the matplotlib axes.

        Args:
            path: Where to write it too, .png, .pdf or .svg.
            panel: One output alone.
            ax: Where to draw that; default: axes of a new figure.
        """
        from pinflex.viewer.plots.variation import tornado

        return tornado(self.parameters, self.outputs, self.table).axes(panel, ax, path)

    def as_json(self) -> dict[str, Any]:
        """Plain lists and names, SI units."""
        return {
            "parameters": dict(zip(self.parameters, self.at.tolist(), strict=True)),
            "outputs": dict(zip(self.outputs, self.values.tolist(), strict=True)),
            "units": dict(self.units),
            "sensitivities": self.table.tolist(),
            "errors": self.error.tolist(),
            "remarks": list(self.remarks),
        }


@public
@barred
@one_blas_thread()
def sensitivities(
    model: str | Path | Description | Mechanism,
    by: Iterable[str] = (),
    of: Iterable[str] = (),
    level: str | None = None,
    progress: Progress = None,
) -> Sensitivities:
    """Relative sensitivities of outputs to numbers of the YAML.

        table = pf.sensitivities("delta", by=["flexible.*.section.*"], of=["frequency.1", "mass"])
        table["frequency.1", "flexible.arm_?.section.diameter"]

    Frequencies are differentiated implicitly, a repeated one on its subspace; other outputs by
    extrapolated differences of designs. Runs of all designs take the same steps, and their peaks
    are found between the samples (`pinflex.variation.peaks`). Which directions deform and what
    links carry beside their beams stay as they are at the first design.

    Args:
        model: A model, or what `load` takes.
        by: Key paths, whose segments may be globs; links of one block of the YAML count as one.
            Default: sections, moduli and drive stiffnesses.
        of: Outputs, see `pinflex.variation.evaluator`; default: what there is of frequency.1, mass,
            sag, deviation.peak, torque.peak and stress.peak.
        level: Of the runs that outputs need; default: that of the YAML.
        progress: True: a bar; or a function called with (parameters done, parameters).

    Raises:
        DescriptionError: No such number or output.
    """
    tell = callback(progress)
    robot = model if isinstance(model, Mechanism) else load(model)
    patterns = tuple(by or _default(robot))
    designs = variants(robot, patterns)
    wanted = check_names(of, robot) if of else DEFAULT
    peaks = _peaks(designs.base, wanted, level)
    sampled = designs if peaks else variants(robot, patterns, _equal_steps(robot))
    values = _values(sampled.base, wanted, level, peaks, bool(of))
    outputs = tuple(values)
    shape = (len(designs.parameters), len(outputs))
    found, error, remarks = np.zeros(shape), np.zeros(shape), _remarks(peaks, outputs)
    for row, parameter in enumerate(designs.parameters):
        slopes = _slopes(sampled, parameter, outputs, level, peaks)
        found[row] = [slopes[name].value for name in outputs]
        error[row] = [slopes[name].error for name in outputs]
        remarks += [f"{parameter.key}: {x.remark}" for x in slopes.values() if x.remark]
        if tell is not None:
            tell(row + 1, shape[0])
    return Sensitivities(
        tuple(p.key for p in designs.parameters), designs.first,
        outputs, np.array([values[name] for name in outputs]), found, error,
        units(outputs, robot.description), tuple(remarks),
    )  # fmt: skip


def _peaks(base: Mechanism, wanted: Sequence[str], level: str | None) -> Peaks | None:
    """The peaks of a scene; None where there is no run, or where it does not keep its steps."""
    names, scene = [name for name in wanted if of_a_run(name)], base.description
    if not names or (scene.motion is None and scene.solve.until is None):
        return None
    try:
        return Peaks(base, names, level)
    except SceneError:
        return None


def _values(
    base: Mechanism, wanted: Sequence[str], level: str | None, peaks: Peaks | None, strict: bool
) -> dict[str, float]:
    """The outputs of the first design; strict: all of them."""
    known = {} if peaks is None else peaks.values
    rest = [name for name in wanted if peaks is None or not of_a_run(name)]
    found = known | (measure(base, rest, level, strict=False) if rest else {})
    missing = [name for name in wanted if name not in found]
    if strict and missing:
        return measure(base, missing, level)  # says what the scene does not have
    return {name: found[name] for name in wanted if strict or found.get(name)}


def _remarks(peaks: Peaks | None, outputs: Sequence[str]) -> list[str]:
    """Remarks on errors of runs that the estimates do not contain."""
    runs = [name for name in outputs if of_a_run(name)]
    if not runs:
        return []
    if peaks is not None:
        return list(peaks.remarks)
    return [
        f"{', '.join(runs)}: this scene does not keep to given steps, so these are the largest "
        "samples of runs in equal steps, which jump from sample to sample. The errors leave that "
        "out (0.1 was seen on 3rrr): ask again with a quarter of solve.dt and solve.samples=null."
    ]


def _equal_steps(robot: Mechanism) -> list[str]:
    """Overrides for steps that do not follow the parameters: their choice is no smooth function."""
    spec = robot.description.solve
    if (spec.dt is not None and spec.tol is None) or not robot.compliant:
        return []
    if spec.until is None and robot.description.motion is None:
        return []
    until = float(spec.until or default_motion(robot).duration)
    return ["solve.tol=null", f"solve.dt={default_step(robot, until)!r}"]


def _default(robot: Mechanism) -> list[str]:
    """Those of `BY` that the scene has."""
    found = []
    for pattern in BY:
        try:
            parameters(robot.description, [pattern])
        except DescriptionError:
            continue
        found.append(pattern)
    if not found:
        raise DescriptionError(
            f"{robot.name}: sensitivities: no flexible link and no elastic drive. Say by what "
            "(--by KEY, such as forces.push.force.0)."
        )
    return found


def _slopes(
    designs: Variants,
    parameter: Parameter,
    outputs: Sequence[str],
    level: str | None,
    peaks: Peaks | None,
) -> dict[str, Slope]:
    """Sensitivities by output."""
    at = partial(designs.scaled, parameter)
    found = _implicit(designs, parameter, outputs)
    if peaks is not None:
        found |= peaks.slopes(at)
    rest = [name for name in outputs if name not in found]
    if rest:
        # a run is expensive, and 1e-3 of its outputs suffices: two steps do
        steps = 2 if any(map(of_a_run, rest)) else 3
        values, doubts = extrapolated(lambda h: measure(at(h), rest, level), steps=steps)
        found |= {name: Slope(values[name], doubts[name]) for name in rest}
    return found


def _implicit(designs: Variants, parameter: Parameter, outputs: Sequence[str]) -> dict[str, Slope]:
    """Sensitivities of frequencies; none where there is no equilibrium to hold."""
    numbers = {name: int(name.partition(".")[2]) for name in outputs if name.startswith("freq")}
    if not numbers:
        return {}
    try:
        at = partial(designs.scaled, parameter)
        _, slope, error = of_frequencies(designs.base, at, max(numbers.values()))
    except ConvergenceError:  # those of the undeformed pose
        return {}
    return {name: Slope(float(slope[k - 1]), float(error[k - 1])) for name, k in numbers.items()}
