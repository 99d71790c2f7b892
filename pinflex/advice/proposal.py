"""The advice itself: a proposal and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite

from pinflex.advice.reduced_models import Errors, LeftOut
from pinflex.report import Block, Report, Reported, bullets, lines, table
from pinflex.results.verdict import BAND, criterion
from pinflex.text import brief, percent


def error_bar(e: float) -> str:
    """An error bar in words: beyond the whole output it says only that nothing is right."""
    return "over 100 %" if 1.0 < e < inf else percent(e)


@dataclass(frozen=True)
class Advice(Reported):
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

    def as_report(self) -> Report:
        """Proposal, how to follow it, its error bars, and the price of what is left out."""
        return report(self)


# The report of an advice.

_DOES = {
    "rigid": "no link has to bend",
    "quasistatic": "links bend, but do not vibrate",
    "ked": "linear vibration",
    "coupled": "everything",
}


def report(a: Advice, model: str | None = None, whole: bool = True) -> Report:
    """Proposal, error bars, how to follow it; and the price of what is out."""
    n, rich, elastic = a.coordinates
    far = max(a.error.values(), default=0.0)
    missed = a.used(a.error) > 1.0
    most = error_bar(far) if far > 1.0 else f"up to {error_bar(far)}"
    reached = f"NOT REACHED: error bars {most}" if missed else "reached"
    of = f" (levels: model of {rich} coordinates)" if a.levels else ""
    deflection = f", deflection within {percent(a.tol)}" * ("deflection" in a.asked)
    return Report(f"{a.name}: advice", (
        (f"{a.name}: {reached}.", f"Suffices: {criterion(a.tol, a.band)}{deflection}."),
        f"Proposal: level {a.level} ({_DOES[a.level]})"
        + (f", {elastic} elastic coordinates ({n} as loaded)" if a.level != "rigid" else ""),
        lines(_command(a, model or a.name), indent="      ", first="  "),
        lines(a.why, indent="     ", first="why: "),
        _bars(f"Error bars (twice what was measured) of time integration and model{of}", a),
        _left_out(a) if whole else _sentence(a),
        bullets(a.notes),
    ))  # fmt: skip


def _command(a: Advice, model: str) -> str:
    changes = [*a.overrides, *([] if a.run_tol is None else [f"solve.tol={a.run_tol:g}"])]
    return f"pinflex solve {model} --level {a.level}" + "".join(f" --set {x}" for x in changes)


def _bars(title: str, a: Advice) -> Block:
    """Levels that were measured, and the proposal."""
    known = {name: e for name, e in a.levels.items() if all(map(isfinite, e.values()))}
    rows = known | ({"the proposal": a.error} if all(map(isfinite, a.error.values())) else {})
    if not rows:
        return ""
    outputs = list(next(iter(rows.values())))
    allowed = {k: percent(a.allowed.get(k, a.tol)) for k in outputs}
    records = [{"level": name, **error} for name, error in rows.items()]
    columns = [(k, k, lambda e: e if isinstance(e, str) else error_bar(e)) for k in outputs]
    missing = [name for name in a.levels if name not in known]
    return (
        table(title, [*records, {"level": "allowed", **allowed}], "level", *columns, names=(18,)),
        f"Not measured: {', '.join(missing)}." if missing else "",
    )


def _sentence(a: Advice) -> str:
    """What is left out, in words."""
    out = [x.what for x in a.left_out if x.out]
    if not a.left_out:
        return ""
    return f"Left out: {', '.join(out) or 'nothing'}. -v says what each costs."


def _left_out(a: Advice) -> Block:
    outputs = list(a.left_out[0].error) if a.left_out else []
    columns = [(k, lambda x, k=k: x.error[k], _price) for k in outputs]
    return table(
        "What leaving it out costs, relative", a.left_out,
        ("", lambda x: "out" if x.out else "kept"), "what", *columns, names=(4, 44),
    )  # fmt: skip


def _price(x: float) -> str:
    # Below this it is round-off of the comparison: nothing excites it.
    return "not excited" if x < 1e-9 else f"{x:.1e}"
