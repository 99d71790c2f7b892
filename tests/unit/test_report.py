"""A report is records with units: its text scales them, its other forms keep SI.

Claims:
    Layout
    - a report: cells, units and gaps of its text; JSON and DataFrame in SI units; HTML escaped |
      typed by hand | exact | exact
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from pinflex.report import Listing, Report, bullets, lines, table

SAG = table(
    "Sag <of> two links",
    [{"link": "upper", "sag": 2.5e-4, "stress": 3.2e7}, {"link": "upper", "sag": None,
                                                         "stress": 1e6}],
    "link", ("sag [mm]", "sag"), ("stress [MPa]", "stress"), names=(8,), once=True,
)  # fmt: skip
PAGE = Report("arm", ("A sentence.", SAG, bullets(["one", "two"], "Notes"), "", lines("")))


def test_text_has_the_units_of_the_heads_and_a_name_once() -> None:
    # by hand: 2.5e-4 m = 0.25 mm, 3.2e7 Pa = 32 MPa
    assert SAG.text().splitlines() == [
        "Sag <of> two links",
        "-----------------------------",
        "link   sag [mm]  stress [MPa]",
        "-----------------------------",
        "upper    0.2500         32.00",
        "              -         1.000",
        "-----------------------------",
    ]
    assert PAGE.text() == f"A sentence.\n\n{SAG.text()}\n\nNotes\n- one\n- two\n"


def test_machines_get_si_units() -> None:
    assert PAGE.plain() == [json.loads(json.dumps(SAG.plain()))]
    frame = PAGE.tables()["Sag <of> two links"].to_pandas()
    assert frame["sag"][0] == 2.5e-4 and frame["stress"].sum() == 3.3e7
    assert frame.attrs["units"] == {"link": "", "sag": "m", "stress": "Pa"}


def test_a_card_has_the_same_cells_and_no_markup_of_others() -> None:
    shown = PAGE.html()
    assert "Sag &lt;of&gt; two links" in shown and "<of>" not in shown
    assert all(f">{cell}<" in shown for cell in ("0.2500", "32.00", "sag [mm]"))


def test_what_is_empty_leaves_no_gap() -> None:
    @dataclass(frozen=True)
    class Row:
        name: str

    empty = table("None", list[Row](), "name")
    assert Report("", (empty, "x", bullets([], "Notes"), [empty, ""])).text() == "x\n"
    assert Listing({"base": "world", "load": ""}, 6).text() == "  base  world"
