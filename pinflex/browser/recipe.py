"""A run of level coupled as the kernel in a page needs it: tables, steps, corrections, start.

The page takes the steps of a run within a tolerance (`pinflex.solver.one_run`): Radau IIA, each
step corrected twice; the first correction is answered, the second tells its error. The resolution
of the steps stays as it is given: nothing is sent back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pinflex.actuation.drive import breaks
from pinflex.actuation.nominal import nominal
from pinflex.arrays import Array, IntArray
from pinflex.browser.image import Image
from pinflex.browser.inputs import tabulate
from pinflex.browser.outputs import outputs
from pinflex.browser.pattern import widened
from pinflex.errors import DescriptionError
from pinflex.integrators.corrector import Corrector
from pinflex.integrators.march import SHORT, March, Radau, newton_tolerance
from pinflex.kernel.march import RESTARTS, MarchKernel
from pinflex.kernel.stages import StageKernel
from pinflex.kernel.tables import Tables
from pinflex.mechanics.mechanism import Mechanism
from pinflex.solver.judge import PART
from pinflex.solver.scene import Scene
from pinflex.solver.solve import SAMPLES, scene_of

# Steps of a batch: most runs of a page are one, whose error is told after its answer is shown.
TOGETHER = 64
# Lengths of an octave that steps have here: the same steps in every browser, and in the native
# kernel. A step is shorter by 1.6 % on average than it might be.
GRAIN = 32
_GIVEN_STAGES = ("free_at", "motor_v", "motor_q", "motor_paired", "plain_q", "plain_v", "circle_q",
                 "circle_v", "ball_q", "ball_v", "body_q", "body_v", "body_flat", "c", "A", "A2",
                 "A2_inverse", "value", "forward", "back", "kp", "kd")  # fmt: skip
_GIVEN_MARCH = ("measured_at", "kind", "stop_at", "weight", "basis", "basis_0", "last", "y", "v")


@dataclass(frozen=True)
class Recipe:
    """A run for the page.

    Attributes:
        image: Arrays and structures. header: What page/march.js reads beside them.
        values: Arrays that the header names, by number.
    """

    image: Image
    header: dict[str, Any]


def live_scene(mechanism: Mechanism) -> Scene:
    """The scene of level coupled, within a tolerance.

    Raises:
        DescriptionError: A page cannot run it.
    """
    scene = scene_of(mechanism, "coupled")
    scene = replace(scene, spec=replace(scene.spec, dt=None, tol=scene.spec.tol or 1e-3))
    if why := _beyond(scene):
        raise DescriptionError(
            f"{mechanism.name}: a page that computes has no {why}. Write a page that plays: "
            "`pinflex solve`, then `pinflex view RUN.npz`."
        )
    return scene


def _beyond(scene: Scene) -> str | None:
    """What of a scene the page does not have."""
    mechanism = scene.mechanism
    system = scene.equations().system
    solids = any(slot.body.solid is not None for slot in system.expansion.slots)
    checks = {
        "link to bend": not system.n_eta,
        "run without the compiled kernel": not scene.on_kernel,
        "control": scene.control is not None,
        "drive that pushes (solve.drive: torque)": scene.spec.drive != "prescribed",
        "solid body": solids,
        "sleeve on a beam": bool(system.closed.contacts),
        "load that comes and goes": system.loads.timed,
        "dry friction that sticks": scene.sticks,
        "free joint": mechanism.report.mobility != len(system.motors),
        "start of another kind": not isinstance(scene.spec.start, str),
    }
    return next((what for what, is_so in checks.items() if is_so), None)


def times(scene: Scene) -> Array:
    """Samples of a scene [s], shape (nt,)."""
    spec = scene.spec
    end = spec.until if spec.until is not None else scene.motion.duration
    return np.linspace(0.0, float(end), spec.samples or SAMPLES)


def recipe(
    scene: Scene, resolution: float, t: Array, pattern: dict[str, IntArray] | None = None
) -> Recipe:
    """The run of a scene at samples t (s) at a resolution of its steps.

    `pattern`: entries that its tables have to have (`pinflex.browser.pattern`).
    """
    problem = scene._problem(t, scene.equations())
    radau = scene._radau(problem, resolution)
    radau.loose, radau.control = True, replace(radau.control, grain=GRAIN)
    ends, jumps = (float(t[0]), float(t[-1])), breaks(scene.motion, scene._loads)
    tabulate(radau, scene.motion, ends, jumps)
    march = March(
        scene.mechanism.name, radau, scene._begun, ends, {RESTARTS: jumps},
        SHORT * (ends[1] - ends[0]), (TOGETHER, TOGETHER + 1),
    )  # fmt: skip
    radau.compiled.table = (), None  # of other runs
    march._at.resolution = resolution
    close = newton_tolerance(resolution, radau.loose)
    at = march._at
    at.least, at.round_off, at.open = close.relative, close.absolute, close.closure
    at.slack, at.slow, at.patience = close.slack, radau.slow, 1e9
    return _laid_out(scene, radau, march, t, pattern)


def _laid_out(
    scene: Scene, radau: Radau, march: March, t: Array, pattern: dict[str, IntArray] | None
) -> Recipe:
    once = Corrector(radau)
    twice = Corrector(once.stages, slow=0.02)
    kernels = [march._kernel, *(each._made(march.steps) for each in (once, twice))]
    stages = [radau, once.stages, twice.stages]
    image, system = Image(), scene.equations().system
    header: dict[str, Any] = {"tables": _add_tables(image, _wide(system.tables, pattern))}
    weights = [np.zeros(0), once._guess, twice._guess]
    for k, (kernel, each, W) in enumerate(zip(kernels, stages, weights, strict=True)):
        _add_march(image, each.compiled.kernel, kernel, f"{k}/")
        if W.size:
            image.add_arrays({"W": W}, {"W": W.ctypes.data}, {"W": f"{k}/W"})
    header["marches"] = [image.add_structure(kernel.at) for kernel in kernels]
    header["stages"] = [each.method.s for each in stages]
    header["weights"] = [0, *(image.names[f"{k}/W"] for k in (1, 2))]
    header["inputs"] = [image.add_structure(kernel._inputs[1]) for kernel in kernels]
    kept = _Kept(image)
    header["outputs"] = outputs(scene.mechanism, system, kept)
    header["jumps"] = [0.0, *breaks(scene.motion, scene._loads)]
    header["moving"] = _nominal_rates(scene, system)
    header["t"] = t.tolist()
    header["counts"] = dict(system.tables.counts) | {
        "motors": len(system.motors), "free": [int(i) for i in radau.problem.free],
        "columns": int(march._table.value.shape[2]),  # type: ignore[union-attr]
    }  # fmt: skip
    header["passive"] = [int(i) for i in scene.mechanism.rigid.free]
    header["part"], header["static"] = PART, scene.start.kind == "static"
    header["names"] = dict(image.names)
    return Recipe(image, header)


class _Kept:
    """Takes arrays that only the page reads."""

    def __init__(self, image: Image) -> None:
        self._image = image

    def __call__(self, name: str, values: Any) -> int:
        array = np.asarray(values, dtype=float).ravel()
        self._image.names[f"out/{name}"] = len(self._image.arrays)
        self._image.arrays.append((array.size, "k", array))
        return len(self._image.arrays) - 1


def tables_of(mechanism: Mechanism) -> dict[str, Array]:
    """Arrays by name that a number of the scene may change, flat; named as those of a recipe."""
    scene = live_scene(mechanism)
    dynamics = scene.equations()
    found = _flat(dynamics.system.tables)
    if scene.by_forces:
        found["0/weight"] = np.asarray(dynamics.strain.stiffness, float).ravel()
    image = Image()
    outputs(mechanism, dynamics.system, _Kept(image))
    of_page = {name: np.asarray(image.arrays[k][2]) for name, k in image.names.items()}
    return {name: x for name, x in (found | of_page).items() if x.size}


def _nominal_rates(scene: Scene, system: Any) -> list[list[float]]:
    """Velocities and accelerations (nv,) of the rigid motion at the start."""
    first = nominal(scene.mechanism, scene.motion, np.zeros(1))
    v, a = np.zeros(system.nv), np.zeros(system.nv)
    if np.any(first.v):  # at rest accelerations are not part of the balance
        n = int(system.rigid.nv)
        v[:n], a[:n] = first.v[0], first.a[0]
    return [v.tolist(), a.tolist()]


def _wide(tables: Tables, pattern: dict[str, IntArray] | None) -> Tables:
    """The tables with entries of zero where a slider may have others."""
    if pattern is None:
        return tables
    found = widened(_flat(tables), pattern)
    assert found is not None
    return Tables(tables.counts, tables.arrays | found)


def _flat(tables: Tables) -> dict[str, Array]:
    return {name: np.asarray(x, float).ravel() for name, x in tables.arrays.items() if x.size}


def _add_tables(image: Image, tables: Tables) -> int:
    arrays = tables.arrays
    addresses = {name: array.ctypes.data for name, array in arrays.items()}
    image.add_arrays(arrays, addresses, {name: name for name in arrays})
    return image.add_structure(tables._structure)


def _add_march(image: Image, stages: StageKernel, kernel: MarchKernel, head: str) -> None:
    """The arrays and structures of one march and of its stages."""
    for blocks, names in ((stages._keep, _GIVEN_STAGES), (kernel._keep, _GIVEN_MARCH)):
        for block in blocks:
            image.add_arrays(block.arrays, block.addresses, {n: head + n for n in names})
    block, inputs = kernel._inputs
    image.add_arrays(block.arrays, block.addresses, {n: f"{head}in/{n}" for n in block.arrays})
    image.add_structure(stages._structure)
    image.add_structure(inputs)
