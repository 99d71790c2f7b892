"""The advice itself: a proposal and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite

from pinflex.advice.reduced_models import Errors, LeftOut
from pinflex.cards import Worded
from pinflex.results.verdict import BAND, criterion
from pinflex.text import brief, bullets, paragraph, percent, report, table


def error_bar(e: float) -> str:
    """An error bar in words: beyond the whole output it says only that nothing is right."""
    return "over 100 %" if 1.0 < e < inf else percent(e)


@dataclass(frozen=True)
class Advice(Worded):
    """A proposal and what it rests on.

    Attributes:
        name: Of the scene. tol: Relative error that every output asked for may have.
        asked: Some of torque, deflection, platform.
        band: Distance of the platform that does no harm [m].
        allowed: Errors that may be, by output: more than `tol` where they are within the band.
        level: rigid, quasistatic, ked or coupled.
        run_tol: `solve.tol` of the run (levels quasistatic and coupled), or None.
        overrides: "key=value" changes of the YAML, for `load` or --set.
        error: Error bar of each output if the proposal is followed.
        levels: Error bar of each output at each level of the richer model.
        left_out: Planes, modes and links that were tried.
        coordinates: Elastic coordinates: as loaded, of the richer model, proposed.
        why: The reason for the level.
        notes: What weakens the advice.
        seconds: What it cost.
    """

    __repr__ = brief

    name: str
    tol: float
    asked: tuple[str, ...]
    level: str = "coupled"
    band: float = BAND
    allowed: Errors = field(default_factory=dict)
    run_tol: float | None = None
    overrides: tuple[str, ...] = ()
    error: Errors = field(default_factory=dict)
    levels: dict[str, Errors] = field(default_factory=dict)
    left_out: tuple[LeftOut, ...] = ()
    coordinates: tuple[int, int, int] = (0, 0, 0)
    why: str = ""
    notes: tuple[str, ...] = ()
    seconds: float = 0.0

    def used(self, error: Errors) -> float:
        """The largest error, each as a share of what is allowed.

        Args:
            error: By output.
        """
        return max((e / self.allowed.get(k, self.tol) for k, e in error.items()), default=0.0)

    def text(self) -> str:
        """Proposal, how to follow it, its error bars, and the price of what is left out."""
        return write(self)


# Advice as text for people.

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
