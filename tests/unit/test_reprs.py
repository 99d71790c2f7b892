"""What a notebook shows of an object is one line."""

from __future__ import annotations

import dataclasses
from typing import Any

import pinflex as pf
from pinflex.studies.check import check


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


def test_every_repr_is_one_short_line() -> None:
    robot = pf.load("3rrr")
    rigid, run = (
        pf.solve(robot, level=level, until=0.02, samples=5, dt=1e-3)
        for level in ("rigid", "coupled")
    )
    objects = [
        robot, run, run.joint("motor_1"), run.frame("platform"), run.loop("pin_2"),
        run.link("distal_1"), run.deviation_from(rigid, "platform"), pf.modes(robot),
        pf.static_equilibrium(robot), check(robot), pf.hold(duration=1.0),
        pf.comparison(rigid, {"coupled": run}),
    ]  # fmt: skip
    every = _parts(objects)
    assert len({type(x) for x in every}) > 30
    for x in every:
        shown = repr(x)
        assert len(shown) < 200, type(x)
        assert "\n" not in shown
    assert "3rrr" in repr(robot)
    assert "3rrr" in repr(run)
    assert str(run).count("\n") > 3  # print(run) still says what it did
