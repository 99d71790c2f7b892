"""Views of a result by name: a joint, a frame, a flexible link, a loop, a deviation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from pinflex.arrays import Array
from pinflex.description import section as torsion
from pinflex.description.section import SHAPES, Section
from pinflex.doors import door
from pinflex.errors import DescriptionError, nearest
from pinflex.report import card, grid
from pinflex.results.quantities import key_of
from pinflex.rotations import rotation_vector
from pinflex.text import frozen

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinflex.results.result import Result


# Dynamic stress at any point of a section, the worst section, and the four strength theories.
#
#     sigma = N/A + My z/Iy - Mz y/Iz,     tau from the torque T alone
#
# x runs along the beam, (y, z) lie in the section. Shear from transverse forces is left out, as in
# the source; it is of the order of (thickness / length) of the bending stress.
#
# Source: Liu et al. (2017), J. Cent. South Univ. 24, eqs. 27 to 30; Timoshenko and Goodier, Theory
# of Elasticity, section 109, for the torsion of a rectangle.

_SPECTRUM = 16  # samples of a spectrum, at the least
THEORIES = ("first", "second", "third", "fourth")


@frozen
class PointStress:
    """Stress at one point of every section of a link.

    Attributes:
        t: Times, shape (nt,), s. x: Sections, shape (nx,), m.
        sigma: Normal stress, Pa, shape (nt, nx). tau_xy, tau_xz: Shear stress, Pa, (nt, nx).
        nu: Poisson's ratio, for the second theory.
    """

    t: Array
    x: Array
    sigma: Array
    tau_xy: Array
    tau_xz: Array
    nu: float

    @property
    def tau(self) -> Array:
        """Magnitude of the shear stress, Pa."""
        return np.hypot(self.tau_xy, self.tau_xz)

    def equivalent(self, theory: str = "fourth") -> Array:
        """Equivalent stress by a strength theory, Pa, shape (nt, nx)."""
        return equivalent(self.sigma, self.tau, theory, self.nu)


def point_stress(
    result: Result,
    link: str,
    y: float,
    z: float,
    warping: bool = True,
    forces: Array | None = None,
) -> PointStress:
    """Stress over time at the point (y, z) of every section of a link."""
    view = result.link(link)
    section = section_of(result, link)
    _require_inside(section, y, z, link)
    forces = view.resultant if forces is None else forces
    N, T, My, Mz = (forces[:, :, k] for k in (0, 3, 4, 5))
    sigma = N / section.A + My * (z / section.Iy) - Mz * (y / section.Iz)
    per_y, per_z = torsion_shear(section, y, z, warping)
    material = result.meta["links"][link]["material"]
    nu = material["E"] / (2 * material["G"]) - 1.0
    return PointStress(result.t, view.x, sigma, T * per_y, T * per_z, nu)


def section_of(result: Result, link: str) -> Section:
    """Cross-section of a link, from the meta of a run."""
    try:
        return Section(**result.meta["links"][link]["section"])
    except TypeError:
        raise DescriptionError(
            f"{link}: the run does not hold all of the section (an older pinflex wrote it). "
            "Solve again."
        ) from None


def torsion_shear(
    section: Section, y: float, z: float, warping: bool = True
) -> tuple[float, float]:
    """Shear stresses tau_xy and tau_xz at (y, z) for a torque of one, 1/m^3."""
    if not warping:
        return torsion.plane(section, y, z)
    field = SHAPES[section.shape].shear if section.shape in SHAPES else None
    if field is None:
        raise DescriptionError(
            f"torsion_shear: no field of shear stress for the shape {section.shape}. "
            "Use the largest one, torque / Wt (link stress `shear`), or warping=False."
        )
    return field(section, y, z)


def _require_inside(section: Section, y: float, z: float, link: str) -> None:
    ys, zs = (max(abs(p[k]) for p in section.fibres) for k in (0, 1))
    if abs(y) > ys * (1 + 1e-9) or abs(z) > zs * (1 + 1e-9):
        raise DescriptionError(
            f"{link}: ({y:g}, {z:g}) m is outside the section: |y| <= {ys:g}, |z| <= {zs:g}. "
            "Give a point in the beam frame."
        )


def principal(sigma: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Principal stresses s1 >= s2 = 0 >= s3 of a beam point, Pa."""
    radius = np.hypot(0.5 * sigma, tau)
    return 0.5 * sigma + radius, np.zeros_like(radius), 0.5 * sigma - radius


def equivalent(sigma: Array, tau: Array, theory: str = "fourth", nu: float = 0.3) -> Array:
    """Equivalent stress of the four strength theories, Pa."""
    s1, s2, s3 = principal(sigma, tau)
    if theory == "first":
        return s1
    if theory == "second":
        return np.asarray(s1 - nu * (s2 + s3))
    if theory == "third":
        return np.asarray(s1 - s3)
    if theory == "fourth":
        return np.asarray(np.sqrt(0.5 * ((s1 - s2) ** 2 + (s2 - s3) ** 2 + (s3 - s1) ** 2)))
    raise DescriptionError(f"theory: {theory}.{nearest(theory, THEORIES)}")


@dataclass(frozen=True)
class Worst:
    """Largest stress: link, section x (m), time t (s), value (Pa)."""

    link: str
    kind: str
    x: float
    t: float
    value: float


def worst_section(result: Result, kind: str = "von_mises", link: str | None = None) -> Worst:
    """Largest stress over time, sections and links."""
    names = [link] if link is not None else list(result.links)
    if not names:
        raise DescriptionError(
            "worst_section: a rigid run has no stresses. Solve a flexible level."
        )
    best: Worst | None = None
    for name in names:
        view = result.link(name)
        values = np.abs(view.stress(kind))
        k, j = np.unravel_index(int(np.argmax(values)), values.shape)
        if best is None or values[k, j] > best.value:
            best = Worst(name, kind, float(view.x[j]), float(result.t[k]), float(values[k, j]))
    assert best is not None
    return best


class Event(NamedTuple):
    """A contact, release or bounce of a run.

    Attributes:
        time: [s].
        name: Loop or spring, or "stop of", "table of", "play of" with a joint.
        what: contact, release, bounce (of a rigid stop), or bend (of a table).
        speed: Of approach or release [rad/s | m/s].
        impulse: Of a bounce [N m s | N s]; 0 of others, whose forces are finite.
        loss: Energy that a bounce takes [J].
    """

    time: float
    name: str
    what: str
    speed: float
    impulse: float
    loss: float

    def __repr__(self) -> str:
        return f"<Event {self.time:.6g} s, {self.name}: {self.what} at {self.speed:.3g}>"


class Statistic(NamedTuple):
    """A quantity over several runs whose single histories mean little: means, and their spread.

    Attributes:
        rms, peak: In the unit of the quantity.
        frequencies: Lower ends of the octaves of its spectrum [Hz]. levels: Its rms in each.
        spread: Of rms, of peak, then of every octave: standard deviation over the runs.
        runs: Their number. parted: When the two part that differ by 1e-9 in their first speeds [s];
            None: they do not.
    """

    rms: float
    peak: float
    frequencies: list[float]
    levels: list[float]
    spread: list[float]
    runs: int
    parted: float | None = None


def statistics(
    t: Array, names: Sequence[str], histories: Sequence[Array]
) -> dict[str, dict[str, object]]:
    """Statistics by name of runs (nt, names) at equal times t, as plain data."""
    if len(t) < _SPECTRUM or not names:
        return {}
    frequencies = np.fft.rfftfreq(len(t), float(t[1] - t[0]))
    edges = frequencies[1] * 2.0 ** np.arange(int(np.log2(len(frequencies) - 1)) + 1)
    octave = np.searchsorted(edges, frequencies, side="right") - 1
    found = {}
    for k, name in enumerate(names):
        rows = []
        for x in (history[:, k] for history in histories):
            power = 2.0 * np.abs(np.fft.rfft(x) / len(x)) ** 2
            levels = [float(power[octave == band].sum()) ** 0.5 for band in range(len(edges))]
            rows.append([float(np.mean(x**2)) ** 0.5, float(np.abs(x).max()), *levels])
        mean, spread = np.mean(rows, axis=0).tolist(), np.std(rows, axis=0, ddof=1).tolist()
        found[name] = Statistic(
            mean[0], mean[1], edges.tolist(), mean[2:], spread, len(rows)
        )._asdict()
    return found


class Stored(property):
    """An attribute of a view that is one array of its result."""

    def __init__(self, key: str) -> None:
        """`key`: flat, with NAME for the name of the view."""
        row = key_of(key)
        assert row is not None
        unit = f" [{row.unit}]" if row.unit else ""
        doc = f"{row.meaning[0].upper()}{row.meaning[1:]}{unit}, shape {row.shape}."
        super().__init__(lambda view: view.result.array(key.replace("NAME", view.name)))
        self.__doc__ = doc  # Python 3.11 gives a subclass of property its own

    if TYPE_CHECKING:

        def __get__(self, view: Any, owner: Any = None, /) -> Array: ...  # type: ignore[override]


class View:
    """What the views of a result share: their kind, and the keys of their arrays by attribute."""

    kind: ClassVar[str] = ""
    arrays: ClassVar[Mapping[str, str]] = {}
    result: Result
    name: str

    def plot(self, ax: Axes | None = None) -> Any:
        """Draw it over time; returns the matplotlib axes."""
        return self.result.plot(f"{self.kind}/{self.name}", ax)

    def _repr_html_(self) -> str:
        rows = []
        for what, key in self.arrays.items():
            try:
                values = getattr(self, what)
            except (DescriptionError, KeyError):
                continue  # a result that does not store it
            unit = self.result.unit(key.replace("NAME", self.name))
            rows.append((what, unit, str(np.shape(values)), f"{peak(values):.4g}"))
        heading = f"{self.kind} {self.name}, {self.result.level}"
        return card(heading, grid(("array", "unit", "shape", "largest"), rows))


@frozen
class JointView(View):
    """One joint of a result: coordinates, motor torque, reaction."""

    kind = "joint"
    arrays: ClassVar[Mapping[str, str]] = {
        "position": "joint/q/NAME", "velocity": "joint/v/NAME", "acceleration": "joint/a/NAME",
        "torque": "torque/NAME", "reaction": "reaction/NAME",
    }  # fmt: skip

    def plot(self, ax: Axes | None = None) -> Any:
        """Draw the torque of a motor, or the position of another joint; returns the axes.

        Args:
            ax: Where to draw; default: axes of a new figure.
        """
        kind = "torque" if self.name in self.result.motors else "joint"
        return self.result.plot(f"{kind}/{self.name}", ax)

    result: Result
    name: str

    @property
    def position(self) -> Array:
        """Coordinates [rad | m], shape (nt,), or (nt, n) for a joint of several coordinates."""
        return self._columns("joint/q")

    @property
    def angle(self) -> Array:
        """Position of a joint of one freedom [rad | m], shape (nt,), continuous over turns.

        A continuous joint, whose coordinates are a cosine and a sine, is counted from angle zero.
        """
        q = self.position
        if q.ndim == 1:
            return q
        if q.shape[1] != 2 or len(self._parts) > 1:
            raise DescriptionError(
                f"joint {self.name!r}: it has {q.shape[1]} coordinates and no one angle. "
                "Take `position`."
            )
        return np.unwrap(np.arctan2(q[:, 1], q[:, 0]))

    @property
    def velocity(self) -> Array:
        """Rates [rad/s | m/s], shaped like `position`."""
        return self._columns("joint/v")

    @property
    def acceleration(self) -> Array:
        """Accelerations [rad/s^2 | m/s^2], shaped like `velocity`."""
        return self._columns("joint/a")

    @property
    def torque(self) -> Array:
        """Motor torque [N m | N], shape (nt,); zero in a joint without motor."""
        if self.name not in self.result.motors:
            return np.zeros(len(self.result.t))
        return self.result.torque[:, self.result.motors.index(self.name)]

    @property
    def reaction(self) -> Array:
        """Wrench [N; N m] of the parent on the child, in the child's joint frame, (nt, 6)."""
        return self.result.array(f"reaction/{self._parts[-1]}")

    @property
    def reaction_world(self) -> Array:
        """Wrench [N; N m] of the parent on the child, in world axes at the joint, (nt, 6)."""
        return self.result.fresh(f"reaction_world/{self._parts[-1]}")

    @property
    def _parts(self) -> tuple[str, ...]:
        """Its names in the result: a universal joint is two hinges, NAME.1 and NAME.2."""
        both = tuple(f"{self.name}.{k}" for k in (1, 2))
        names = self.result.meta["joints"]
        return both if self.name not in names and both[1] in names else (self.name,)

    def _columns(self, key: str) -> Array:
        if len(self._parts) > 1:
            each = [JointView(self.result, name)._columns(key) for name in self._parts]
            return np.stack(each, axis=1)
        values, names = self.result.array(key), self.result.meta["joints"]
        index = self.result.meta.get("joint_index", {}).get(self.name)  # [iq, nq, iv, nv]
        if index is not None:
            start, count = index[:2] if key == "joint/q" else index[2:]
        elif values.shape[1] == len(names):  # every joint has one coordinate
            start, count = names.index(self.name), 1
        else:
            raise DescriptionError(
                f"joint {self.name!r}: {key} has {values.shape[1]} columns for {len(names)} "
                "joints, and the result does not say whose they are. "
                'Write meta["joint_index"][joint] = [iq, nq, iv, nv].'
            )
        return values[:, start] if count == 1 else values[:, start : start + count]


@frozen
class FrameView(View):
    """One output frame of a result, in the world frame."""

    kind = "frame"
    arrays: ClassVar[Mapping[str, str]] = {
        "position": "frame/NAME/position", "rotation": "frame/NAME/rotation",
        "velocity": "frame/NAME/velocity", "acceleration": "frame/NAME/acceleration",
    }  # fmt: skip

    result: Result
    name: str

    position = Stored("frame/NAME/position")
    """Origin [m], shape (nt, 3)."""
    rotation = Stored("frame/NAME/rotation")
    """Rotation matrices world <- frame, shape (nt, 3, 3)."""
    velocity = Stored("frame/NAME/velocity")
    """Velocity of the origin [m/s], then angular velocity [rad/s], shape (nt, 6)."""
    acceleration = Stored("frame/NAME/acceleration")
    """Acceleration of the origin [m/s^2], then angular [rad/s^2], shape (nt, 6)."""

    def away_from(self, position: Array, rotation: Array) -> Deviation:
        """Deviation from other poses at the same instants, shapes (nt, 3) and (nt, 3, 3)."""
        turn = rotation_vector(self.rotation @ np.swapaxes(rotation, 1, 2))
        return Deviation(self.result.t, self.position - position, turn)


@frozen
class LinkView(View):
    """Fields along one flexible link, in its beam frame unless said."""

    kind = "link"
    arrays: ClassVar[Mapping[str, str]] = {
        "deflection": "link/NAME/deflection", "resultant": "link/NAME/resultant",
        "von_mises": "link/NAME/stress/von_mises",
    }  # fmt: skip

    result: Result
    name: str

    x = Stored("link/NAME/x")
    """Stations along the undeformed link [m], shape (nx,)."""

    @property
    def length(self) -> float:
        """Undeformed span [m]."""
        return float(self.result.meta["links"][self.name]["length"])

    deflection = Stored("link/NAME/deflection")
    """Displacements u v w [m] and rotations rx ry rz [rad], shape (nt, nx, 6)."""
    resultant = Stored("link/NAME/resultant")
    """Section forces N Vy Vz [N] and moments T My Mz [N m], shape (nt, nx, 6)."""
    von_mises = Stored("link/NAME/stress/von_mises")
    """Largest von Mises stress of each section [Pa], shape (nt, nx)."""
    centreline = Stored("link/NAME/centreline")
    """Deformed centre line in the world frame [m], shape (nt, nx, 3)."""
    centreline_rigid = Stored("link/NAME/centreline_rigid")
    """Centre line of the same instant were the link rigid [m], shape (nt, nx, 3)."""
    section_y = Stored("link/NAME/section_y")
    """World direction of the y axis of each section, shape (nt, nx, 3)."""

    def stress(self, kind: str = "von_mises") -> Array:
        """Stress [Pa] by kind: normal, axial, bending, shear or von_mises; shape (nt, nx)."""
        return self.result.array(f"link/{self.name}/stress/{kind}")

    def point_stress(self, y: float, z: float, warping: bool = True) -> PointStress:
        """Stress over time at one point of every section.

        Args:
            y, z: Point in the section [m], in the beam frame.
            warping: St-Venant's shear of the section; False: plane sections.
        """
        return point_stress(self.result, self.name, y, z, warping)


@frozen
class LoopView(View):
    """Load of one loop joint: the action on the body of its frame b, in the world frame."""

    kind, arrays = "loop", {"wrench": "loop/NAME/wrench"}

    result: Result
    name: str

    wrench = Stored("loop/NAME/wrench")
    """Force [N] and moment about the origin of frame b [N m], shape (nt, 6)."""

    @property
    def force(self) -> Array:
        """Force [N], shape (nt, 3)."""
        return self.wrench[:, :3]


@frozen
class Deviation:
    """Distance of a frame between two runs, in the world frame.

    Attributes:
        t: Instants [s], shape (nt,).
        position: Difference of the origins [m], shape (nt, 3).
        rotation: Rotation vector from the other run to this one [rad], shape (nt, 3).
    """

    t: Array
    position: Array
    rotation: Array

    @property
    def norm(self) -> Array:
        """Distance of the origins [m], shape (nt,)."""
        return np.asarray(np.linalg.norm(self.position, axis=1))

    @property
    def angle(self) -> Array:
        """Angle between the orientations [rad], shape (nt,)."""
        return np.asarray(np.linalg.norm(self.rotation, axis=1))

    def plot(self, panel: str | None = None, ax: Axes | None = None) -> Any:
        """Draw position and rotation over time; returns the matplotlib axes.

        Args:
            panel: One alone: "position" or "rotation".
            ax: Where to draw that; default: axes of a new figure.
        """
        return door("viewer.plots.axes", "plot_deviation")(self, panel, ax)

    def _repr_html_(self) -> str:
        far, turned = int(self.norm.argmax()), int(self.angle.argmax())
        rows = [
            ("position", "m", f"{self.norm[far]:.4g}", f"{self.t[far]:.4g}"),
            ("rotation", "rad", f"{self.angle[turned]:.4g}", f"{self.t[turned]:.4g}"),
        ]
        return card("deviation", grid(("", "unit", "largest", "at s"), rows))

    def max(self) -> float:
        """Largest distance of the run [m]."""
        return float(self.norm.max())


def peak(x: Array) -> float:
    """Largest magnitude over all entries, in the unit of x."""
    return float(np.abs(x).max(initial=0.0))


def rms(x: Array) -> float:
    """Root of the mean square over all entries, in the unit of x."""
    return float(np.sqrt(np.mean(np.square(x)))) if np.size(x) else 0.0
