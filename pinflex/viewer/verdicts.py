"""What a viewer of a run must know before believing the picture, in a few words each."""

from __future__ import annotations

import re
from typing import Any

from pinflex.results.result import Result

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
