"""The reference of output keys: every array that a result may hold, from the table of the code."""

from __future__ import annotations

from pinflex.results.quantities import KEYS

_INTRO = """# Arrays of a result

`run["KEY"]` is the array, `run.plot("KEY")` draws it over time, `run.unit("KEY")` says its unit,
and `dict(run.arrays)` has all that a run holds. Arrays are read-only, time first, SI units, angles
radians. NAME stands for the name of a joint, frame, link, drive, loop or actuator; nt for instants,
nx for stations along a link. Of a field along a link, `plot` draws the station where it is largest,
with the components of the last column.

The same by name, for one joint, frame or link: `run.joints["NAME"]`, `run.frames["NAME"]`,
`run.links["NAME"]`, `run.drives["NAME"]`, `run.loops["NAME"]`.
"""


def page() -> str:
    """A row for each key."""
    rows = [
        f"| `{one.key}` | {one.shape} | {_cell(one.unit)} | {_cell(one.meaning)} | "
        f"{' '.join(one.columns)} |"
        for one in KEYS
    ]
    head = ["| key | shape | unit | meaning | components |", "|---|---|---|---|---|"]
    return "\n".join([_INTRO, *head, *rows]) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "or").replace("<", "&lt;")
