"""Motions of several moves, each with a start of its own: a path with rounded corners.

Every move is a polynomial of ninth degree (`nonic`), and moves add up: while two overlap the path
turns the corner. Four rates are continuous throughout: smooth enough for `command`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.boundary import public
from pinflex.description import laws
from pinflex.description import motion_keys as keys
from pinflex.description.laws import Kinematics
from pinflex.description.schema import shown
from pinflex.description.trajectory import Motion
from pinflex.errors import nearest

_KEYS = ("joints", "platform", "start", "duration")
_ACROSS, _LIFT = 0.2, 0.4  # of the time of one way: when the move across begins; a move up or down


@public
def moves(*, moves: Sequence[Mapping[str, Any]], duration: float | None = None) -> Motion:
    """Moves that add up, each {platform | joints: {name: displacement}, start [s], duration [s]}.

    Args:
        moves: Relative displacements [rad | m], with start (default 0) and duration.
        duration: Of all, with rest at the end [s]; None: the end of the last move.
    """
    if isinstance(moves, str | Mapping) or not isinstance(moves, Sequence) or not moves:
        raise keys.bad(
            "moves.moves",
            f"{shown(moves)} is no list of moves. Write [{{platform: {{x: 0.1}}, duration: 1}}].",
        )
    read = [_move(one, f"moves.moves[{k}]") for k, one in enumerate(moves)]
    target = read[0][0]
    for k, (other, *_) in enumerate(read):
        if other != target:
            raise keys.bad(f"moves.moves[{k}]", f"moves {other}, the first {target}. Take one.")
    names = tuple(dict.fromkeys(name for _, by_name, _, _ in read for name in by_name))
    delta = np.array([[by_name.get(name, 0.0) for name in names] for _, by_name, _, _ in read])
    start, each = (np.array([row[k] for row in read]) for k in (2, 3))
    last = float(np.max(start + each))
    n = keys.options("moves", "duration", duration=duration)
    if n.setdefault("duration", last) < last:
        raise keys.bad(
            "moves.duration", f"{n['duration']:g} s, but the last move ends at {last:g} s."
        )
    spec = {"kind": "moves", **n, "moves": [
        {target: by_name, "start": s, "duration": d} for _, by_name, s, d in read
    ]}  # fmt: skip
    law = partial(_sum, delta, start, each)
    corners = tuple(np.unique([*start, *(start + each)]).tolist())
    return Motion("moves", target, names, n["duration"], law, False, spec, corners)


@public
def adept(
    *,
    duration: float,
    width: float = 0.305,
    height: float = 0.025,
    across: str = "x",
    up: str = "z",
    held: Sequence[str] | None = None,
    back: bool = False,
) -> Motion:
    """The Adept cycle: 25 mm up, 305 mm across, 25 mm down, with rounded corners; the platform's.

    Up and down take 0.4 of the time each, across the 0.6 in the middle.

    Args:
        duration: Of one way [s].
        width, height: [m]; negative ones go the other way.
        across, up: Coordinates of the platform: x, y or z.
        held: Coordinates that stay; None: the third of x, y, z.
        back: Whether the same way back follows.
    """
    n = keys.options("adept", duration=duration)
    sizes = {"width": width, "height": height}
    size = {key: keys.number(x, f"adept.{key}", "m", "length") for key, x in sizes.items()}
    for key, name in (("across", across), ("up", up)):
        if name not in "xyz" or len(name) != 1:
            raise keys.bad(f"adept.{key}", f"{shown(name)} is no direction.{nearest(name, 'xyz')}")
    if across == up:
        raise keys.bad("adept.across", f"{across} is up too. Take two of x, y, z.")
    if not isinstance(back, bool):
        raise keys.bad("adept.back", f"{shown(back)} is not allowed. Allowed: true, false.")
    still = [c for c in "xyz" if c not in (across, up)] if held is None else held
    rest = keys.names(still, "platform", "adept.held") if len(still) else ()
    T = n["duration"]
    rows = [
        {"platform": {across: 0.0, up: size["height"]} | dict.fromkeys(rest, 0.0),
         "start": 0.0, "duration": _LIFT * T},
        {"platform": {across: size["width"]}, "start": _ACROSS * T,
         "duration": (1.0 - 2.0 * _ACROSS) * T},
        {"platform": {up: -size["height"]}, "start": (1.0 - _LIFT) * T, "duration": _LIFT * T},
    ]  # fmt: skip
    if back:
        rows += [_reversed(row, 2.0 * T) for row in reversed(rows)]
    spec = {"kind": "adept", **n, **size, "across": across, "up": up, "held": list(rest)}
    return replace(moves(moves=rows), kind="adept", spec=spec | {"back": back})


def _reversed(row: Mapping[str, Any], end: float) -> dict[str, Any]:
    """A move taken back, mirrored in time about half of `end` (s)."""
    taken = {name: -x for name, x in row["platform"].items()}
    return {"platform": taken, "start": end - row["start"] - row["duration"],
            "duration": row["duration"]}  # fmt: skip


def _move(one: Any, where: str) -> tuple[str, dict[str, float], float, float]:
    """Target, displacements, start and duration of a move."""
    if not isinstance(one, Mapping):
        raise keys.bad(where, f"{shown(one)} is no move. Write {{platform: {{x: 0.1}}, ...}}.")
    for key in one:
        if key not in _KEYS:
            raise keys.bad(f"{where}.{key}", f"no such key of a move.{nearest(str(key), _KEYS)}")
    if "duration" not in one:
        raise keys.bad(f"{where}.duration", "missing. Give the time of the move in s.")
    target, by_name, _ = keys.moves_of(one.get("joints"), one.get("platform"), where)
    n = keys.options(where, start=one.get("start", 0.0), duration=one["duration"])
    return target, by_name, n["start"], n["duration"]


def _sum(delta: Array, start: Array, duration: Array, t: Array) -> Kinematics:
    total = [np.zeros((len(t), delta.shape[1])) for _ in range(3)]
    for one, begin, time in zip(delta, start, duration, strict=True):
        moved = laws.move(laws.nonic, one, float(time), np.maximum(t - begin, 0.0))
        for sum_, part in zip(total, moved, strict=True):
            sum_ += part
    return total[0], total[1], total[2]
