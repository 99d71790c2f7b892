"""What a notebook shows of an object: one line, or a small card.

Claims:
    Equations
    - every repr is one line | - | 200 characters | 180
    - cards of a notebook: each of 17 types, names escaped, long ones cut | - | 20 kB | 2.9 kB
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.quickest.limits import Limits
from pinflex.report import card, grid, pairs, words
from pinflex.results.pose_map import Columns

MOVE = pf.quintic(platform={"x": 0.02, "y": 0.0, "rz": 0.0}, duration=0.1)
LINE, CARD = 200, 20_000  # characters of a repr and of a card


def _parts(start: list[Any]) -> list[Any]:
    """Every object of pinflex that hangs on some objects."""
    todo, seen, found = list(start), set(), []
    while todo:
        x = todo.pop()
        if id(x) in seen:
            continue
        seen.add(id(x))
        if dataclasses.is_dataclass(x) or type(x).__module__.startswith("pinflex"):
            found.append(x)
            todo += list(getattr(x, "__dict__", {}).values())
        elif isinstance(x, (list, tuple)):
            todo += x
        elif isinstance(x, dict):
            todo += x.values()
    return found


@pytest.fixture(scope="module")
def objects() -> list[Any]:
    robot = pf.load("3rrr")
    rigid, run = (
        pf.solve(robot, level=level, until=0.02, samples=5, dt=1e-3)
        for level in ("rigid", "coupled")
    )
    vary = {"flexible.*.section.thickness": (1e-3, 3e-3)}
    return [
        robot, run, run.joint("motor_1"), run.frame("platform"), run.loop("pin_2"),
        run.link("distal_1"), run.deviation_from(rigid, "platform"), pf.modes(robot),
        pf.static_equilibrium(robot), pf.check(robot), pf.hold(duration=1.0),
        pf.comparison(rigid, {"coupled": run}), pf.command(robot, MOVE, "quasistatic"),
        pf.Advice("3rrr", 1e-2, ("torque",), error={"torque": 0.002}),
        pf.linearise(robot), robot.joints, robot.frames,
        robot.links, robot.joints["motor_1"], run.joints, run.links, run.loops,
        pf.sensitivities(robot, [*vary], ["mass"]), pf.design(robot, "mass", vary, starts=1),
        pf.sweep(robot, {"flexible.*.section.thickness": [1e-3, 2e-3]}, level="rigid",
                 outputs=["torque"]),
        pf.pose_map(robot, {"x": [0.0, 0.01]}, count=2),
        pf.frequency_response(robot), robot.description, *_others(robot, run),
        pf.retime(robot, MOVE, {"velocity": 1}), MOVE.at_rate(1000, robot), robot.limits,
    ]  # fmt: skip


def _others(robot: pf.Mechanism, run: pf.Result) -> list[Any]:
    """Objects whose making takes long, with numbers that nobody measured."""
    one, name = np.ones(1), "flexible.*.section.thickness"
    table = Columns({"stress.peak": one}, {"stress.peak": "Pa"})
    control = pf.Control((pf.Travel("motor_1"),), (pf.Effort("motor_1"),), pf.pid(kp=1.0))
    fit = pf.Fit(
        (name,), one, one, np.ones((1, 2)), np.ones((1, 2)), (True,), ((),), ((False, False),),
        False, np.eye(1), np.zeros(2), True, 1, (), "", (), 3, robot.description,
    )  # fmt: skip
    scatter = pf.Scatter(
        table, (), ("stress.peak",), np.ones((1, 3)), one, one, *[np.ones((1, 0))] * 4
    )
    study = pf.Study(robot, {"coupled": run}, {}, {}, pf.comparison(None, {"coupled": run}))
    sensor = pf.Deflection("distal_1", 0.1)
    drives = [pf.Travel("a"), pf.Effort("a"), pf.Voltage("p")]
    sensors = [pf.Encoder("a"), pf.StrainGauge("b", 0.1), pf.Imu("tool")]
    limits = Limits(1.0, 1.0, 1.0, one, one, one)
    fastest = pf.Fastest(
        "a", "joints", {"b": 1.0}, 0.1, 0.1, 1e-5, 1e-6, 1e-9, {}, {}, 0.09, limits, MOVE,
        {"nominal": run}, {"nominal": robot}, None, "tool", np.ones(3),
    )  # fmt: skip
    margins = pf.Margins("a", ())
    return [
        fastest,
        control,
        fit,
        margins,
        scatter,
        study,
        sensor,
        *drives,
        *sensors,
        pf.Simulator(robot),
    ]


def test_every_public_class_is_among_them(objects: list[Any]) -> None:
    every = [getattr(pf, name) for name in pf.__all__]
    classes = {x for x in every if isinstance(x, type) and not issubclass(x, BaseException)}
    assert classes <= {type(x) for x in objects}


def test_every_repr_is_one_short_line(objects: list[Any]) -> None:
    every = _parts(objects)
    assert len({type(x) for x in every}) > 40
    for x in every:
        shown = repr(x)
        assert len(shown) < LINE, type(x)
        assert "\n" not in shown
    robot, run = objects[:2]
    assert "3rrr" in repr(robot)
    assert "3rrr" in repr(run)
    assert str(run).count("\n") > 3  # print(run) still says what it did


CARDS = (
    *("Mechanism", "Result", "JointView", "FrameView", "LinkView", "LoopView", "Deviation"),
    *("Modes", "Columns", "Advice", "Command", "Comparison", "Check", "Design", "Sensitivities"),
    *("Fit", "Scatter", "Study", "Motion", "PoseMap"),
)


def test_a_notebook_shows_a_small_card_of_each(objects: list[Any]) -> None:
    shown = {type(x).__name__: x._repr_html_() for x in objects if hasattr(x, "_repr_html_")}
    assert shown.keys() >= set(CARDS)
    for name, page in shown.items():
        assert 100 < len(page) < CARD, name
        assert page.startswith("<div") and page.endswith("</div>"), name
        assert page.count("<table>") == page.count("</table>"), name
    assert "distal_1" in shown["Modes"] and "coupled" in shown["Comparison"]


def test_cards_escape_every_name_and_cut_what_is_long() -> None:
    nasty = "<script>alert(1)</script>"
    page = card(nasty, pairs([(nasty, nasty)]), grid([nasty], [[nasty]] * 50), words(nasty))
    assert "<script" not in page and page.count("&lt;script&gt;") == 1 + 2 + 1 + 12 + 1
    assert "38 more rows" in page
    assert len(card("x" * 10_000, words("y\n" * 10_000))) < CARD
