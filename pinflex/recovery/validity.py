"""Validity of a run: monitors of the limits of the theory, and warnings beyond them.

Bodies are right to second order in their own deflection; without `second_order` they miss the
stiffness that axial forces bring. Each monitor is a number without unit: small is safe.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from pinflex.arrays import Array, distinct
from pinflex.bodies.basis import FlexibleBody
from pinflex.description.robots.urdf import limits
from pinflex.integrators.problem import Run
from pinflex.linalg import eigh
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.mechanism import Mechanism
from pinflex.mechanics.model.loads import Slot
from pinflex.mechanics.model.parts import FlexiblePart
from pinflex.mechanics.model.tree import sliding
from pinflex.recovery.links import deflections
from pinflex.text import frozen, percent

# Second-order bodies are right to O((w/L)^2) of the curvature: 1 % at a tenth.
DEFLECTION = 0.1
# A section turned by this has cos = 1 - 2 %: what the same theory leaves out.
ROTATION = 0.2  # [rad]
# A linear body's stiffness is off by the square of speed over frequency: 6 % at a quarter.
SPEED = 0.25
# ... and by compression over buckling load: 10 % of the stiffness at a tenth.
COMPRESSION = 0.1
# What the fastest shape of a link carries, those left out carry too, within a factor.
FASTEST = 0.05
_TOUCH = 1e-6  # [rad | m]: decimals of a file; a motion to the limit itself is inside
_INSTANTS = 200  # enough to meet every peak of a smooth motion within a per cent


@frozen
class Monitors:
    """Largest values over a run of one flexible link.

    Attributes:
        deflection: Of one body, over its length. rotation: Of one body's end section, rad.
        speed: Angular speed over the first clamped frequency: 1 is where a linear body diverges.
        compression: Axial compression over the Euler load of the link with hinged ends.
        fastest: Kinetic energy of the fastest bending mode of the clamped link over the largest
            elastic kinetic energy of the run, in the worse plane: does the basis suffice?
        when: Time of the first instant with speed above 1 (s), or None.
    """

    deflection: float
    rotation: float
    speed: float
    compression: float
    fastest: float
    when: float | None


def monitors(
    mechanism: Mechanism, run: Run, arrays: Mapping[str, Array], spins: Mapping[int, Array]
) -> dict[str, Monitors]:
    """Monitors of every flexible link of a run, by name; empty for a rigid run."""
    if not run.system.n_eta:
        return {}
    every = distinct(np.linspace(0, len(run.t) - 1, min(_INSTANTS, len(run.t))).astype(int))
    M = Equations(run.system).mass(run.y[0])
    ends = {}
    for slot in run.system.expansion.slots:
        if id(slot.body) not in ends:
            x = np.linspace(0.0, slot.body.length, 9)[1:]
            ends[id(slot.body)] = slot.body.fields(x)["deflection"]
    found = {}
    for name, part in mechanism.parts.items():
        slots = [s for s in run.system.expansion.slots if s.link == name]
        deflection = rotation = 0.0
        for slot in slots:
            eta = run.y[:, int(run.system.rigid.nq) :][:, slot.eta]
            moved = np.einsum("xrk,tk->txr", ends[id(slot.body)], eta, optimize=True)
            bent = np.linalg.norm(moved[:, :, :3], axis=2)
            deflection = max(deflection, float(np.max(bent, initial=0.0)) / slot.body.length)
            rotation = max(rotation, float(np.max(np.abs(moved[:, -1, 3:]), initial=0.0)))
        fast = np.max([spins[s.root.joint][every] for s in slots], axis=0) / first_frequency(part)
        beyond = np.flatnonzero(fast > 1.0)
        key = f"link/{name}/resultant"
        push = -float(np.min(arrays[key][:, :, 0], initial=0.0)) if key in arrays else 0.0
        when = float(run.t[every[beyond[0]]]) if len(beyond) else None
        speed = float(np.max(fast, initial=0.0))
        fastest = max((_fastest(run, slot, M) for slot in slots), default=0.0)
        found[name] = Monitors(deflection, rotation, speed, push / euler_load(part), fastest, when)
    return found


def _fastest(run: Run, slot: Slot, M: Array) -> float:
    """Share of the fastest bending mode of a body in its elastic kinetic energy; M: all rows."""
    start = int(run.system.rigid.nv) + slot.eta.start
    parts, totals = [0.0], np.zeros(len(run.t))
    for plane, inside in slot.body.slices.items():
        at = slice(start + inside.start, start + inside.stop)
        if plane not in ("v", "w") or inside.stop - inside.start < 2:
            continue
        try:
            shapes = eigh(slot.body.K[inside, inside], M[at, at])[1]
        except np.linalg.LinAlgError:  # shapes without mass of their own
            continue
        energy = (run.v[:, at] @ M[at, at] @ shapes) ** 2
        parts.append(float(np.max(energy[:, -1], initial=0.0)))
        totals += energy.sum(axis=1)
    total = float(np.max(totals, initial=0.0))
    return max(parts) / total if total > 0 else 0.0


def first_frequency(part: FlexiblePart) -> float:
    """Lowest bending frequency of a link clamped at its root, rad/s (inf if it does not bend)."""
    if part.share is not None and len(part.bodies) == 1:  # much of the link may ride on the beam
        return _ridden_frequency(part.bodies[0])
    stiffness = _stiffness(part)
    rho = part.spec.material.rho or 0.0
    if stiffness is None or rho <= 0:
        return float("inf")
    per_length = rho * part.spec.section.A
    return float(1.8751040687**2 * np.sqrt(stiffness / (per_length * part.length**4)))


def _ridden_frequency(body: FlexibleBody) -> float:
    """The same of a body whose mass matrix has what rides on it, plane by plane."""
    planes = [body.slices[d] for d in ("v", "w") if d in body.slices]
    lowest = [eigh(body.K[p, p], body.M[p, p], vectors=False)[0][0] for p in planes]
    return float(np.sqrt(min(lowest, default=np.inf)))


def euler_load(part: FlexiblePart) -> float:
    """Buckling load of a link with hinged ends, N (inf if it does not bend)."""
    stiffness = _stiffness(part)
    return float("inf") if stiffness is None else float(np.pi**2 * stiffness / part.length**2)


def _stiffness(part: FlexiblePart) -> float | None:
    section, E = part.spec.section, part.spec.material.E
    ways = {"v": section.Iz, "w": section.Iy}
    bending = [E * ways[d] for d in part.planes if d in ways]
    return min(bending) if bending else None


def _passed(part: FlexiblePart, m: Monitors) -> Iterator[str]:
    """Limits that one link passes."""
    name, second = part.link, part.spec.second_order
    if not np.isfinite(m.deflection) or m.deflection > DEFLECTION or m.rotation > ROTATION:
        yield (
            f"{name}: deflection is {percent(m.deflection)} of the length and "
            f"{m.rotation:.2g} rad in one of {len(part.bodies)} segment(s), beyond what one "
            f"carries; raise flexible.{name}.segments."
        )
    if m.fastest > FASTEST:
        yield (
            f"{name}: the fastest of its shapes carries {percent(m.fastest)} of its elastic "
            "kinetic energy, so that those left out matter too; raise the number of shapes "
            f"in flexible.{name}.basis (internal, elements or modes)."
        )
    if not second and m.speed > SPEED:
        grows = "" if m.when is None else f" and it runs away from t = {m.when:.4g} s on"
        yield (
            f"{name}: turns at {m.speed:.2g} of its first frequency without second order: its "
            f"stiffness is wrong by {percent(m.speed**2)}{grows}; set "
            f"flexible.{name}.second_order: true."
        )
    if not second and m.compression > COMPRESSION:
        yield (
            f"{name}: compressed by {percent(m.compression)} of its Euler load without second "
            f"order, which does not see buckling; set flexible.{name}.second_order: true."
        )
    elif m.compression > 1.0:
        yield (
            f"{name}: compressed by {percent(m.compression)} of its Euler load: it buckles "
            f"unless its ends hold it; cut it (flexible.{name}.segments) or stiffen it."
        )


def beyond_joint_limits(mechanism: Mechanism, run: Run) -> list[str]:
    """One sentence for each joint, motor or not, that the motion takes beyond the URDF's limits."""
    known, model = limits(mechanism.description.urdf_text), mechanism.rigid.rigid
    slides, texts = sliding(model), list[str]()
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        limit = known.get(name)
        if limit is None or joint.nq != 1 or limit.lower >= limit.upper:
            continue
        q = run.y[:, joint.idx_q]
        beyond = np.maximum(q - limit.upper, limit.lower - q)
        k = int(np.argmax(beyond))
        if beyond[k] <= _TOUCH:
            continue
        first = float(run.t[int(np.argmax(beyond > _TOUCH))])
        end, unit = (
            limit.upper if q[k] > limit.upper else limit.lower,
            "m" if name in slides else "rad",
        )
        texts.append(
            f"{name}: leaves the URDF's limits at {first:.4g} s: it reaches {q[k]:.4g} {unit} at "
            f"{run.t[k]:.4g} s, beyond {end:g} {unit}. Change the motion, home or the limit."
        )
    return texts


def warnings(mechanism: Mechanism, run: Run, found: dict[str, Monitors]) -> list[str]:
    """One sentence for each link and limit that the run passes, with what to change."""
    texts = [text for name, m in found.items() for text in _passed(mechanism.parts[name], m)]
    if run.system.closed.n and run.settings.get("gamma") == 0.5:
        texts.append(
            "no numerical dissipation (rho_inf: 1, or newmark: [0.5, 0.25]): loop forces may "
            "zig-zag from step to step and grow; take rho_inf: 0.9 or less, or a larger gamma."
        )
    return texts


# Closures and energy of a run in words, good, look or wrong, by one rule for everybody.

GOOD, LOOK, WRONG = "good", "look", "wrong"
# Loops open by these shares of the largest deflection say that deflections are not small, of which
# level ked knows nothing. Below 1e-9 m or rad there is nothing to see.
_OPEN, _SHUT = (0.05, 0.2), 1e-9
# Of the largest energy in play: a per cent or two is numerical damping, more is a wrong answer.
_ENERGY = (0.02, 0.05)


def grades(run: Run, arrays: Mapping[str, Array], balance: float | None) -> dict[str, str]:
    """Grades of "closure" and "energy" of a run, where there is something to say."""
    found = {}
    if run.system.closed.n:
        found["closure"] = GOOD if _gap(arrays) < _SHUT else _word(_open_share(run, arrays), _OPEN)
    marches = run.work is not None or run.path is not None
    if balance is not None and marches and len(run.t) > 4:
        found["energy"] = _word(balance - _unseen(run, arrays), _ENERGY)
    return found


def sentences(
    run: Run, arrays: Mapping[str, Array], balance: float, found: Mapping[str, str]
) -> list[str]:
    """One for each that is not good, with what to do."""
    texts, linear = [], run.path is not None
    if found.get("closure", GOOD) != GOOD:
        why, bent = "it is linear, and " if linear else "", 1e3 * _deflection(run)
        trust = "Trust coupled." if linear else "Take shorter steps."
        texts.append(
            f"leaves its loops open by up to {1e3 * _gap(arrays):.3g} mm ({found['closure']}): "
            f"{why}deflections of {bent:.3g} mm are not small here. {trust}"
        )
    if found.get("energy", GOOD) != GOOD:
        way = (
            ", as it is linear, or its steps are long: hold it against coupled."
            if linear
            else f" ({found['energy']}). Use a smaller step (--set solve.dt=...), or less "
            "numerical damping."
        )
        texts.append(f"keeps the energy balance to {100 * balance:.2g} % only{way}")
    return texts


def _word(value: float, limits: tuple[float, float]) -> str:
    return GOOD if value <= limits[0] else LOOK if value <= limits[1] else WRONG


def _gap(arrays: Mapping[str, Array]) -> float:
    return float(np.max(np.abs(arrays["residual/closure"]), initial=0.0))


def _deflection(run: Run) -> float:
    """Largest deflection of any link, m."""
    found = deflections(Equations(run.system), run.y).values()
    return max((float(np.max(np.abs(d), initial=0.0)) for _, d in found), default=0.0)


def _open_share(run: Run, arrays: Mapping[str, Array]) -> float:
    deflection = _deflection(run)
    return _gap(arrays) / deflection if deflection > 0 else 0.0


def _unseen(run: Run, arrays: Mapping[str, Array]) -> float:
    """Relative error of the work from the sampled power: by every other instant (trapezia)."""
    if run.work is not None:
        return 0.0
    power = np.sum(run.torque * run.v[:, run.system.motors], axis=1)

    def total(k: slice) -> float:
        return float(np.trapezoid(power[k], run.t[k]))

    even = len(power) - 1 - (len(power) - 1) % 2
    apart = abs(total(slice(0, even + 1)) - total(slice(0, even + 1, 2))) / 3.0
    parts = [
        float(np.ptp(arrays[f"energy/{k}"])) for k in ("kinetic", "gravity", "elastic", "work")
    ]
    return apart / max([*parts, 1e-15])
