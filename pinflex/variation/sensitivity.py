"""Relative sensitivities: per cent of an output for one per cent of a parameter."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.cards import Worded
from pinflex.description.description import Description
from pinflex.description.parameters import Parameter, parameters
from pinflex.errors import ConvergenceError, DescriptionError
from pinflex.mechanics.mechanism import Mechanism, load
from pinflex.progress import Progress, barred, callback
from pinflex.solver.solve import default_motion
from pinflex.solver.step_length import default_step
from pinflex.text import brief, number, table
from pinflex.threads import one_blas_thread
from pinflex.variation.derivatives import extrapolated, of_frequencies
from pinflex.variation.measures import DEFAULT, RUNS, available, check_names, measure, unit
from pinflex.variation.variants import Variants, variants

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BY = ("flexible.*.section.*", "flexible.*.material.E", "joints.*.drive.stiffness")
_NONE = 1e-6  # a relative sensitivity that nobody would act on


@dataclass(frozen=True)
class Sensitivities(Worded):
    """Relative sensitivities d ln(output) / d ln(parameter) about one design.

    Attributes:
        parameters: Key paths, with their values in `at`, shape (parameters,).
        outputs: Names, with their values, shape (outputs,).
        table: The sensitivities, shape (parameters, outputs).
        error: Their estimated errors, same shape: of the differences between designs.
        remarks: Sentences on what the errors leave out.
    """

    __repr__ = brief

    parameters: tuple[str, ...]
    at: Array
    outputs: tuple[str, ...]
    values: Array
    table: Array
    error: Array
    remarks: tuple[str, ...] = ()

    def __getitem__(self, pair: tuple[str, str]) -> float:
        """The sensitivity of (output, parameter)."""
        output, parameter = pair
        return float(self.table[self.parameters.index(parameter), self.outputs.index(output)])

    def text(self) -> str:
        """The table and a sentence on what matters, for people."""
        rows = [
            [key, number(float(value)), *(f"{x:+.3f}" for x in row)]
            for key, value, row in zip(self.parameters, self.at, self.table, strict=True)
        ]
        heads = "|".join(("parameter", "value", *self.outputs))
        width = max(map(len, self.parameters))
        note = f"Errors of these numbers: at most {np.nanmax(self.error):.1g}."
        title = "Change of an output [%] for one per cent more of a parameter"
        shown = table(title, heads, rows, (min(width, 44),))
        return "\n".join([shown, "", self.sentence(), note, *self.remarks])

    def sentence(self) -> str:
        """The parameter that matters most for each output."""
        said = []
        for k, output in enumerate(self.outputs):
            column = np.nan_to_num(self.table[:, k])
            best = int(np.argmax(np.abs(column)))
            if abs(column[best]) < _NONE:
                said.append(f"Nothing here changes {output}.")
                continue
            value = f"{number(float(self.values[k]))} {unit(output)}".rstrip()
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
        from pinflex.viewer.tornado import tornado

        return tornado(self.parameters, self.outputs, self.table).axes(panel, ax, path)

    def as_json(self) -> dict[str, Any]:
        """Plain lists and names, SI units."""
        return {
            "parameters": dict(zip(self.parameters, self.at.tolist(), strict=True)),
            "outputs": dict(zip(self.outputs, self.values.tolist(), strict=True)),
            "units": {name: unit(name) for name in self.outputs},
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
    extrapolated differences of designs solved alike (equal steps). Which directions deform and
    what links carry beside their beams stay as they are at the first design.

    Args:
        model: A model, or what `load` takes.
        by: Key paths, whose segments may be globs; links of one block of the YAML count as one.
            Default: sections, moduli and drive stiffnesses.
        of: Outputs, see `pinflex.variation.measures`; default: what there is of frequency.1, mass,
            sag, deviation.peak, torque.peak and stress.peak.
        level: Of the runs that outputs need; default: that of the YAML.
        progress: True: a bar; or a function called with (parameters done, parameters).

    Raises:
        DescriptionError: No such number or output.
    """
    tell = callback(progress)
    robot = model if isinstance(model, Mechanism) else load(model)
    designs = variants(robot, by or _default(robot), _equal_steps(robot))
    if of:
        values = measure(designs.base, check_names(of, robot), level)
    else:
        there = available(designs.base, DEFAULT, level)
        values = {name: value for name, value in there.items() if value}
    outputs = tuple(values)
    shape = (len(designs.parameters), len(outputs))
    found, error = np.zeros(shape), np.zeros(shape)
    for row, parameter in enumerate(designs.parameters):
        slopes, errors = _slopes(designs, parameter, outputs, level)
        found[row] = [slopes[name] for name in outputs]
        error[row] = [errors[name] for name in outputs]
        if tell is not None:
            tell(row + 1, shape[0])
    return Sensitivities(
        tuple(p.key for p in designs.parameters), designs.first,
        outputs, np.array([values[name] for name in outputs]), found, error,
        _remarks(outputs, level or robot.description.solve.level),
    )  # fmt: skip


def _remarks(outputs: Sequence[str], level: str) -> tuple[str, ...]:
    """A sentence where a peak is read off the samples of a vibration."""
    peaks = [name for name in outputs if name.partition(".")[0] in RUNS]
    if level not in ("ked", "coupled") or not peaks:
        return ()
    return (
        f"{', '.join(peaks)} at level {level}: peaks of a vibration jump from sample to sample, "
        "and its steps shift them. These errors leave that out (0.1 was seen on 3rrr): ask again "
        "with a quarter of solve.dt and solve.samples=null.",
    )


def _equal_steps(robot: Mechanism) -> list[str]:
    """Overrides for steps that do not follow the parameters: their choice is no smooth function."""
    spec = robot.description.solve
    if spec.dt is not None and spec.tol is None:
        return []
    if not robot.compliant:
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
    designs: Variants, parameter: Parameter, outputs: Sequence[str], level: str | None
) -> tuple[dict[str, float], dict[str, float]]:
    """Sensitivities and their errors, by output."""
    at = partial(designs.scaled, parameter)
    implicit = [name for name in outputs if name.startswith("frequency.")]
    slopes, errors = {}, {}
    if implicit:
        try:
            last = max(int(name.partition(".")[2]) for name in implicit)
            _, slope, error = of_frequencies(designs.base, at, last)
        except ConvergenceError:  # no equilibrium: those of the undeformed pose
            implicit = []
        else:
            for name in implicit:
                place = int(name.partition(".")[2]) - 1
                slopes[name], errors[name] = float(slope[place]), float(error[place])
    rest = [name for name in outputs if name not in slopes]
    if rest:
        # a run is dear and wanted to 1e-3: two steps serve
        runs = any(name.partition(".")[0] in RUNS for name in rest)
        found, doubt = extrapolated(lambda h: measure(at(h), rest, level), steps=2 if runs else 3)
        slopes, errors = slopes | found, errors | doubt
    return slopes, errors
