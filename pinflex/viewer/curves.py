"""Curves of a run over time: the platform's path, how far it is from rigid, torques, stress."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from pinflex.arrays import Array, IntArray
from pinflex.results.lazy import Late, read_only
from pinflex.results.result import Result
from pinflex.results.views import Deviation
from pinflex.rotations import rotation_vector
from pinflex.viewer.frames import FrameLocator

RIGID_TORQUE = "rigid/torque"  # array of a flexible run that was compared with the rigid one


def with_rigid_torque(run: Result, rigid: Result) -> Result:
    """The run with the torques of the same motion without elasticity beside its own."""
    if not run.motors or run.motors != rigid.motors or run is rigid:
        return run
    beside = read_only(_at(rigid, "torque", run.t), RIGID_TORQUE)
    return Result(run.t, Late({**run.arrays, RIGID_TORQUE: beside}, {}), run.meta)


def track(
    result: Result, rigid: Result | None, off_path: Deviation | None = None
) -> dict[str, Any] | None:
    """Path of the platform (or of the tip that moves most) and how far it is from rigid."""
    name, angle = result.meta.get("platform"), np.zeros(len(result.t))
    if name and f"frame/{name}/position" in result.arrays:
        position = result.arrays[f"frame/{name}/position"]
        other, turned = _rigid_platform(result, rigid, name)
        turn = result.arrays.get(f"frame/{name}/rotation")
        if turn is not None and turned is not None:
            angle = np.linalg.norm(rotation_vector(turn @ np.swapaxes(turned, 1, 2)), axis=1)
    elif result.links:
        name, position, other = _furthest_tip(result)
    else:
        return None
    other = position if other is None else other
    disp = position - other
    deviation = np.linalg.norm(disp, axis=1)
    if off_path is not None:
        deviation, angle = off_path.norm, off_path.angle
    path = {"name": name, "rigid": other, "disp": disp, "deviation": deviation, "angle": angle}
    path["off"] = "rigid" if off_path is None else "path"
    fine, finer = deviation.max() < 1e-5, angle.max() < 1e-4
    path |= {"factor": 1e6, "unit": "µm"} if fine else {"factor": 1e3, "unit": "mm"}
    path |= {"angle_factor": 1e6 if finer else 1e3, "angle_unit": "µrad" if finer else "mrad"}
    return path


def _rigid_platform(
    result: Result, rigid: Result | None, name: str
) -> tuple[Array | None, Array | None]:
    """Positions (nt, 3) and rotations (nt, 3, 3) of the platform were the robot rigid."""
    if rigid is None or f"frame/{name}/position" not in rigid.arrays:
        return FrameLocator(result).rigid_frame(name)
    position = _at(rigid, f"frame/{name}/position", result.t)
    same = len(rigid.t) == len(result.t)
    return position, rigid.arrays.get(f"frame/{name}/rotation") if same else None


def _furthest_tip(result: Result) -> tuple[str, Array, Array]:
    """Name, path and rigid path (nt, 3) of the link's end that moves most."""
    ends = {n: result.arrays[f"link/{n}/centreline"][:, -1] for n in result.links}
    rigid = {
        n: result.arrays.get(f"link/{n}/centreline_rigid", result.arrays[f"link/{n}/centreline"])[
            :, -1
        ]
        for n in result.links
    }
    link = max(ends, key=lambda n: float(np.abs(ends[n] - rigid[n]).max()))
    return f"tip of {link}", ends[link], rigid[link]


def plots(
    result: Result,
    rigid: Result | None,
    stress: dict[str, Array],
    path: dict[str, Any] | None,
    keep: IntArray,
) -> list[dict[str, Any]]:
    """Plots under the time bar: {title, unit, curves}."""
    panels = _torques(result, rigid, keep)
    if path is not None and float(path["deviation"].max()) > 0.0:
        curve = _curve(path["name"], path["factor"] * path["deviation"][keep], 0)
        title = f"{path['name']} off {path['off']}"
        panels.append({"title": title, "unit": path["unit"], "curves": [curve], "deviation": True})
    if stress:
        curves = [_curve(n, 1e-6 * s[keep], i) for i, (n, s) in enumerate(stress.items())]
        panels.append({"title": "peak von Mises", "unit": "MPa", "curves": curves})
    return panels


def _torques(result: Result, rigid: Result | None, keep: IntArray) -> list[dict[str, Any]]:
    """Torques in one plot, forces in another, each with its rigid counterpart."""
    torque, still = result.arrays.get("torque"), result.arrays.get(RIGID_TORQUE)
    if rigid is not None and rigid.motors == result.motors and "torque" in rigid.arrays:
        still = _at(rigid, "torque", result.t)
    panels: dict[str, dict[str, Any]] = {}
    for i, name in enumerate(result.motors if torque is not None else ()):
        unit = result.unit(f"torque/{name}") or "N m"
        title = "motor force" if unit == "N" else "motor torque"
        plot = panels.setdefault(unit, {"title": title, "unit": unit, "curves": []})
        for values, is_rigid in ((torque, False), (still, True)):
            if values is not None:
                plot["curves"].append(_curve(name, values[keep, i], i, is_rigid))
    return list(panels.values())


def _curve(name: str, y: Array, colour: int, rigid: bool = False) -> dict[str, Any]:
    return {"name": name, "y": y, "colour": colour, "rigid": rigid}


def _at(result: Result, key: str, t: Array) -> Array:
    """An array of another run at the instants t, linear in between; shape (nt, n)."""
    values = result.arrays[key]
    return np.stack([np.interp(t, result.t, column) for column in values.T], axis=1)


# What a viewer of a run must know before believing the picture, in a few words each.

BAD, CARE, PLAIN = "bad", "care", "plain"
_GRADES = {"closure": "loops open", "energy": "energy balance"}
_WORDS = {"closure": "leaves its loops open", "energy": "energy balance"}  # of their warnings
_STRAIGHT = "started straight under gravity"  # as a comparison remarks


def verdicts(result: Result) -> list[dict[str, str]]:
    """Verdicts of a run, worst first: {kind, text, why}."""
    found = [*_ended(result), *_warned(result), *_grades(result), *_model(result)]
    order = (BAD, CARE, PLAIN)
    return sorted(found, key=lambda v: order.index(v["kind"]))


def _ended(result: Result) -> list[dict[str, str]]:
    """An early end: no equilibrium, or no solution of the equations."""
    status = str(result.meta.get("status", "complete"))
    if status == "complete":
        return []
    message = str(result.meta.get("message", ""))
    falls = "buckle" in message or "no equilibrium" in message
    what = "buckles or falls" if falls else status
    return [_verdict(BAD, f"{what} at {result.t[-1]:.4g} s", message)]


def _grades(result: Result) -> list[dict[str, str]]:
    """Closures and energy that are not good, each with the warning about it."""
    found = []
    for key, grade in _poor(result).items():
        why = next((text for text in _warnings(result) if _WORDS[key] in text), "")
        found.append(_verdict(BAD if grade == "wrong" else CARE, f"{_GRADES[key]}: {grade}", why))
    return found


def _poor(result: Result) -> dict[str, str]:
    """Grades that are not good."""
    grades: dict[str, str] = result.meta.get("grades") or {}
    return {key: grade for key, grade in grades.items() if grade != "good"}


def _warnings(result: Result) -> list[str]:
    return [str(text) for text in result.meta.get("warnings", ())]


def _warned(result: Result) -> list[dict[str, str]]:
    """Remarks and warnings, shortened to what matters; those that a grade tells are left out."""
    told = [_WORDS[key] for key in _poor(result)]
    remarks = [x for x in str(result.meta.get("remark") or "").split("; ") if x and x != _STRAIGHT]
    rest = [text for text in _warnings(result) if not any(words in text for words in told)]
    found = [_verdict(BAD, text.partition(":")[0], text) for text in remarks]
    return found + [_in_short(text) for text in rest]


def _in_short(warning: str) -> dict[str, str]:
    if "buckle" not in warning:
        return _verdict(CARE, warning, warning)
    when = re.match(r"t = (\S+ s):", warning)
    return _verdict(BAD, f"buckles from {when[1]} on" if when else warning, warning)


def _model(result: Result) -> list[dict[str, str]]:
    """How the level sees the motion, and how it starts."""
    found = []
    settings: dict[str, Any] = result.meta.get("settings") or {}
    if settings.get("start") == "straight":
        why = "The links are undeformed at first: loads that act at once make them ring."
        rings = _STRAIGHT in str(result.meta.get("remark") or "")
        found.append(_verdict(CARE if rings else PLAIN, "straight start", why))
    if result.level == "ked":
        why = "Small vibrations about the rigid motion: buckling and large bends are not seen."
        found.append(_verdict(PLAIN, "linear", why))
    if result.level == "quasistatic":
        found.append(_verdict(PLAIN, "no vibration", "In balance at every instant."))
    return found


def _verdict(kind: str, text: str, why: str) -> dict[str, str]:
    return {"kind": kind, "text": text, "why": why}
