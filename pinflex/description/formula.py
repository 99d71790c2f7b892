"""Formulas of time in a motion, such as "0.3*t^2", with their exact first two derivatives.

A formula is walked as a syntax tree, never run as code, on jets: a jet is the value, the first and
the second derivative of a quantity by time, shape (3, nt), and every operation keeps all three.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping

import numpy as np

from pinflex.arrays import Array
from pinflex.description.ranges import finite
from pinflex.errors import DescriptionError, nearest

_CONSTANTS = {"pi": np.pi}


def _chain(f: Array, df: Array, ddf: Array, x: Array) -> Array:
    """f of a jet x, from f, f' and f'' at its value."""
    return np.array([f, df * x[1], ddf * x[1] ** 2 + df * x[2]])


def _times(x: Array, y: Array) -> Array:
    return np.array([x[0] * y[0], x[1] * y[0] + x[0] * y[1], _second(x, y)])


def _second(x: Array, y: Array) -> Array:
    return np.asarray(x[2] * y[0] + 2.0 * x[1] * y[1] + x[0] * y[2])


def _over(x: Array, y: Array) -> Array:
    return _times(x, _chain(1.0 / y[0], -1.0 / y[0] ** 2, 2.0 / y[0] ** 3, y))


def _power(x: Array, y: Array) -> Array:
    if np.any(y[1:]) or np.ptp(y[0]):
        return _exp(_times(y, _log(x)))
    n = float(y[0].flat[0])
    if n in (0.0, 1.0):  # their derivatives must not divide by zero
        return x if n else np.array([np.ones_like(x[0]), 0.0 * x[0], 0.0 * x[0]])
    ddf = 2.0 * np.ones_like(x[0]) if n == 2.0 else n * (n - 1.0) * x[0] ** (n - 2.0)
    return _chain(x[0] ** n, n * x[0] ** (n - 1.0), ddf, x)


def _sin(x: Array) -> Array:
    return _chain(np.sin(x[0]), np.cos(x[0]), -np.sin(x[0]), x)


def _cos(x: Array) -> Array:
    return _chain(np.cos(x[0]), -np.sin(x[0]), -np.cos(x[0]), x)


def _exp(x: Array) -> Array:
    f = np.exp(x[0])
    return _chain(f, f, f, x)


def _log(x: Array) -> Array:
    return _chain(np.log(x[0]), 1.0 / x[0], -1.0 / x[0] ** 2, x)


def _sqrt(x: Array) -> Array:
    f = np.sqrt(x[0])
    return _chain(f, 0.5 / f, -0.25 / f**3, x)


def _atan(x: Array) -> Array:
    slope = 1.0 / (1.0 + x[0] ** 2)
    return _chain(np.arctan(x[0]), slope, -2.0 * x[0] * slope**2, x)


_FUNCTIONS: Mapping[str, Callable[[Array], Array]] = {
    "sin": _sin,
    "cos": _cos,
    "tan": lambda x: _over(_sin(x), _cos(x)),
    "atan": _atan,
    "exp": _exp,
    "log": _log,
    "sqrt": _sqrt,
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
        return _FUNCTIONS[node.func.id](_jet(node.args[0], t))
    if isinstance(node, ast.Name) and node.id == "t":
        return t
    jet = np.zeros_like(t)
    jet[0] = finite(_CONSTANTS[node.id] if isinstance(node, ast.Name) else ast.literal_eval(node))
    return jet
