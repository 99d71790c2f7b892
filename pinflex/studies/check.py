"""Check of a model: freedoms, loops, masses, planes, frequencies, warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pinflex.actuation.nominal import nominal
from pinflex.bodies.summary import summary
from pinflex.boundary import public
from pinflex.cards import Worded
from pinflex.description.schema import integer
from pinflex.errors import ConvergenceError, DescriptionError, SceneError, SingularityError
from pinflex.levels.excited import default_motion
from pinflex.levels.modes import Modes, base_state, first_modes, modes, rigid_body
from pinflex.mechanics.assembly import LoopReport
from pinflex.mechanics.equations import Equations
from pinflex.mechanics.joints import sliding
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.studies import check_urdf, check_warnings
from pinflex.studies.check_parts import (
    DriveCheck,
    LinkCheck,
    LoopCheck,
    coupling_texts,
    drive_checks,
    link_check,
    loop_checks,
)
from pinflex.studies.check_statics import Statics, statics
from pinflex.text import brief
from pinflex.threads import one_blas_thread

_ALONG_MOTION = 101  # poses at which the motion is tried
_PRELOADED = "about the static equilibrium"
_UNDAMPED = 1e-9  # a damping ratio below is round-off
_SHIFT = 0.01  # of a frequency by gravity and loads, above which both are told


@dataclass(frozen=True)
class Check(Worded):
    """The report of `pinflex check`.

    Attributes:
        name, urdf, base: What was read. gravity: [m/s^2].
        joints: Velocity coordinates of the rigid tree. elastic: Elastic coordinates.
        report: Loops of the rigid mechanism: rows, rank, redundant rows, mobility, sigma_min.
        motors: Names. units: Of their torques.
        loops, links: One record each.
        platform: Frame, or None.
        elastic_joints: Coordinates with a spring that the rigid level holds.
        couplings: What follows what, as equations of positions.
        drives: Joints with a drive or with friction. urdf_dynamics: What is taken of the URDF's.
        idle: Freedoms that nothing hangs on, held where home has them.
        statics: Sag and holding torques.
        frequencies: [Hz]. frequency_note: Of which state. unloaded: Those without gravity and
            loads, where they differ. damping: Ratio [-] of each of these modes of the machine.
        motion: What the motion asks, and whether the rigid mechanism can follow it.
        warnings: Sentences.
        summaries: Modal summary of each solid body, as text.
        by_joint: Links of the frames that the YAML names by their joint.
    """

    __repr__ = brief

    name: str
    urdf: str
    base: str
    gravity: tuple[float, float, float]
    joints: int
    elastic: int
    report: LoopReport
    motors: tuple[str, ...]
    units: tuple[str, ...]
    loops: tuple[LoopCheck, ...]
    links: tuple[LinkCheck, ...]
    platform: str | None
    statics: Statics
    frequencies: tuple[float, ...]
    frequency_note: str
    motion: str
    elastic_joints: tuple[str, ...] = field(default=())
    couplings: tuple[str, ...] = field(default=())
    idle: tuple[str, ...] = field(default=())
    warnings: tuple[str, ...] = field(default=())
    summaries: tuple[str, ...] = field(default=())
    by_joint: Mapping[str, str] = field(default_factory=dict)
    drives: tuple[DriveCheck, ...] = field(default=())
    urdf_dynamics: str = ""
    unloaded: tuple[float, ...] = ()
    damping: tuple[float, ...] = ()

    def text(self) -> str:
        """Everything as aligned plain text of at most 100 columns."""
        from pinflex.studies.check_text import write

        return write(self)


@public
@takes_model
@one_blas_thread()
def check(mechanism: Mechanism, count: int = 6) -> Check:
    """Look at a model before anything is solved.

    Args:
        mechanism: From `load`.
        count: How many natural frequencies.
    """
    integer(count, "check: count", 1)
    description = mechanism.description
    rest = statics(mechanism)
    first, note = _first_modes(mechanism, count)
    frequencies = () if first is None else tuple(float(f) for f in first.frequencies)
    unloaded = _unloaded(mechanism, count, frequencies) if _PRELOADED in note else ()
    motion, motion_warning = _motion(mechanism)
    links = tuple(link_check(mechanism, part) for part in mechanism.parts.values())
    warnings = (*check_warnings.of(mechanism, links, rest), *motion_warning)
    return Check(
        name=mechanism.name,
        urdf=description.urdf_name,
        base=description.base,
        gravity=description.gravity,
        joints=int(mechanism.rigid.nv),
        elastic=mechanism.flexible.n_eta,
        report=mechanism.report,
        motors=mechanism.motors,
        units=_units(mechanism),
        loops=loop_checks(mechanism),
        links=links,
        platform=description.platform,
        by_joint=dict(description.by_joint),
        statics=rest,
        frequencies=frequencies,
        frequency_note=note,
        damping=() if first is None else damping_ratios(mechanism, first),
        motion=motion,
        elastic_joints=mechanism.elastic_joints,
        couplings=coupling_texts(mechanism),
        idle=mechanism.idle.names,
        warnings=warnings,
        summaries=_summaries(mechanism),
        drives=drive_checks(mechanism),
        urdf_dynamics=check_urdf.used(description),
        unloaded=unloaded,
    )


def is_loaded(mechanism: Mechanism) -> bool:
    """True if gravity, a spring, a load or a frame spring acts on the mechanism at rest.

    One that pushes no free coordinate counts too: thrust along a beam changes its frequencies.
    """
    description = mechanism.description
    acting = any(force.scale(0.0) for force in description.forces)
    springs = len(mechanism.flexible.springs.v_at) > 0 or len(description.springs) > 0
    return any(description.gravity) or springs or acting


def _summaries(mechanism: Mechanism) -> tuple[str, ...]:
    """One text per different solid body."""
    bodies: dict[int, list[str]] = {}
    for name, part in mechanism.parts.items():
        if part.bodies[0].solid is not None:
            bodies.setdefault(id(part.bodies[0]), []).append(name)
    return tuple(
        f"{', '.join(names)}: {summary(mechanism.parts[names[0]].bodies[0])}"
        for names in bodies.values()
    )


def require_vibrating(mechanism: Mechanism) -> None:
    """Refuse a mechanism in which nothing is elastic."""
    if not _vibrates(mechanism):
        raise DescriptionError(
            f"{mechanism.name}: no flexible link and no spring, so nothing vibrates. Write some "
            "under `flexible`."
        )


def _vibrates(mechanism: Mechanism) -> bool:
    return bool(mechanism.flexible.n_eta or len(mechanism.flexible.springs.v_at))


def first_frequencies(mechanism: Mechanism, count: int) -> tuple[tuple[float, ...], str]:
    """Natural frequencies [Hz] at home with locked motors, and the words for that state.

    Where gravity leaves no equilibrium, those of the undeformed pose.
    """
    first, note = _first_modes(mechanism, count)
    return () if first is None else tuple(float(f) for f in first.frequencies), note


def damping_ratios(mechanism: Mechanism, found: Modes) -> tuple[float, ...]:
    """Damping ratio [-] of each mode of the machine, of all dampers; 0 where it does not vibrate.

    That of a link clamped at its root is another: a joint or a mass at its end takes part in the
    motion and has none.
    """
    dynamics, still = Equations(mechanism.flexible), np.zeros(mechanism.flexible.nv)
    lam = np.zeros(mechanism.flexible.closed.n)
    C = dynamics.tangent(found.y, still, still, lam, 0.0).C
    lost = np.einsum("ik,ij,jk->k", found.shapes, C, found.shapes)
    omega = 2.0 * np.pi * found.frequencies
    ratios = lost / np.where(omega > 0, 2.0 * omega, np.inf)
    return tuple(np.where(np.abs(ratios) > _UNDAMPED, ratios, 0.0).tolist())


def _first_modes(mechanism: Mechanism, count: int) -> tuple[Modes | None, str]:
    """The first modes that have a stiffness, and the words for their state."""
    if not _vibrates(mechanism):
        return None, "no flexible link and no spring: nothing vibrates"
    locked = "at home, motors locked" if mechanism.motors else "at home"
    locked += f", base {base}" if (base := base_state(mechanism)) else ""
    loaded, every = is_loaded(mechanism), mechanism.flexible.nv
    try:
        found = modes(mechanism, count=every, preload="gravity" if loaded else "none")
        note = f"{locked}, {_PRELOADED if loaded else 'no load'}"
    except ConvergenceError:
        found = modes(mechanism, count=every, preload="none")
        note = f"{locked}, about the undeformed pose: gravity and loads leave no equilibrium"
    first = first_modes(found, count)
    zeros = rigid_body(first)
    if first.growth is not None and np.max(first.growth, initial=0.0) > 0:
        rate = float(np.max(first.growth))
        note += f"; UNSTABLE: loads that follow make modes flutter, by {rate:.2g} 1/s undamped"
    return first, f"{note}; {zeros}" if zeros else note


def _unloaded(mechanism: Mechanism, count: int, loaded: tuple[float, ...]) -> tuple[float, ...]:
    """Frequencies [Hz] without gravity and loads, where one differs by more than a per cent."""
    try:
        every = modes(mechanism, count=mechanism.flexible.nv, preload="none")
    except SingularityError:
        return ()
    found = tuple(float(f) for f in first_modes(every, count).frequencies)
    pairs = zip(found, loaded, strict=False)
    return found if any(abs(a - b) > _SHIFT * abs(b) for a, b in pairs) else ()


def _units(mechanism: Mechanism) -> tuple[str, ...]:
    slides = sliding(mechanism.rigid.rigid)
    return tuple("N" if name in slides else "N m" for name in mechanism.motors)


def _motion(mechanism: Mechanism) -> tuple[str, list[str]]:
    """The motion in words, and a warning where the rigid mechanism cannot follow it."""
    description = mechanism.description
    if description.motion is None:
        return "none given: the motors hold home", []
    motion = default_motion(mechanism)
    names = ", ".join(motion.names)
    moved = f" of the {motion.target} ({names})" if names else ""
    end = description.solve.until or motion.duration
    words = f"{motion.kind}{moved}, {motion.duration:g} s"
    words += f", run to {end:g} s" if end != motion.duration else ""
    if mechanism.report.mobility > len(mechanism.motors):
        return words, []
    try:
        nominal(mechanism, motion, np.linspace(0.0, end, _ALONG_MOTION))
    except SceneError as error:
        return f"{words}: cannot be followed", [f"motion: {error}"]
    return f"{words}: the rigid mechanism can follow it", []
