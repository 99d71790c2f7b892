"""`pinflex verify`: published benchmarks on this machine, measured against their references."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

from pinflex.errors import DescriptionError, PinflexError, nearest
from pinflex.lab import beams, elastica, loops, simeon, springs
from pinflex.lab.scene import Case, Check, Outcome, Picture
from pinflex.text import paragraph, table
from pinflex.threads import one_blas_thread
from pinflex.writing import write_text

# Published benchmarks as scenes built from a few numbers, for `pinflex verify`.

CASES: tuple[Case, ...] = (
    *beams.CASES,
    *loops.CASES,
    *loops.FOUR_BARS,
    *springs.CASES,
    *simeon.CASES,
    *springs.TILTED,
    *springs.FLYING,
    *beams.ARM_CASES,
    *elastica.CASES,
    *elastica.PRINCETON,
)


@dataclass(frozen=True, kw_only=True)
class Record(Check):
    """One quantity of one benchmark; measured is nan if the case failed.

    Attributes:
        case: Benchmark. source: Where its reference is from. seconds: Time of all of it.
    """

    case: str
    source: str
    seconds: float

    @property
    def mark(self) -> str:
        """ok, off (known to be outside its limit) or FAILED."""
        return "ok" if self.passed else "off" if self.reported else "FAILED"


@dataclass(frozen=True)
class Verification:
    """All records, and the pictures of their cases."""

    records: tuple[Record, ...]
    pictures: tuple[Picture, ...]

    @property
    def passed(self) -> bool:
        """Whether every record passed, but for those known not to."""
        return all(r.passed or r.reported for r in self.records)

    def to_json(self) -> list[dict[str, Any]]:
        """The records as plain mappings."""
        return [asdict(r) | {"error": r.error, "passed": r.passed} for r in self.records]


@one_blas_thread()
def verify(
    names: Sequence[str] = (),
    progress: Callable[[str, int, int], None] | None = None,
    slow: bool = False,
    ended: Callable[[str], None] | None = None,
) -> Verification:
    """Run benchmarks; a case that raises gives one record that did not pass."""
    chosen = _chosen(names, slow)
    records: list[Record] = []
    pictures: list[Picture] = []
    for k, case in enumerate(chosen):
        if progress is not None:
            progress(case.name, k, len(chosen))
        found, picture = _run(case)
        records += found
        if ended is not None:
            ended(case_text(case.name, found))
        pictures += [picture] if picture is not None else []
    return Verification(tuple(records), tuple(pictures))


def _chosen(names: Sequence[str], slow: bool) -> list[Case]:
    """Cases whose names hold one of the given parts; slow ones on request, or if alone."""
    for name in names:
        if not any(name.lower() in case.name.lower() for case in CASES):
            raise DescriptionError(
                f"verify: {name}: no such case.{nearest(name, (c.name for c in CASES), 30)}"
            )
    chosen = [c for c in CASES if any(n.lower() in c.name.lower() for n in names or [""])]
    # Slow ones alone were asked for by name.
    return chosen if slow else [c for c in chosen if not c.slow] or chosen


def _run(case: Case) -> tuple[list[Record], Picture | None]:
    began, none = time.perf_counter(), float("nan")
    try:
        outcome = case.run()
    except PinflexError as error:
        outcome = Outcome([Check("runs to its end", none, none, 0.0, False, str(error))])
    told: dict[str, Any] = {
        "case": case.name,
        "source": case.source,
        "seconds": time.perf_counter() - began,
    }
    return [Record(**vars(check), **told) for check in outcome.checks], outcome.picture


# Text --------------------------------------------------------------------------------------------


def case_text(name: str, records: Sequence[Record]) -> str:
    """The table of one case, and what there is to say about what did not pass."""
    first = records[0]
    rows = [[r.mark, r.quantity, *_figures(r)] for r in records]
    head = f"{name}   [{first.source}; {first.seconds:.1f} s]"
    header = "|quantity|measured|reference|error|limit"
    notes: dict[str, list[str]] = {}
    for r in records:
        if r.note and not r.passed:
            notes.setdefault(r.note, []).append(r.quantity)
    said = [paragraph(f"{', '.join(who)}: {note}", "  ") for note, who in notes.items()]
    return "\n\n".join([table(head, header, rows, (6, 46)), *said])


def verdict(found: Verification) -> str:
    """The last line: how many passed, in what time."""
    good = sum(r.passed for r in found.records)
    seconds = sum(records[0].seconds for _, records in _by_case(found.records))
    off = sum(r.mark == "off" for r in found.records)
    words = "all within their limits" if found.passed else "SOME ARE OUTSIDE THEIR LIMITS"
    if off and found.passed:
        words = f"the other {off} are known to be outside their limits, as noted"
    return f"{good} of {len(found.records)} quantities passed in {seconds:.0f} s: {words}."


def _figures(r: Record) -> list[str]:
    error = f"{r.error:.1e}" if r.error else "0"
    limit = f"{r.tolerance:g}"
    return [f"{r.measured:.8g}", f"{r.reference:.8g}", error, limit]


def _by_case(records: Iterable[Record]) -> list[tuple[str, list[Record]]]:
    groups: dict[str, list[Record]] = {}
    for record in records:
        groups.setdefault(record.case, []).append(record)
    return list(groups.items())


# Page --------------------------------------------------------------------------------------------

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 66rem; padding: 0 1rem;
       color: #1c2733; background: #fff }
table { border-collapse: collapse; width: 100%; margin: .4rem 0 1.6rem }
th, td { text-align: left; padding: .25rem .6rem; border-bottom: 1px solid #dde3ea }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums }
.ok { color: #1a7f4b } .no { color: #b3261e; font-weight: 600 }
small { color: #5b6b7b } img { max-width: 100% }
@media (prefers-color-scheme: dark) {
  body { background: #12181f; color: #dfe7ef } th, td { border-color: #2c3947 }
  small { color: #93a4b5 } img { background: #fff } .ok { color: #5ccf93 } .no { color: #ff8a80 } }
"""


def write_page(found: Verification, path: str | Path) -> Path:
    """Write one self-contained HTML page: tables, and plots of measured against reference."""
    from pinflex.recovery.meta import version

    path = Path(path)
    good = sum(r.passed for r in found.records)
    parts = [
        '<!doctype html><html lang="en"><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width">',
        f"<title>pinflex verify</title><style>{_STYLE}</style>",
        f"<h1>pinflex {escape(version())} against published benchmarks</h1>",
        f"<p>{good} of {len(found.records)} quantities within their limits.</p>",
    ]
    for name, records in _by_case(found.records):
        parts.append(f"<h2>{escape(name)}</h2><p><small>{escape(records[0].source)}; "
                     f"{records[0].seconds:.1f} s</small></p>")  # fmt: skip
        parts.append(
            "<table><tr><th></th><th>quantity</th><th class=n>measured</th><th class=n>reference"
            "</th><th class=n>error</th><th class=n>limit</th></tr>"
        )
        parts += [_row(r) for r in records]
        parts.append("</table>")
    parts += [_figure(picture) for picture in found.pictures]
    return write_text(path, "\n".join(parts) + "</html>\n")


def _row(r: Record) -> str:
    mark = f'<td class="{"ok" if r.passed else "no"}">{r.mark.lower()}</td>'
    note = f"<br><small>{escape(r.note)}</small>" if r.note else ""
    cells = "".join(f"<td class=n>{escape(cell)}</td>" for cell in _figures(r))
    return f"<tr>{mark}<td>{escape(r.quantity)}{note}</td>{cells}</tr>"


def _figure(picture: Picture) -> str:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for line in picture.series:
        style: dict[str, Any] = (
            {"marker": "o", "linestyle": "none", "markersize": 5} if line.reference else {}
        )
        axes.plot(line.x, line.y, label=line.label, **style)
    axes.set_title(picture.title)
    axes.set_xlabel(picture.x)
    axes.set_ylabel(picture.y)
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    image = io.BytesIO()
    figure.savefig(image, format="png", dpi=110)
    data = base64.b64encode(image.getvalue()).decode()
    return f'<img alt="{escape(picture.title)}" src="data:image/png;base64,{data}">'
