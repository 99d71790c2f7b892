"""Advice as text for people."""

from __future__ import annotations

from math import isfinite

from pinflex.advice.proposal import Advice, error_bar
from pinflex.results.verdict import criterion
from pinflex.text import bullets, paragraph, percent, report, table

_DOES = {
    "rigid": "no link has to bend",
    "quasistatic": "links bend, but do not vibrate",
    "ked": "linear vibration",
    "coupled": "everything",
}


def write(a: Advice, model: str | None = None, whole: bool = True) -> str:
    """Proposal, error bars, how to follow it; and the price of what is out."""
    n, rich, kept = a.coordinates
    far = max(a.error.values(), default=0.0)
    missed = a.used(a.error) > 1.0
    most = error_bar(far) if far > 1.0 else f"up to {error_bar(far)}"
    reached = f"NOT REACHED: error bars {most}" if missed else "reached"
    of = f" (levels: model of {rich} coordinates)" if a.levels else ""
    deflection = f", deflection within {percent(a.tol)}" * ("deflection" in a.asked)
    return report(
        paragraph(f"{a.name}: {reached}.")
        + "\n"
        + paragraph(f"Suffices: {criterion(a.tol, a.band)}{deflection}."),
        f"Proposal: level {a.level} ({_DOES[a.level]})"
        + (f", {kept} elastic coordinates ({n} as loaded)" if a.level != "rigid" else ""),
        paragraph(_command(a, model or a.name), "      ", "  "),
        paragraph(a.why, "     ", "why: ") if a.why else "",
        _bars(f"Error bars (twice what was measured) of time integration and model{of}", a),
        _left_out(a) if whole else _sentence(a),
        bullets(a.notes),
    )


def _command(a: Advice, model: str) -> str:
    changes = [*a.overrides, *([] if a.run_tol is None else [f"solve.tol={a.run_tol:g}"])]
    return f"pinflex solve {model} --level {a.level}" + "".join(f" --set {x}" for x in changes)


def _bars(title: str, a: Advice) -> str:
    """Levels that were measured, and the proposal."""
    known = {name: e for name, e in a.levels.items() if all(map(isfinite, e.values()))}
    rows = known | ({"the proposal": a.error} if all(map(isfinite, a.error.values())) else {})
    if not rows:
        return ""
    outputs = list(next(iter(rows.values())))
    cells = [[name, *(error_bar(error[k]) for k in outputs)] for name, error in rows.items()]
    cells.append(["allowed", *(percent(a.allowed.get(k, a.tol)) for k in outputs)])
    missing = [name for name in a.levels if name not in known]
    rest = f"\nNot measured: {', '.join(missing)}." if missing else ""
    return table(title, "|".join(["level", *outputs]), cells, (18,)) + rest


def _sentence(a: Advice) -> str:
    """What is left out, in words."""
    out = [x.what for x in a.left_out if x.out]
    if not a.left_out:
        return ""
    return paragraph(f"Left out: {', '.join(out) or 'nothing'}. -v says what each costs.")


def _left_out(a: Advice) -> str:
    if not a.left_out:
        return ""
    outputs = list(a.left_out[0].error)
    rows = [
        ["out" if x.out else "kept", x.what, *(_price(x.error[k]) for k in outputs)]
        for x in a.left_out
    ]
    header = "|".join(["", "what", *outputs])
    return table("What leaving it out costs, relative", header, rows, (4, 44))


def _price(x: float) -> str:
    # Below this it is round-off of the comparison: nothing excites it.
    return "not excited" if x < 1e-9 else f"{x:.1e}"
