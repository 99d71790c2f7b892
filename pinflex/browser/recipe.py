"""A run of level coupled as the kernel in a page needs it: tables, steps, corrections, start.

The page takes the steps of a run within a tolerance (`pinflex.solver.tolerance`): Radau IIA, each
step corrected twice; the first correction is answered, the second tells its error. The resolution
of the steps stays as it is given: nothing is sent back.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.actuation.drive import breaks, nominal
from pinflex.arrays import Array, IntArray
from pinflex.errors import DescriptionError
from pinflex.integrators.compiled import MarchKernel, StageKernel
from pinflex.integrators.corrector import Corrector
from pinflex.integrators.march import RESTARTS, SHORT, March, Radau
from pinflex.integrators.problem import Problem
from pinflex.kernel.evaluate import Tables, pairs_of
from pinflex.kernel.library import Record
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Attachment, Slot
from pinflex.mechanics.model.system import System
from pinflex.solver.judge import PART
from pinflex.solver.scene import Scene
from pinflex.solver.solve import SAMPLES, scene_of

# A table of a motion in half of its numbers: accelerations, and where each piece begins.

_AGAIN = 1e-13, 1e-11  # of the largest value: what positions and rates may be off by then


def _folded(table: Record, motors: int) -> dict[str, Array] | None:
    """Numbers that page/solver.js makes the table of again; None: it would be another.

    start: Position and velocity where each piece begins, shape (pieces, 2, motors). a: Shape
    (pieces, nodes, motors). once, twice: Integrals over the nodes from -1 on, shape (nodes, nodes).
    """
    node, half, every = (table.arrays[name] for name in ("node", "half", "value"))
    value = every[..., : 3 * motors]
    n = len(node)  # in few pieces the integrals take more room than is saved
    if len(half) < n or np.any(every[..., 3 * motors :] != 1.0):  # shares of loads
        return None
    basis = np.linalg.inv(np.polynomial.chebyshev.chebvander(node, n - 1))
    once, twice = (
        np.polynomial.chebyshev.chebval(
            node, np.polynomial.chebyshev.chebint(basis, k, lbnd=-1.0), tensor=True
        ).T
        for k in (1, 2)
    )
    x, v, a = np.split(value, 3, axis=-1)
    h = half[:, None, None]
    v0 = (v - h * (once @ a)).mean(axis=1, keepdims=True)
    x0 = (x - h * (node[:, None] + 1.0) * v0 - h * h * (twice @ a)).mean(axis=1, keepdims=True)
    again = x0 + h * (node[:, None] + 1.0) * v0 + h * h * (twice @ a), v0 + h * (once @ a)
    for made, wanted, off in zip(again, (x, v), _AGAIN, strict=True):
        if np.abs(made - wanted).max() > off * np.abs(wanted).max(initial=0.0):
            return None
    return {"start": np.concatenate([x0, v0], axis=1), "a": a, "once": once, "twice": twice}


# What the page computes from the states of a run as `pinflex.recovery` does: poses, stresses.
#
# Everything here is read off the mechanism: which nodes of the kernel's tree carry what, and the
# sections of the links. Arrays are named, so that a slider that changes them finds them.

Keep = Callable[[str, Any], int]  # an array by name: its number


def outputs(mechanism: Mechanism, system: System, keep: Keep) -> dict[str, Any]:
    """Links, bodies, platform and joints of a system; `keep` takes the arrays."""
    frames = system.expansion.frames
    node_of = system.node_of_joints

    def place(name: str, at: Attachment) -> list[int]:
        here = np.column_stack([at.placement.rotation, at.placement.translation])
        return [int(node_of[at.joint]), keep(name, here)]

    links = []
    for name, part in mechanism.parts.items():
        slots = [slot for slot in system.expansion.slots if slot.link == name]
        section = part.spec.section
        links.append({
            "name": name,
            "pieces": [
                _piece(f"link/{name}/{k}", slot, system, keep, place)
                for k, slot in enumerate(slots)
            ],
            "section": keep(
                f"link/{name}/section", [section.A, section.Iy, section.Iz, section.Wt]
            ),
            "fibres": keep(f"link/{name}/fibres", np.array(section.fibres)),
        })  # fmt: skip
    bodies = {
        link.name: place(f"body/{link.name}", frames[link.name])
        for link in mechanism.links
        if link.name not in mechanism.parts and link.name in frames
    }
    platform = mechanism.description.platform
    joints = {
        name: int(node_of[int(system.expansion.model.getJointId(name))])
        for name in mechanism.rigid.rigid.names[1:]
    }
    return {
        "links": links,
        "bodies": bodies,
        "platform": place("platform", frames[platform]) if platform else None,
        "joints": joints,
        "loops": list(system.closed.names),
    }


def _piece(
    key: str, slot: Slot, system: System, keep: Keep, place: Callable[[str, Attachment], list[int]]
) -> dict[str, Any]:
    """One body of a link."""
    body, cut = slot.body, slot.body.cut
    model = system.expansion.model
    arrays: dict[str, Array | None] = {
        "x": cut.x, "way": _way(cut.Phi, cut.G), "outer": cut.outer, "outer_twist": cut.outer_twist,
        "body_Phi": body.Phi, "body_x": body.x, "loads": np.array([i.x for i in slot.interfaces]),
        "stations": np.asarray(slot.stations), "twists": np.asarray(slot.twists),
        "offset": np.array([slot.offset]),
    }  # fmt: skip
    kept = {
        name: keep(f"{key}/{name}", x) for name, x in arrays.items() if x is not None and x.size
    }
    nodes = [int(system.node_of_joints[i.bottom(model)]) for i in slot.interfaces]
    nodes += [int(system.node_of_joints[joint]) for joint in slot.turning]  # behind the loads
    root = place(f"{key}/root", slot.root)
    return kept | {"root": root, "eta": [slot.eta.start, slot.eta.stop], "nodes": nodes}


def _way(Phi: Array, G: Array | None) -> Array:
    """Displacements of sections by eta and its products: shape (nx, 6, n + n (n + 1) / 2).

    d = Phi eta + eta' G eta / 2, as one table of [eta; eta_i eta_j, i <= j]; without G: Phi.
    """
    if G is None:
        return Phi
    i, j = np.triu_indices(Phi.shape[-1])
    share = np.where(i == j, 0.25, 0.5)  # a square stands in G twice
    return np.concatenate([Phi, share * (G[..., i, j] + G[..., j, i])], axis=-1)


# Which entries of the sparse tables a slider may move: those of all places it was looked at.
#
# Entries that are nothing but round-off come and go with a number of the scene. Tables with zeros
# in their places are the same tables, and can be subtracted.

TableArrays = dict[str, Array]
_SPARSE = ("phi", "g")  # rows of the map: entries, and where they are


def pattern_of(tables: Iterable[TableArrays]) -> dict[str, IntArray] | None:
    """Entries that any of some tables has; None: they are not of one structure."""
    every = list(tables)
    others = {name for name in every[0] if name.split("_")[0] not in _SPARSE}
    if any(x.keys() != every[0].keys() for x in every):
        return None
    if any(x[name].shape != every[0][name].shape for x in every for name in others):
        return None
    return {name: np.unique(np.concatenate([_keys(x, name) for x in every])) for name in _SPARSE}


def widened(tables: TableArrays, pattern: dict[str, IntArray]) -> TableArrays:
    """The tables, which the pattern is of too, with zeros where only others have entries."""
    out, n = dict(tables), _width(tables)
    for name in _SPARSE:
        wanted, own = pattern[name], _keys(tables, name)
        assert np.isin(own, wanted).all()
        values = np.zeros(len(wanted))
        values[np.searchsorted(wanted, own)] = tables[name]
        rows = len(tables[f"{name}_at"]) - 1
        at = np.searchsorted(wanted, np.arange(rows + 1) * n * n).astype(float)
        out[name], out[f"{name}_at"] = values, at
        out[f"{name}_i"] = (wanted // n % n).astype(float)
        if f"{name}_j" in tables:
            out[f"{name}_j"] = (wanted % n).astype(float)
        if name == "g":  # rows are of products, or of sums of squares
            products = tables["g_rest"] == tables["g_at"][1:]
            out["g_rest"] = np.where(products, at[1:], at[:-1])
            out |= {key: x.astype(float) for key, x in pairs_of(out)[0].items()}
    return out


def _width(tables: TableArrays) -> int:
    """More than there are elastic coordinates."""
    return len(tables["d_at"])


def _keys(tables: TableArrays, name: str) -> IntArray:
    """Row, i and j of each entry as one number, in their order."""
    n, at = _width(tables), tables[f"{name}_at"].astype(np.intp)
    row = np.repeat(np.arange(len(at) - 1), np.diff(at))
    j = tables.get(f"{name}_j", np.zeros(int(at[-1]))).astype(np.intp)
    return np.asarray((row * n + tables[f"{name}_i"].astype(np.intp)) * n + j)


# What a run hands the kernel, its arrays and structures, laid out anew for WebAssembly.
#
# Structures are those of the C sources (`pinflex.kernel.library`); there pointers take four bytes.
# What they point to is found by its address, so that no field is listed here.

_WIDTH = {ctypes.c_int64: 8, ctypes.c_double: 8, ctypes.c_int: 4, ctypes.c_void_p: 4}
_KIND = {ctypes.c_int64: "i", ctypes.c_double: "d", ctypes.c_void_p: "p"}


class Image:
    """Arrays and structures of one scene.

    Attributes:
        arrays: Length, whether of whole numbers, and values or None (room), by number.
        names: Of arrays with values. structures: As page/heap.js reads them.
    """

    def __init__(self) -> None:
        self.arrays: list[tuple[int, str, Array | None]] = []
        self.names: dict[str, int] = {}
        self.structures: list[dict[str, Any]] = []
        self._array_at: dict[int, int] = {}
        self._structure_at: dict[int, int] = {}

    def add_arrays(
        self,
        arrays: Mapping[str, npt.NDArray[Any]],
        addresses: Mapping[str, int],
        given: Mapping[str, str],
    ) -> None:
        """Arrays by name where they lie; `given`: those with values, and what they are called."""
        for name, array in arrays.items():
            if not array.size:
                continue
            self._array_at[addresses[name]] = len(self.arrays)
            called = given.get(name)
            if called is not None:
                self.names[called] = len(self.arrays)
            values = None if called is None else np.array(array, dtype=float).ravel()
            kind = "i" if array.dtype.kind == "i" else "f"
            self.arrays.append((array.size, kind, values))

    def keep(self, name: str, values: Any) -> int:
        """An array that only the page reads; its number."""
        array = np.asarray(values, dtype=float).ravel()
        self.names[f"out/{name}"] = len(self.arrays)
        self.arrays.append((array.size, "k", array))
        return len(self.arrays) - 1

    def add_structure(self, structure: ctypes.Structure) -> int:
        """A structure whose arrays and structures are there already; its number."""
        address = ctypes.addressof(structure)
        if address in self._structure_at:
            return self._structure_at[address]
        laid: dict[str, Any] = {
            "integers": [], "numbers": [], "arrays": [], "structures": [], "fields": {}
        }  # fmt: skip
        laid["size"] = -(-self._lay(structure, laid, 0, "") // 8) * 8
        self._structure_at[address] = len(self.structures)
        self.structures.append(laid)
        return len(self.structures) - 1

    def _lay(self, structure: ctypes.Structure, laid: dict[str, Any], at: int, head: str) -> int:
        """Lay the fields from a place on; the place behind them."""
        fields: Any = structure._fields_
        for name, kind in fields:
            value = getattr(structure, name)
            if isinstance(value, ctypes.Structure):
                at = self._lay(value, laid, at, f"{head}{name}.")
                continue
            width = _WIDTH[kind]
            at = -(-at // width) * width
            laid["fields"][f"{head}{name}"] = at, _KIND.get(kind, "i")
            self._put(laid, at, kind, value)
            at += width
        return at

    def _put(self, laid: dict[str, Any], at: int, kind: Any, value: Any) -> None:
        if kind is ctypes.c_void_p:
            if value in self._array_at:
                laid["arrays"].append((at, self._array_at[value]))
            elif value in self._structure_at:
                laid["structures"].append((at, self._structure_at[value]))
        elif kind is ctypes.c_double:
            laid["numbers"].append((at, value if np.isfinite(value) else None))
        else:
            laid["integers"].append((at, int(value)))


def laid_out(images: Iterable[Image]) -> tuple[list[dict[str, Any]], Array]:
    """Each image as a header, and one line of their numbers: equal arrays once."""
    headers, parts, places, size = list[dict[str, Any]](), list[Array](), dict[bytes, int](), 0
    for image in images:
        heads = list[tuple[int, str, int]]()
        for n, kind, values in image.arrays:
            at = -1
            if values is not None:
                key = values.tobytes()
                if key not in places:
                    places[key], size = size, size + values.size
                    parts.append(values)
                at = places[key]
            heads.append((n, kind, at))
        headers.append({"arrays": heads, "structures": image.structures})
    return headers, np.concatenate(parts) if parts else np.zeros(0)


# Steps of a batch: most runs of a page are one, whose error is told after its answer is shown.
TOGETHER = 64
# Lengths of an octave that steps have here: the same steps in every browser, and in the native
# kernel. A step is shorter by 1.6 % on average than it might be.
GRAIN = 32
# Contraction of Newton's iteration above which the next step has a new tangent: in few long steps
# an old one lets stiff coordinates grow from one second correction to the next, and the error that
# is told with them (82 times the true one on ur5 at 0.1, at most 2.3 times at 0.03).
SLOW = 0.03
_GIVEN_STAGES = ("free_at", "motor_v", "motor_q", "motor_paired", "plain_q", "plain_v", "circle_q",
                 "circle_v", "ball_q", "ball_v", "body_q", "body_v", "body_flat", "c", "A", "A2",
                 "A2_inverse", "value", "forward", "back", "kp", "kd")  # fmt: skip
_GIVEN_MARCH = ("measured_at", "kind", "stop_at", "weight", "basis", "basis_0", "last", "y", "v")


@dataclass(frozen=True)
class Recipe:
    """A run for the page: arrays and structures, and what page/march.js reads beside them."""

    image: Image
    header: dict[str, Any]


def live_scene(mechanism: Mechanism) -> Scene:
    """The scene of level coupled, within a tolerance; refused if a page cannot run it."""
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

    `pattern`: entries that its tables have to have (`pinflex.browser.recipe`).
    """
    problem = scene._problem(t, scene.equations())
    radau = scene._radau(problem, resolution)
    radau.loose, radau.grain, radau.slow = True, GRAIN, SLOW
    ends, jumps = (float(t[0]), float(t[-1])), breaks(scene.motion, scene._loads)
    march = March(
        scene.mechanism.name, radau, scene._begun, ends, {RESTARTS: jumps},
        SHORT * (ends[1] - ends[0]), (TOGETHER, TOGETHER + 1),
    )  # fmt: skip
    if march.kernel.table is None:
        raise DescriptionError(
            f"{scene.motion.kind}: a motion that is no smooth function of time between its breaks: "
            "a page that computes cannot prescribe it."
        )
    march.require(resolution)
    march.at.patience = 1e9
    return _laid_out(scene, radau, march, t, pattern)


def _laid_out(
    scene: Scene, radau: Radau, march: March, t: Array, pattern: dict[str, IntArray] | None
) -> Recipe:
    once = Corrector(radau)
    twice = Corrector(once, slow=0.02)
    kernels = [march.kernel, *(each.workspace(march.steps) for each in (once, twice))]
    stages = [radau, once, twice]
    image, system = Image(), scene.equations().system
    tables = system.tables
    if pattern is not None:  # entries of zero where a slider may have others
        tables = Tables(tables.counts, tables.arrays | widened(_flat(tables), pattern))
    image.add_arrays(tables.arrays, tables.addresses, {name: name for name in tables.arrays})
    header: dict[str, Any] = {"tables": image.add_structure(tables.at)}
    weights = [np.zeros(0), once.weights, twice.weights]
    for k, (kernel, each, W) in enumerate(zip(kernels, stages, weights, strict=True)):
        _add_march(image, each.kernel, kernel, f"{k}/")
        if W.size:
            image.add_arrays({"W": W}, {"W": W.ctypes.data}, {"W": f"{k}/W"})
    header["marches"] = [image.add_structure(kernel.at) for kernel in kernels]
    header["stages"] = [each.method.s for each in stages]
    header["weights"] = [0, *(image.names[f"{k}/W"] for k in (1, 2))]
    header["inputs"] = [image.add_structure(kernel.prescribed.at) for kernel in kernels]
    header["outputs"] = outputs(scene.mechanism, system, image.keep)
    header["jumps"] = [0.0, *breaks(scene.motion, scene._loads)]
    header["kicks"] = _kicks(radau.problem, np.array(header["jumps"][1:]), t)
    header["moving"] = _nominal_rates(scene, system)
    header["t"] = t.tolist()
    header["counts"] = dict(system.tables.counts) | {
        "motors": len(system.motors), "rows": [int(i) for i in system.motors],
        "free": [int(i) for i in radau.problem.free],
        "columns": radau.kernel.counts["columns"],
    }  # fmt: skip
    header["folded"] = _fold(image, march.kernel.table, len(system.motors))
    header["passive"] = [int(i) for i in scene.mechanism.rigid.free]
    header |= {"part": PART, "static": scene.start.kind == "static", "slow": SLOW}
    header["names"] = dict(image.names)
    return Recipe(image, header)


def _fold(image: Image, table: Record | None, motors: int) -> dict[str, Any] | None:
    """Leave the table out of the image, which has it at every march; what it is made again of."""
    found = None if table is None else _folded(table, motors)
    if found is None:
        return None
    at = [image.names[f"{k}/in/value"] for k in range(3)]
    for k in at:
        n, kind, _ = image.arrays[k]
        image.arrays[k] = n, kind, np.zeros(0)
    numbers = {name: image.keep(f"folded/{name}", x) for name, x in found.items()}
    return {"values": at, "motors": motors, **numbers}


def tables_of(mechanism: Mechanism) -> dict[str, Array]:
    """Arrays by name that a number of the scene may change, flat; named as those of a recipe."""
    scene = live_scene(mechanism)
    dynamics = scene.equations()
    found = _flat(dynamics.system.tables)
    if scene.by_forces:
        found["0/weight"] = np.asarray(dynamics.strain.stiffness, float).ravel()
    image = Image()
    outputs(mechanism, dynamics.system, image.keep)
    of_page = {name: np.asarray(image.arrays[k][2]) for name, k in image.names.items()}
    return {name: x for name, x in (found | of_page).items() if x.size}


def _kicks(problem: Problem, at: Array, t: Array) -> list[list[float]]:
    """Times at which accelerations of the motors jump, and those just after, by motor."""
    some = at[problem.jumps(at, problem.path(t).acceleration)] if len(at) else at
    return np.column_stack([some, problem.path(some).acceleration]).tolist() if len(some) else []


def _nominal_rates(scene: Scene, system: Any) -> list[list[float]]:
    """Velocities and accelerations (nv,) of the rigid motion at the start."""
    first = nominal(scene.mechanism, scene.motion, np.zeros(1))
    v, a = np.zeros(system.nv), np.zeros(system.nv)
    if np.any(first.v):  # at rest accelerations are not part of the balance
        n = int(system.rigid.nv)
        v[:n], a[:n] = first.v[0], first.a[0]
    return [v.tolist(), a.tolist()]


def _flat(tables: Tables) -> dict[str, Array]:
    return {name: np.asarray(x, float).ravel() for name, x in tables.arrays.items() if x.size}


def _add_march(image: Image, stages: StageKernel, kernel: MarchKernel, head: str) -> None:
    """The arrays and structures of one march and of its stages."""
    records = (stages, _GIVEN_STAGES), (kernel._steps, ()), (kernel._run, _GIVEN_MARCH)
    for record, names in records:
        image.add_arrays(record.arrays, record.addresses, {n: head + n for n in names})
    inputs = kernel.prescribed
    image.add_arrays(inputs.arrays, inputs.addresses, {n: f"{head}in/{n}" for n in inputs.arrays})
    image.add_structure(stages.at)
    image.add_structure(inputs.at)
