"""A result in words and as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pinflex.arrays import Array
from pinflex.results.error_bars import ErrorBars, time_error
from pinflex.rotations import rotation_vector
from pinflex.text import percent

if TYPE_CHECKING:
    from pinflex.results.result import Result


def columns(result: Result) -> dict[str, Array]:
    """Columns of the table of a run, shape (nt,) each, by header with unit."""
    table: dict[str, Array] = {"t [s]": result.t}
    for i, motor in enumerate(result.motors):
        table[f"torque {motor} [{result.unit('torque/' + motor)}]"] = result.torque[:, i]
    for name in result.meta.get("joints", ()):
        unit, position = result.unit(f"joint/q/{name}"), result.joint(name).position
        if position.ndim == 1 or position.shape[1] == 2:  # 2: cosine and sine
            unit = "rad" if position.ndim == 2 else unit
            table[f"position {name} [{unit}]"] = result.joint(name).angle
            continue
        units = unit.split(", ") if unit.count(",") == position.shape[1] - 1 else None
        for i, column in enumerate(position.T):
            table[f"position {name}[{i}] [{units[i] if units else unit}]"] = column
    if result.meta.get("platform"):
        platform = result.frame(result.meta["platform"])
        turn = rotation_vector(platform.rotation)
        for i, axis in enumerate("xyz"):
            table[f"platform {axis} [m]"] = platform.position[:, i]
        for i, axis in enumerate("xyz"):
            table[f"platform r{axis} [rad]"] = turn[:, i]
    for name in result.links:
        table[f"max von Mises {name} [Pa]"] = result.link(name).von_mises.max(axis=1)
    return table


def summary(result: Result) -> str:
    """The run in a few aligned lines of text."""
    cost, balance = result.meta.get("cost", {}), result.meta.get("energy_balance")
    rows = [("level", result.level)]
    if result.meta.get("status", "complete") != "complete":
        rows.append(("status", f"{result.meta['status']}: {result.meta.get('message', '')}"))
    rows.append(("time", f"{result.t[0]:g} to {result.t[-1]:g} s, {len(result.t)} instants"))
    if "steps" in cost:
        several = cost.get("runs", 1) > 1
        last = f" in {cost.get('runs')} runs, {cost.get('last_steps')} in the last"
        rows.append(("steps", f"{cost['steps']}{last if several else ''}"))
    if "newton" in cost:
        each = f" ({cost['newton'] / cost['steps']:.2f} a step)" if cost.get("steps") else ""
        rows.append(("Newton iterations", f"{cost['newton']}{each}"))
    rows += [("wall time", f"{cost['seconds']:.3g} s")] if "seconds" in cost else []
    by = str(result.meta.get("evaluated_by", ""))
    rows += [("equations", by)] if by.startswith("numpy") else []  # not by the compiled kernel
    time, how = time_error(result.meta.get("settings", {}), result.level)
    errors = result.known_errors or ErrorBars(time, {}, how, "not looked at (run.errors does)")
    for line in errors.lines():
        what, _, text = line.partition(": ")
        rows.append((what, f"error {text}"))
    graded = {k: f", {word}" for k, word in result.meta.get("grades", {}).items()}
    rows.append(("worst closure", f"{result.worst_closure:.2e}{graded.get('closure', '')}"))
    known = "not computed" if balance is None else f"{balance:.2e}{graded.get('energy', '')}"
    rows.append(("energy balance", known))
    rows += [("file", str(result.meta["rounded"]))] if "rounded" in result.meta else []
    rows += [("warning", text) for text in result.meta.get("warnings", ())]
    return "\n".join([_first_line(result)] + [f"  {a:<18}{b}" for a, b in rows])


def _first_line(result: Result) -> str:
    """Its name; and a model error above the tolerance asked, where that has been looked at."""
    name, advised = str(result.meta.get("name", "result")), result.meta.get("advice")
    tol = (advised or result.meta.get("settings", {})).get("tol")
    errors = result.known_errors
    worst = None if errors is None else errors.worst()
    if worst is None or tol is None or worst[1] <= tol:
        return name
    return (
        f"{name}: THE MODEL is off by up to {percent(worst[1])} ({worst[0]}), more than "
        f"tol = {tol:g}{'' if advised else ', which is of time integration only'}"
    )
