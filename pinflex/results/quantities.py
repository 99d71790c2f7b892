"""Output quantities added from outside: computed from a Result when read by name, never stored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex import registered
from pinflex.arrays import Array
from pinflex.errors import DescriptionError

if TYPE_CHECKING:
    from pinflex.results.result import Result


# The arrays of a result by their flat keys: shape, unit, meaning, names of components.

XYZ = ("x", "y", "z")
TWIST = (*XYZ, "rx", "ry", "rz")
WRENCH = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
BENT = ("u", "v", "w", "rx", "ry", "rz")
SECTION = ("N", "Vy", "Vz", "T", "My", "Mz")
_MATRIX = ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz")
_POSE = ("xx", "xy", "xz", "x", "yx", "yy", "yz", "y", "zx", "zy", "zz", "z")


@dataclass(frozen=True)
class Key:
    """What stands under a key.

    Attributes:
        key: With NAME for a name of the robot.
        shape: In words: nt instants, nx stations along a link.
        unit: "" for none; of two kinds of components, both.
        meaning: In words.
        columns: Names of the components of an instant (at a station), where they are fixed.
        of: From the samples of a run just solved (`Samples` of `pinflex.recovery.kinematics`, which
            nothing here imports) to the values, computed when they are asked for; None: this run
            has none. Of keys that do not say, `pinflex.recovery.recover` knows.
    """

    key: str
    shape: str
    unit: str
    meaning: str
    columns: tuple[str, ...] = ()
    of: Callable[[Any], Array | None] | None = None


KEYS = (
    Key("joint/q", "(nt, nq)", "rad", "coordinates of the joints (m where a joint slides)"),
    Key("joint/v", "(nt, nv)", "rad/s", "rates of the joints (m/s where a joint slides)"),
    Key("joint/a", "(nt, nv)", "rad/s^2", "accelerations of the joints (m/s^2 where one slides)",
        of=lambda s: s.run.a[:, : s.run.system.rigid.nv]),
    Key("torque", "(nt, motors)", "N m", "motor torques (N where a motor pushes)"),
    Key("multiplier", "(nt, rows)", "N | N m", "multipliers of the closures, row by row",
        of=lambda s: s.run.lam),
    Key("eta", "(nt, n)", "", "elastic coordinates of links and drives, as their bases scale them"),
    Key("eta_v", "(nt, n)", "", "their rates, per second"),
    Key("eta_a", "(nt, n)", "", "their accelerations, per second squared",
        of=lambda s: s.run.a[:, s.run.system.rigid.nv :] if s.run.system.n_eta else None),
    Key("nominal/q", "(nt, nq)", "rad", "coordinates of the nominal rigid motion (level ked)"),
    Key("nominal/v", "(nt, nv)", "rad/s", "its rates"),
    Key("nominal/a", "(nt, nv)", "rad/s^2", "its accelerations"),
    Key("frame/NAME/position", "(nt, 3)", "m", "origin of an output frame, in the world", XYZ),
    Key("frame/NAME/rotation", "(nt, 3, 3)", "", "rotation matrix world <- frame", _MATRIX),
    Key("frame/NAME/velocity", "(nt, 6)", "m/s, rad/s",
        "velocity of its origin, then angular velocity, in world axes", TWIST),
    Key("frame/NAME/acceleration", "(nt, 6)", "m/s^2, rad/s^2",
        "acceleration of its origin, then angular acceleration, in world axes", TWIST),
    Key("frame/NAME/deviation", "(nt, 6)", "m, rad",
        "displacement and small rotation from the nominal motion (level ked)", TWIST),
    Key("frame/NAME/deviation_rate", "(nt, 6)", "m/s, rad/s", "its first derivative", TWIST),
    Key("frame/NAME/deviation_acceleration", "(nt, 6)", "m/s^2, rad/s^2",
        "its second derivative", TWIST),
    Key("body/NAME/pose", "(nt, 3, 4)", "",
        "rotation matrix and origin [m] of a rigid link in the world", _POSE),
    Key("body/NAME/pose_rigid", "(nt, 3, 4)", "",
        "the same were the robot rigid, at the motor positions of the run", _POSE),
    Key("link/NAME/x", "(nx,)", "m", "stations along a flexible link"),
    Key("link/NAME/deflection", "(nt, nx, 6)", "m, rad",
        "displacements and rotations of its sections, in the beam frame at its root", BENT),
    Key("link/NAME/resultant", "(nt, nx, 6)", "N, N m",
        "section forces and moments, in the beam frame", SECTION),
    Key("link/NAME/stress/normal", "(nt, nx)", "Pa", "largest normal stress of each section"),
    Key("link/NAME/stress/axial", "(nt, nx)", "Pa", "its part from the axial force"),
    Key("link/NAME/stress/bending", "(nt, nx)", "Pa", "its part from bending"),
    Key("link/NAME/stress/shear", "(nt, nx)", "Pa",
        "largest shear stress of torsion in each section, without that of transverse forces"),
    Key("link/NAME/stress/von_mises", "(nt, nx)", "Pa",
        "largest von Mises stress of each section: axial force, bending and torsion"),
    Key("link/NAME/centreline", "(nt, nx, 3)", "m", "deformed centre line in the world", XYZ),
    Key("link/NAME/centreline_rigid", "(nt, nx, 3)", "m",
        "centre line of the same instant were the robot rigid", XYZ),
    Key("link/NAME/section_y", "(nt, nx, 3)", "", "direction of the y axis of each section", XYZ),
    Key("link/NAME/mesh/nodes", "(nodes, 3)", "m",
        "nodes on the surface of a solid link, in the beam frame", XYZ),
    Key("link/NAME/mesh/triangles", "(triangles, 3)", "", "its triangles, by nodes"),
    Key("link/NAME/mesh/von_mises", "(nt, nodes)", "Pa", "von Mises stress at its nodes"),
    Key("drive/NAME/motor_position", "(nt,)", "rad", "angle of a motor before its gear"),
    Key("drive/NAME/motor_speed", "(nt,)", "rad/s", "its speed"),
    Key("drive/NAME/motor_torque", "(nt,)", "N m", "its torque"),
    Key("drive/NAME/motor_power", "(nt,)", "W", "its mechanical power"),
    Key("drive/NAME/position", "(nt,)", "rad", "position of the joint behind the gear"),
    Key("drive/NAME/deflection", "(nt,)", "rad", "how far the gear gives way"),
    Key("drive/NAME/speed", "(nt,)", "rad/s", "speed of the joint behind the gear"),
    Key("drive/NAME/torque", "(nt,)", "N m", "torque that the gear gives out"),
    Key("drive/NAME/power", "(nt,)", "W", "power that the gear gives out"),
    Key("loop/NAME/wrench", "(nt, 6)", "N, N m",
        "force and moment of a loop joint on the body of its frame b, about that frame's origin, "
        "in world axes", WRENCH),
    Key("loop/NAME/orbit", "(nt, 3)", "m",
        "centre of a pin that has clearance in its hole, in the axes of the loop's frame a", XYZ),
    Key("reaction/NAME", "(nt, 6)", "N, N m",
        "force and moment of the parent on the child of a joint, in the child's frame", WRENCH),
    Key("reaction_world/NAME", "(nt, 6)", "N, N m",
        "the same in world axes; of a run just solved, not stored", WRENCH),
    Key("shaking", "(nt, 6)", "N, N m",
        "force and moment about the world origin on the ground; of a run just solved, not stored",
        WRENCH),
    Key("energy/kinetic", "(nt,)", "J", "kinetic energy"),
    Key("energy/gravity", "(nt,)", "J", "energy of weight"),
    Key("energy/elastic", "(nt,)", "J", "strain energy of links and drives"),
    Key("energy/spring", "(nt,)", "J", "energy of springs and of loads that keep their direction"),
    Key("energy/work", "(nt,)", "J", "work of the motors so far"),
    Key("energy/dissipated", "(nt,)", "J", "energy taken by damping and friction so far"),
    Key("energy/loads", "(nt,)", "J",
        "work so far of loads without a potential, where there are; kinetic energy that a payload "
        "which came has brought, or took along"),
    Key("residual/closure", "(nt,)", "m", "largest error of a closure (rad of a direction)"),
    Key("residual/newton", "(nt,)", "N | N m", "largest force that the equations leave over"),
    Key("control/NAME", "(nt,)", "", "signal of a controller, in the unit of its actuator"),
    Key("measured", "(nt, sensors)", "", "what the controllers measure"),
    Key("rigid/torque", "(nt, motors)", "N m",
        "torques without elasticity (a run that was compared with the rigid one)"),
)  # fmt: skip


# The unit where a joint slides.
SLIDING = {"rad": "m", "rad/s": "m/s", "rad/s^2": "m/s^2", "N m": "N"}


@cache
def key_of(key: str) -> Key | None:
    """The row of `KEYS` of a flat key; None for one that no run has."""
    return next((one for one in KEYS if _is_of(key, *one.key.partition("NAME"))), None)


def _is_of(key: str, head: str, name: str, tail: str) -> bool:
    if not name:
        return key == head
    return len(key) > len(head + tail) and key.startswith(head) and key.endswith(tail)


def unit_of(key: str) -> str | None:
    """Unit of a flat key, or of a column of one ("torque/motor_1"); None where neither is known."""
    while key:
        found = key_of(key)
        if found is not None:
            return found.unit
        key = key.rpartition("/")[0]
    return None


def joint_unit(key: str, slides: bool) -> str:
    """Unit of a key at a joint that turns, or slides."""
    unit = unit_of(key) or ""
    return SLIDING.get(unit, unit) if slides else unit


# Heads of the keys that every result has of itself.
_OWN = {"t", *(one.key.partition("/")[0] for one in KEYS)}


@dataclass(frozen=True)
class Quantity:
    """An output with a name.

    Attributes:
        key: Flat key under which `Result.array` gives it, as in "power" or "power/total".
        unit: Of its values, as figures and tables write it.
        label: In words, for axes and headings.
        function: From a result to values, shape (nt,) or (nt, ...), time first.
        colour: Of its curve, or None: the first of the palette.
    """

    key: str
    unit: str
    label: str
    function: Callable[[Result], Array]
    colour: str | None = None

    def of(self, result: Result) -> Array:
        """Its values in a result, read-only."""
        values = np.array(self.function(result), dtype=np.float64)
        if values.shape[:1] != result.t.shape:
            raise DescriptionError(
                f"quantity {self.key}: shape {values.shape} does not start with the "
                f"{len(result.t)} instants of t. Arrays are time first.",
                key=self.key,
            )
        values.setflags(write=False)
        return values


QUANTITIES: dict[str, Quantity] = {}


def register_quantity(quantity: Quantity) -> None:
    """Add an output; from then on every result answers to its key, and `plot.spectrum` draws it.

    Args:
        quantity: The output.
    Raises:
        DescriptionError: The key is taken, or that of an array that runs store.
    """
    if quantity.key in QUANTITIES or quantity.key.partition("/")[0] in _OWN:
        raise DescriptionError(f"quantity {quantity.key}: the key is taken. Choose another.")
    QUANTITIES[quantity.key] = quantity
    registered.note(register_quantity, quantity.key, quantity)
