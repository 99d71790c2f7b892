"""A scene in a few numbers: what a table of many scenes has in the row of each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from pinflex.actuation.drive import nominal
from pinflex.advice.solve import solve
from pinflex.description.description import Description
from pinflex.description.solve import LEVELS
from pinflex.errors import DescriptionError, SceneError, nearest
from pinflex.levels.outputs import platform_poses
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.results.comparison import StressRow, cost_row, farthest, stress_row
from pinflex.results.quantities import joint_unit
from pinflex.results.result import Result, peak, rms
from pinflex.solver.solve import default_motion
from pinflex.studies.checking.check import first_frequencies

Beside = Callable[[Result, Result | None], Mapping[str, float]]
OUTPUTS = ("torque", "deviation", "stress", "frequency", "cost", "validity")
_FREQUENCIES = 6
_UNITS = {
    "mass": "kg",
    "sag": "m",
    "deviation.peak": "m",
    "deviation.position": "m",
    "deviation.rotation": "rad",
    "stress.peak": "Pa",
    "stress.x": "m",
    "stress.t": "s",
    "cost.seconds": "s",
}


def check_outputs(names: Iterable[str], level: str | None) -> tuple[str, ...]:
    """The wanted groups in the order of `OUTPUTS`; unknown ones and levels are named."""
    wanted = list(names)
    for name in wanted:
        if name not in OUTPUTS:
            raise DescriptionError(f"outputs: {name}: no such output.{nearest(name, OUTPUTS)}")
    if not wanted:
        raise DescriptionError(f"outputs: none. Take some of {', '.join(OUTPUTS)}.")
    if level is not None and level not in LEVELS:
        raise DescriptionError(f"level: {level}: no such level.{nearest(level, LEVELS)}")
    return tuple(name for name in OUTPUTS if name in wanted)


def scene_outputs(
    mechanism: Mechanism,
    level: str | None = None,
    wanted: Iterable[str] = OUTPUTS,
    rigid: Result | None = None,
    beside: Beside | None = None,
    options: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Any]:
    """Numbers, flags and texts of one scene, SI units; what does not exist is left out.

    `options`: arguments of `solve`.

    Returns:
        torque.peak.MOTOR, torque.rms.MOTOR (N m | N); deviation.position (m) and .rotation (rad):
        the largest of the platform from the rigid run; stress.peak (Pa), stress.link, stress.x (m),
        stress.t (s); stress.yield: over the strength, the most of any link; frequency.1 to 6 (Hz),
        at home, motors locked, negative where unstable; cost.seconds (s), .steps, .newton;
        validity.within_theory and .below_yield (flags), .energy_balance, .worst_closure,
        .warnings.
    """
    groups = set(wanted)
    found: dict[str, Any] = {}
    if groups - {"frequency"}:
        run = solve(mechanism, level=level, **{"asked": _asked(mechanism, groups), **options})
        away: Mapping[str, float] = {}
        if "deviation" in groups:
            if rigid is None and (beside is not None or not _nominal(mechanism)):
                rigid = _rigid(mechanism, run, options)
            away = _deviation(mechanism, run, rigid, options)
        found = _groups_of(mechanism, run, groups, away)
        found |= {} if beside is None else beside(run, rigid)
    if "frequency" in groups:
        frequencies, _ = first_frequencies(mechanism, _FREQUENCIES)
        found |= {f"frequency.{i}": f for i, f in enumerate(frequencies, 1)}
    return found


def _asked(mechanism: Mechanism, groups: set[str]) -> tuple[str, ...] | None:
    """What a tolerance has to hold for some groups of numbers; None: as the YAML says.

    Stresses need all that a tolerance can hold; torques and poses alone cost half as much.
    """
    if mechanism.description.solve.asked or groups & {"stress", "validity"}:
        return None
    held = {"torque": "torque", "deviation": "platform"}
    return tuple(held[group] for group in ("torque", "deviation") if group in groups) or None


def prismatic(description: Description) -> frozenset[str]:
    """Motors that push: their outputs are forces."""
    tree = description.tree()
    motors = description.actuated
    return frozenset(
        name for name in motors if name in tree.joints and tree.joints[name].type == "prismatic"
    )


def unit(name: str, slides: frozenset[str] = frozenset(), motors: Sequence[str] = ()) -> str:
    """Unit of an output as a heading says it, "" where it has none; `motors`: where it is of all.

    Those of `scene_outputs`, and of `pinflex.variation.evaluator`.
    """
    head, _, rest = name.partition(".")
    if head == "torque":
        of = [rest.partition(".")[2]] if "." in rest else motors
        return " | ".join(dict.fromkeys(joint_unit("torque", motor in slides) for motor in of))
    if head == "stiffness":
        return "N m/rad" if rest.startswith("r") else "N/m"
    return "Hz" if head == "frequency" else _UNITS.get(name, "")


def _rigid(mechanism: Mechanism, run: Result, options: Mapping[str, Any]) -> Result | None:
    """The rigid run at the same instants; none for a rigid run, or if the motors do not fix it."""
    if run.level == "rigid" or mechanism.description.platform is None:
        return None
    try:
        same = {key: options[key] for key in ("motion", "until", "samples") if key in options}
        return solve(mechanism, level="rigid", **same)
    except SceneError:
        return None


def _nominal(mechanism: Mechanism) -> bool:
    """Whether the nominal motion is the rigid run: of that no torques are needed."""
    prescribed = mechanism.description.solve.drive == "prescribed"
    return prescribed and mechanism.report.mobility == len(mechanism.motors)


def _deviation(
    mechanism: Mechanism, run: Result, rigid: Result | None, options: Mapping[str, Any]
) -> dict[str, float]:
    """How far the platform is off the rigid run at most; without one, off the nominal motion."""
    frame = mechanism.description.platform
    if run.level == "rigid" or frame is None:
        return {}
    if rigid is not None:
        away = run.deviation_from(rigid, frame)
    elif not _nominal(mechanism):
        return {}
    else:
        moved = options.get("motion") or default_motion(mechanism)
        try:
            path = nominal(mechanism, moved, run.t)
        except SceneError:
            return {}
        poses = platform_poses(mechanism, Equations(mechanism.rigid, marched=True), path.q)
        away = run.frame(frame).away_from(*poses)
    place = farthest("run", frame, away)
    return {"deviation.position": place.position, "deviation.rotation": place.rotation}


def _groups_of(
    mechanism: Mechanism, run: Result, groups: set[str], away: Mapping[str, float]
) -> dict[str, Any]:
    """The groups of a run; of poses, forces and stresses only what they need is found."""
    found: dict[str, Any] = {**(_torques(run) if "torque" in groups else {}), **away}
    stresses: list[StressRow] = []
    if groups & {"stress", "validity"}:
        known = yield_strengths(mechanism)
        stresses = [stress_row("run", run, link, known.get(link)) for link in run.links]
    if "stress" in groups and stresses:
        found |= _stress(stresses)
    if "cost" in groups:
        cost = cost_row("run", run, None)
        found |= {f"cost.{name}": getattr(cost, name) for name in ("seconds", "steps", "newton")}
    return found | (_validity(run, stresses) if "validity" in groups else {})


def _torques(run: Result) -> dict[str, float]:
    columns = dict(zip(run.motors, run.torque.T, strict=True))
    found = {f"torque.peak.{motor}": peak(torque) for motor, torque in columns.items()}
    return found | {f"torque.rms.{motor}": rms(torque) for motor, torque in columns.items()}


def _stress(stresses: list[StressRow]) -> dict[str, Any]:
    worst = max(stresses, key=lambda row: row.von_mises)
    return {
        "stress.peak": worst.von_mises, "stress.link": worst.link, "stress.x": worst.x,
        "stress.t": worst.time, "stress.yield": _yield(stresses),
    }  # fmt: skip


def _yield(stresses: list[StressRow]) -> float | None:
    """Largest stress over strength of any link; None where no strength is known."""
    shares = [row.yield_share for row in stresses if row.yield_share is not None]
    return max(shares, default=None)


def _validity(run: Result, stresses: list[StressRow]) -> dict[str, Any]:
    share = _yield(stresses)
    return {
        "validity.within_theory": not run.meta["limits"],
        "validity.below_yield": None if share is None else share <= 1.0,
        "validity.energy_balance": run.meta["energy_balance"],
        "validity.worst_closure": run.worst_closure,
        "validity.warnings": " | ".join(run.meta["warnings"]),
    }


def yield_strengths(mechanism: Mechanism) -> dict[str, float]:
    """Strength [Pa] of the links whose material has one."""
    return {
        name: part.spec.material.yield_strength
        for name, part in mechanism.parts.items()
        if part.spec.material.yield_strength is not None
    }
