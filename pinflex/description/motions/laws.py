"""The laws of time behind the motions: position, velocity and acceleration of t >= 0.

Module functions, bound by `functools.partial`, so that a Motion can be pickled.
"""

from __future__ import annotations

import ast
import csv
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinflex.arrays import Array
from pinflex.description.files import MOST_TABLE, require_regular
from pinflex.description.reading.schema import finite, measured, shown, within
from pinflex.errors import DescriptionError, nearest

SNAP = 1e-12  # [-] of the duration: a grid time that rounds to a switching instant is past it

Kinematics = tuple[Array, Array, Array]


def cycloid(u: Array) -> Kinematics:
    """s(u) = u - sin(2 pi u)/(2 pi) and its two derivatives."""
    w = 2.0 * np.pi
    return u - np.sin(w * u) / w, 1.0 - np.cos(w * u), w * np.sin(w * u)


def quintic(u: Array) -> Kinematics:
    """s(u) = 10 u^3 - 15 u^4 + 6 u^5 and its two derivatives."""
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    return s, 30.0 * (u * (1.0 - u)) ** 2, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)


def nonic(u: Array) -> Kinematics:
    """s(u) = 126 u^5 - 420 u^6 + 540 u^7 - 315 u^8 + 70 u^9: four rates vanish at both ends."""
    s = u**5 * (126.0 - u * (420.0 - u * (540.0 - u * (315.0 - 70.0 * u))))
    flat = u * (1.0 - u)
    return s, 630.0 * flat**4, 2520.0 * flat**3 * (1.0 - 2.0 * u)


def trapezoid(r: float, u: Array) -> Kinematics:
    """Speed 1/(1 - r) between ramps of length r; the acceleration is continuous from the right."""
    speed, past = 1.0 / (1.0 - r), u + SNAP
    rise, fall = 0.5 * speed / r * u**2, 1.0 - 0.5 * speed / r * (1.0 - u) ** 2
    s = np.where(u < r, rise, np.where(u < 1.0 - r, speed * (u - 0.5 * r), fall))
    ds = speed * np.minimum(1.0, np.minimum(u, 1.0 - u) / r)
    return s, ds, speed / r * ((past < r).astype(np.float64) - (past >= 1.0 - r))


def move(
    shape: Callable[[Array], Kinematics], delta: Array, duration: float, t: Array
) -> Kinematics:
    """delta s(t/T), then rest."""
    u = np.minimum(t / duration, 1.0)
    s, ds, dds = shape(u)
    on, rate = u < 1.0 - SNAP, delta / duration
    return np.outer(s, delta), np.outer(ds * on, rate), np.outer(dds * on, rate / duration)


def spin_up(speed: Array, duration: float, t: Array) -> Kinematics:
    """Speed along the cycloid s(t/T), so that the angle starts with its first three rates zero."""
    u = np.minimum(t / duration, 1.0)
    s, ds, _ = cycloid(u)
    turn = duration * (0.5 * u**2 + (np.cos(2.0 * np.pi * u) - 1.0) / (4.0 * np.pi**2))
    angle = turn + np.maximum(t - duration, 0.0)
    return np.outer(angle, speed), np.outer(s, speed), np.outer(ds, speed / duration)


def harmonic(amplitude: Array, omega: float, phase: float, smooth: float, t: Array) -> Kinematics:
    """f g: g = sin(omega t + phase) - sin(phase), f the quintic fade-in."""
    angle = omega * t + phase
    g, dg, ddg = np.sin(angle) - np.sin(phase), omega * np.cos(angle), -(omega**2) * np.sin(angle)
    if smooth > 0.0:
        f, df, ddf = quintic(np.minimum(t / smooth, 1.0))
        df, ddf = df / smooth, ddf / smooth**2
        g, dg, ddg = f * g, df * g + f * dg, ddf * g + 2.0 * df * dg + f * ddg
    return np.outer(g, amplitude), np.outer(dg, amplitude), np.outer(ddg, amplitude)


def circle(rest: Array, z0: complex, omega: float, ramp: float, t: Array) -> Kinematics:
    """rest, with z0 exp(i theta) on its first two columns; theta' rises to omega as a quintic."""
    theta, rate, gain = omega * t, np.full_like(t, omega), np.zeros_like(t)
    if ramp > 0.0:
        u = np.minimum(t / ramp, 1.0)
        s, ds, _ = quintic(u)
        turned = ramp * u**4 * (2.5 - 3.0 * u + u**2)  # integral of s over the ramp [s]
        theta = omega * (turned + np.maximum(t - ramp, 0.0))
        rate, gain = omega * s, omega * ds / ramp
    z = z0 * np.exp(1j * theta)
    p, v, a = (np.zeros((len(t), len(rest))) for _ in range(3))
    for out, x in ((p, z), (v, 1j * rate * z), (a, (1j * gain - rate**2) * z)):
        out[:, 0], out[:, 1] = x.real, x.imag
    return p + rest, v, a


def spline_law(spline: Any, last: float, periodic: bool, t: Array) -> Kinematics:
    """A spline with its derivatives, clamped at its end or repeated."""
    u = np.mod(t, last) if periodic else np.minimum(t, last)
    on = (t < last)[:, None] | periodic
    return spline(u), np.where(on, spline(u, 1), 0.0), np.where(on, spline(u, 2), 0.0)


# Formulas of time in a motion, such as "0.3*t^2", with their exact first two derivatives.
#
# A formula is walked as a syntax tree, never run as code, on jets: a jet is the value, the first
# and the second derivative of a quantity by time, shape (3, nt), and every operation keeps all
# three.

_CONSTANTS = {"pi": np.pi}


def _chain(x: Array, f: Array, df: Array, ddf: Array) -> Array:
    """f of a jet x, from f, f' and f'' at its value."""
    return np.array([f, df * x[1], ddf * x[1] ** 2 + df * x[2]])


def _of(name: str, x: Array) -> Array:
    """A function of a jet."""
    return _chain(x, *_FUNCTIONS[name](x[0]))


def _times(x: Array, y: Array) -> Array:
    second = x[2] * y[0] + 2.0 * x[1] * y[1] + x[0] * y[2]
    return np.array([x[0] * y[0], x[1] * y[0] + x[0] * y[1], second])


def _over(x: Array, y: Array) -> Array:
    return _times(x, _chain(y, 1.0 / y[0], -1.0 / y[0] ** 2, 2.0 / y[0] ** 3))


def _power(x: Array, y: Array) -> Array:
    if np.any(y[1:]) or np.ptp(y[0]):
        return _of("exp", _times(y, _of("log", x)))
    n = float(y[0].flat[0])
    if n in (0.0, 1.0):  # their derivatives must not divide by zero
        return x if n else np.array([np.ones_like(x[0]), 0.0 * x[0], 0.0 * x[0]])
    ddf = 2.0 * np.ones_like(x[0]) if n == 2.0 else n * (n - 1.0) * x[0] ** (n - 2.0)
    return _chain(x, x[0] ** n, n * x[0] ** (n - 1.0), ddf)


# Value, first and second derivative of each function of one number.
_FUNCTIONS: Mapping[str, Callable[[Array], tuple[Array, Array, Array]]] = {
    "sin": lambda x: (np.sin(x), np.cos(x), -np.sin(x)),
    "cos": lambda x: (np.cos(x), -np.sin(x), -np.cos(x)),
    "tan": lambda x: (np.tan(x), 1.0 / np.cos(x) ** 2, 2.0 * np.tan(x) / np.cos(x) ** 2),
    "atan": lambda x: (np.arctan(x), 1.0 / (1.0 + x**2), -2.0 * x / (1.0 + x**2) ** 2),
    "exp": lambda x: (np.exp(x), np.exp(x), np.exp(x)),
    "log": lambda x: (np.log(x), 1.0 / x, -1.0 / x**2),
    "sqrt": lambda x: (np.sqrt(x), 0.5 / np.sqrt(x), -0.25 / np.sqrt(x) ** 3),
}
_OPERATORS: Mapping[type, Callable[[Array, Array], Array]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: _times,
    ast.Div: _over,
    ast.Pow: _power,
}


def parse(text: object, where: str) -> ast.expr:
    """The checked syntax tree of a formula of t."""
    try:
        tree = ast.parse(str(text).replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise DescriptionError(
            f"{where}: {str(text)[:80]!r} is no formula. Write one of t, as in 0.3*t^2."
        ) from None
    called = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        _check(node, where, id(node) in called)
    return tree


def _check(node: ast.AST, where: str, called: bool) -> None:
    plain = (ast.BinOp, ast.UnaryOp, ast.Load, ast.USub, ast.UAdd, *_OPERATORS)
    number = isinstance(node, ast.Constant) and type(node.value) in (int, float)
    call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    if isinstance(node, ast.Call) and call and len(node.args) == 1 and not node.keywords:
        return
    if isinstance(node, ast.Name):
        known = tuple(_FUNCTIONS) if called else ("t", *_CONSTANTS)
        if node.id not in known:
            raise DescriptionError(f"{where}: {node.id}: unknown.{nearest(node.id, known)}")
    elif not number and not isinstance(node, plain):
        raise DescriptionError(
            f"{where}: {ast.unparse(node)[:80] if isinstance(node, ast.expr) else node!r} has no "
            f"place in a formula. Allowed: numbers, t, pi, + - * / ^, {', '.join(_FUNCTIONS)}."
        )


def evaluate(tree: ast.expr, t: Array) -> Array:
    """Value and first two derivatives at times t (s), shape (3, nt)."""
    with np.errstate(all="ignore"):
        return _jet(tree, np.array([t, np.ones_like(t), np.zeros_like(t)]))


def _jet(node: ast.expr, t: Array) -> Array:
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_jet(node.left, t), _jet(node.right, t))
    if isinstance(node, ast.UnaryOp):
        return _jet(node.operand, t) * (-1.0 if isinstance(node.op, ast.USub) else 1.0)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return _of(node.func.id, _jet(node.args[0], t))
    if isinstance(node, ast.Name) and node.id == "t":
        return t
    jet = np.zeros_like(t)
    jet[0] = finite(_CONSTANTS[node.id] if isinstance(node, ast.Name) else ast.literal_eval(node))
    return jet


# The keys of a motion, checked: numbers in range, names once, columns of a file.

PLATFORM_COORDINATES = ("x", "y", "z", "rz", "ry", "rx")
OPTIONS = {  # unit, range and quantity of the numbers a motion may have
    "duration": ("s", "above 0", "time"),
    "ramp": ("s", "0 or more", "time"),
    "start": ("s", "0 or more", "time"),
    "smooth": ("s", "0 or more", "time"),
    "speed": ("rad/s or m/s", "above 0", "rate"),
    "frequency": ("Hz", "above 0", "rate"),
    "omega": ("rad/s", "above 0", "rate"),
    "radius": ("m", "above 0", "length"),
    "phase": ("rad", "", "angle"),
}
Moves = Mapping[str, float] | None


def bad(where: str, text: str) -> DescriptionError:
    """An error at a key path."""
    return DescriptionError(f"{where}: {text}", where=where)


def number(value: Any, where: str, unit: str = "rad or m", of: str = "position") -> float:
    """A finite number in the range of its quantity."""
    try:  # YAML 1.1 reads 1e-3 as text, so text that is a number is one
        x = float("nan" if isinstance(value, bool) else measured(value, of))
    except (TypeError, ValueError, OverflowError):
        x = float("nan")
    if not np.isfinite(x):
        raise bad(where, f"{shown(value)} is not a finite number. Give a number in {unit}.")
    return within(x, where, of)


def options(kind: str, optional: str = "", **given: float | None) -> dict[str, float]:
    """The given numbers, each finite and in range; `optional` ones may be None and are left out."""
    out = {}
    for key, value in given.items():
        if value is not None or key not in optional.split():
            unit, least, quantity = OPTIONS[key]
            out[key] = x = number(value, f"{kind}.{key}", unit, quantity)
            if (x < 0.0 and least) or (x == 0.0 and least == "above 0"):
                raise bad(f"{kind}.{key}", f"{x:g} {unit} is out of range. It must be {least}.")
    return out


def numbers(value: Any, where: str) -> dict[str, float]:
    """A mapping of names to finite numbers."""
    if not isinstance(value, Mapping):
        raise bad(where, f"{shown(value)} is no mapping. Write {{name: number in rad or m}}.")
    return {str(name): number(x, f"{where}.{name}") for name, x in value.items()}


def names(value: Any, target: str, where: str) -> tuple[str, ...]:
    """The names; platform coordinates must exist, joints are checked against the model."""
    if isinstance(value, str) or not isinstance(value, (Sequence, Mapping)) or not value:
        raise bad(where, f"{shown(value)} is no list of names. Write [name, ...].")
    names = tuple(map(str, value))
    if len({*names}) < len(names):
        raise bad(where, f"{shown(value)} has a name twice. Name each once.")
    for name in names:
        if target == "platform" and name not in PLATFORM_COORDINATES:
            hint = nearest(name, PLATFORM_COORDINATES)
            raise bad(f"{where}.{name}", f"no such platform coordinate.{hint}")
    return names


def target_of(joints: Any, platform: Any, where: str) -> tuple[str, Any]:
    """Target and value: of `joints` and `platform` exactly one must be given."""
    if (joints is None) == (platform is None):
        given = "nothing moves" if joints is None else "both joints and platform are given"
        raise bad(where, f"{given}. Give one of joints: {{name: ...}}, platform: {{name: ...}}.")
    return ("joints", joints) if platform is None else ("platform", platform)


def moves_of(joints: Moves, platform: Moves, kind: str) -> tuple[str, dict[str, float], Array]:
    """Target, displacements by name, and these as an array."""
    target, value = target_of(joints, platform, kind)
    moves = numbers(value, f"{kind}.{target}")
    names(moves, target, f"{kind}.{target}")
    return target, moves, np.array(list(moves.values()))


def cells(lines: Iterable[str]) -> list[list[str]]:
    """The cells of each line of a CSV; parted by `;` or tabs, it has decimal commas or points."""
    rows = list(lines)
    sign = next((x for x in ";\t" if rows and x in rows[0] and "," not in rows[0]), ",")
    if sign != ",":
        rows = [row.replace(",", ".") for row in rows]
    return [next(csv.reader([row], delimiter=sign)) for row in rows]


def headed(cell: str) -> tuple[str, str]:
    """Name and unit of the head of a column, NAME [unit] or NAME (unit)."""
    unit = re.search(r"\[(.*)\]\s*$|\((.*)\)\s*$", cell)
    if unit is None:
        return cell.strip(), ""
    return cell[: unit.start()].strip(), (unit[1] or unit[2] or "").strip()


def table(file: Any, where: str = "sampled.file") -> dict[str, Any]:
    """Columns of a CSV file by the names in its first line; lines that start with # are skipped."""
    if not isinstance(file, (str, Path)):
        raise bad(where, f"{shown(file)} is no name of a file. Give a CSV file.")
    require_regular(Path(file), MOST_TABLE, f"{where}: {file}")
    try:
        lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
        rows = cells(x for x in lines if x.strip() and not x.startswith("#"))
        if len({len(row) for row in rows}) != 1:
            raise ValueError("its rows differ in length" if rows else "it is empty")
        head = [cell.strip() for cell in rows[0]]
        if len(set(head)) != len(head):
            raise ValueError(f"two columns have one name in {', '.join(head)}")
    except (OSError, TypeError, ValueError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise bad(where, f"cannot read {file}: {why}. Give a CSV file.") from error
    return {name: [row[j] for row in rows[1:]] for j, name in enumerate(head)}


def samples(table: dict[str, Any], name: str, where: str, times: Any = None) -> list[float]:
    """A column of numbers; as many as there are times, if times are given."""
    if name not in table:
        more = " Columns `time` and `NAME [deg]` are read by `kind: trajectory`."
        raise bad(where, f"no such column.{nearest(name, table)}{more if times is None else ''}")
    column = table[name]
    if not isinstance(column, (list, tuple, np.ndarray)):
        raise bad(where, f"{shown(column)} is no list of samples. Write [number, ...].")
    unit, of = ("s", "time") if times is None else ("rad or m", "position")
    y = [number(x, f"{where}[{i}]", unit, of) for i, x in enumerate(column)]
    if times is not None and len(y) != len(times):
        raise bad(where, f"{len(y)} samples for {len(times)} times. Give one to each time.")
    return y


def sampled_data(
    file: Any, t: Any, joints: Any, platform: Any, absolute: Any, periodic: Any
) -> tuple[str, tuple[str, ...], list[float], Array]:
    """Target, names, times [s] and samples, shape (nt, names), of the arguments of `sampled`."""
    for key, flag in (("absolute", absolute), ("periodic", periodic)):
        if not isinstance(flag, bool):
            raise bad(f"sampled.{key}", f"{shown(flag)} is not allowed. Allowed: true, false.")
    if (file is None) == (t is None):
        raise bad("sampled", "give either file: name.csv or t: [...] with the samples.")
    target, pick, columns = _columns(file, t, joints, platform)
    moving = names(pick, target, f"sampled.{target}")
    times = samples(columns, "t", "sampled.t")
    y = np.array([samples(columns, name, f"sampled.{target}.{name}", times) for name in moving]).T
    if len(times) < 4 or times[0] != 0.0:
        first = f" from {times[0]:g} s" if times else ""
        raise bad("sampled.t", f"{len(times)} samples{first}. Give 4 or more, from t = 0 on.")
    for i in np.flatnonzero(np.diff(times) <= 0.0)[:1]:
        text = f"sample {i + 2} at {times[i + 1]:g} s follows {times[i]:g} s. Times must increase."
        raise bad("sampled.t", text)
    if periodic:
        for i in np.flatnonzero(np.abs(y[-1] - y[0]) > 1e-9 * np.maximum(1.0, np.ptp(y, axis=0))):
            text = f"starts at {y[0, i]:g}, ends at {y[-1, i]:g}. A periodic motion must close."
            raise bad(f"sampled.{target}.{moving[i]}", text)
        y[-1] = y[0]  # exactly, as scipy asks
    return target, moving, times, y


def _columns(file: Any, t: Any, joints: Any, platform: Any) -> tuple[str, Any, dict[str, Any]]:
    """Target, names and columns, of a file or as given."""
    if file is None or (joints is not None and platform is not None):
        target, pick = target_of(joints, platform, "sampled")
        if not isinstance(pick, Mapping):
            raise bad(f"sampled.{target}", f"{shown(pick)} has no samples. Write {{name: [...]}}.")
        return target, pick, {str(name): column for name, column in pick.items()} | {"t": t}
    columns = table(file)
    every = [name for name in columns if name != "t"]
    guess = "platform" if {*every} <= {*PLATFORM_COORDINATES} else "joints"
    guess = "platform" if platform is not None else guess if joints is None else "joints"
    return guess, platform or joints or every, columns
