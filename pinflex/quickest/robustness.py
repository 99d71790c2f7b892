"""What a motion does where payload, stiffness or friction are not those that it was made for."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinflex.advice.solve import solve
from pinflex.description.description import Description
from pinflex.description.motions.motion import Motion
from pinflex.description.reading.parameters import parameters
from pinflex.errors import DescriptionError, nearest
from pinflex.mechanics.evaluation.equations import share
from pinflex.mechanics.mechanism import Mechanism, load

# The same robot with another payload, or stiffer and softer: what one motion has to suit.

KINDS = ("payload", "stiffness", "friction")
_SPRINGS = ("flexible.*.material.E", "joints.*.drive.stiffness", "joints.*.spring")
_FRICTION = ("joints.*.friction.*", "joints.*.drive.friction.*", "joints.*.damper")


def varied(mechanism: Mechanism, kind: str, factor: float) -> Mechanism:
    """The robot with its payload, stiffness or friction times a factor.

    Raises:
        DescriptionError: It has none.
    """
    if kind not in KINDS:
        raise DescriptionError(f"robust: {kind}.{nearest(kind, KINDS)}")
    description = mechanism.description
    if kind == "payload":
        return load(_loaded(description, factor))
    found, many = description, 0
    for pattern in _SPRINGS if kind == "stiffness" else _FRICTION:
        try:
            found, numbers = parameters(found, [pattern])
        except DescriptionError:
            continue
        changes = [c for one in numbers for c in one.overrides(one.value * factor)]
        found, many = found.with_overrides(changes), many + len(numbers)
    if not many:
        raise DescriptionError(
            f"{mechanism.name}: robust: {kind}: the YAML says no number of it. Write one, or leave "
            "it out."
        )
    return load(found)


def corners(robust: Mapping[str, float | Sequence[float]]) -> list[dict[str, float]]:
    """Factors of the models beside the nominal one: opposite ends, where frequencies differ most.

    A heavier payload and softer links lower frequencies, so these two go together. A list gives
    factors one by one.
    """
    for name, given in robust.items():
        if name not in KINDS:
            raise DescriptionError(f"robust: {name}.{nearest(name, KINDS)}")
        for one in given if isinstance(given, Sequence) else [given]:
            if isinstance(one, bool) or not isinstance(one, int | float) or not 0.0 < one < 2.0:
                raise DescriptionError(
                    f"robust: {name}: {one!r}. Give a share, 0.2 for 20 %, or factors, [0.8, 1.2]."
                )
    found = [{name: float(x)} for name, many in robust.items() if isinstance(many, Sequence)
             for x in many]  # fmt: skip
    shares = {name: x for name, x in robust.items() if not isinstance(x, Sequence)}
    down = {"payload": 1.0, "stiffness": -1.0, "friction": -1.0}
    for sign in (-1.0, 1.0) if shares else ():
        found.append({name: 1.0 + sign * down[name] * x for name, x in shares.items()})
    return found


def variant(mechanism: Mechanism, factors: Mapping[str, float]) -> Mechanism:
    """The robot with several of them."""
    found = mechanism
    for kind, factor in factors.items():
        found = varied(found, kind, factor)
    share(mechanism, found, alike=True)
    return found


def _loaded(description: Description, factor: float) -> Description:
    """The payload of the YAML, or the rigid link that the platform is on, with its mass scaled."""
    block = description.blocks().get("payload")
    if isinstance(block, dict) and "mass" in block:
        _, found = parameters(description, ["payload.mass"])
        return description.with_overrides(found[0].overrides(found[0].value * factor))
    root = ET.fromstring(description.urdf_text.strip())
    link = _with_mass(root, str(description.platform))
    if link is None:
        raise DescriptionError(
            f"{description.name}: robust: payload: no link with a mass carries the platform. "
            "Write `payload` in the YAML."
        )
    for element, keys in (
        ("mass", ("value",)),
        ("inertia", ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
    ):
        part = link.find(f"inertial/{element}")
        for key in keys:
            if part is not None and part.get(key) is not None:
                part.set(key, repr(float(str(part.get(key))) * factor))
    return replace(description, urdf_text=ET.tostring(root, encoding="unicode"))


def _with_mass(root: ET.Element, name: str) -> ET.Element | None:
    """The link of a name that has a mass, or the one that carries it by fixed joints."""
    links = {link.get("name"): link for link in root.findall("link")}
    parents = {
        joint.find("child").get("link"): joint.find("parent").get("link")  # type: ignore[union-attr]
        for joint in root.findall("joint")
        if joint.get("type") == "fixed"
    }
    here: str | None = name
    while here is not None:
        link = links.get(here)
        mass = None if link is None else link.find("inertial/mass")
        if mass is not None and float(str(mass.get("value"))) > 0.0:
            return link
        here = parents.get(here)
    return None


_SHARE = 0.05
_TOL = 1e-4  # of the runs
_SAMPLES = 801


@dataclass(frozen=True)
class Off:
    """One robot that is off.

    Attributes:
        what: In words, such as "payload +5 %".
        error: Largest distance of its platform from that of the nominal robot, at any time [m].
        shake: Largest peak-to-peak motion of it along an axis after the end [m].
    """

    what: str
    error: float
    shake: float


def robustness(
    mechanism: Mechanism, motion: Motion, until: float, end: float, part: float = _SHARE
) -> tuple[Off, ...]:
    """Runs of the nominal robot and of those that are off by a share, both ways.

    Quantities that the model does not have are left out.
    """
    frame = str(mechanism.description.platform)

    def place(model: Mechanism) -> tuple[np.ndarray, np.ndarray]:
        run = solve(model, motion, level="coupled", start="static", tol=_TOL, until=until,
                    samples=_SAMPLES)  # fmt: skip
        return run.frame(frame).position, run.t >= end

    nominal, after = place(mechanism)
    rows = [Off("as modelled", 0.0, float(np.ptp(nominal[after], axis=0).max()))]
    for kind in KINDS:
        for sign in (-1.0, 1.0):
            try:
                model = variant(mechanism, {kind: 1.0 + sign * part})
            except DescriptionError:
                continue  # the model says no such number
            found, _ = place(model)
            error = float(np.linalg.norm(found - nominal, axis=1).max())
            what = f"{kind} {100 * sign * part:+.0f} %"
            rows.append(Off(what, error, float(np.ptp(found[after], axis=0).max())))
    return tuple(rows)
