"""C text of a robot's tables and of its start: what `source/robot.c` steps without Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.kernel.header import structure
from pinflex.live.engine import Engine
from pinflex.live.outputs import Outputs
from pinflex.live.simulator import Simulator

_PER_LINE = 6
_LISTS = (
    *("free_at", "motor_v", "motor_q", "motor_paired", "plain_q", "plain_v", "circle_q"),
    *("circle_v", "ball_q", "ball_v", "body_q", "body_v", "body_flat", "kp", "kd"),
)
_COUNTS = ("free", "motors", "prescribed", "plain", "circles", "balls", "bodies")
_SETTINGS = (
    *("most", "stale", "allowed", "every", "age", "due", "ready", "stopped"),
    *("mass", "by_v", "by_y"),
    *("tolerance", "farthest", "reference", "peak", "noise", "rate", "began", "previous", "second"),
    "usual",
)


def model_c(live: Simulator, engine: Engine, outputs: Outputs) -> str:
    """The file model.c of a simulator where it stands."""
    stages = engine.stages.compiled.kernel
    tables = engine.stages.compiled.compiled.evaluator.tables
    arrays = {f"t_{name}": x for name, x in tables.arrays.items()}
    lists = {name: stages.lists[name] for name in _LISTS}
    arrays |= {f"s_{name}": x for name, x in lists.items()}
    arrays |= {f"m_{name}": x for name, x in _start(engine, outputs).items()}
    stops = engine.bounds.stops
    if stops is not None:
        arrays |= {"m_low": stops[0], "m_high": stops[1]}
    parts = [
        f"/* {_comment(live.mechanism.name)}: written by pinflex, not to be edited. */",
        '#include "robot.h"\n#include <stddef.h>\n',
        *(_array(name, x) for name, x in arrays.items()),
        _structure("Tables", "tables", tables.counts, {k: f"t_{k}" for k in tables.arrays}),
        _structure(
            "Stages", "joints", {k: stages.field(k) for k in _COUNTS},
            {k: f"s_{k}" for k in lists},
        ),
        _structure("Alpha", "settings", _settings(engine), {}),
        _model(live, engine, outputs),
    ]  # fmt: skip
    return "\n".join(parts)


def _settings(engine: Engine) -> dict[str, float]:
    at = engine.kernel.at
    return {name: getattr(at, name) for name in _SETTINGS} | {"stale": 1, "ready": 0, "stopped": -1}


def _start(engine: Engine, outputs: Outputs) -> dict[str, npt.NDArray[Any]]:
    now = engine.state()
    return {
        "predict": engine.march.predictor, "y": now.y, "v": now.v, "a": now.a, "s": now.s,
        "lam": now.lam, "torque": now.torque, "position": engine.path.position[1],
        "scale": engine.scale[1], "frame_node": outputs.frame_node,
        "frame_place": outputs.frame_place, "tip_at": outputs.tip_at, "tip_n": outputs.tip_n,
        "tip_curved": outputs.tip_curved, "tip_rows": outputs.tip_rows, "beam_at": outputs.beam_at,
        "beam_n": outputs.beam_n, "beam_fibres": outputs.beam_fibres,
        "beam_rows": outputs.beam_rows, "beam_rim": outputs.beam_rim, **_carried(outputs),
    }  # fmt: skip


def _carried(outputs: Outputs) -> dict[str, npt.NDArray[Any]]:
    given = outputs.carried
    if given is None:
        return {}
    return {"payload_place": given.place, "payload_inertia": given.inertia}


def _model(live: Simulator, engine: Engine, outputs: Outputs) -> str:
    named = [*_start(engine, outputs)]
    named += [] if engine.bounds.stops is None else ["low", "high"]
    fields = [".tables = &tables", ".joints = &joints", ".settings = &settings"]
    fields += [f".{name} = m_{name}" for name in named]
    fields += [f".dt = {_number(live.dt)}", f".frames = {len(outputs.frame_node)}"]
    fields += [f".tips = {len(outputs.tip_at)}", f".beams = {len(outputs.beam_at)}"]
    carried = outputs.carried
    node, mass = (-1, 0.0) if carried is None else (carried.node, carried.mass)
    fields += [f".payload_node = {node}", f".payload_mass = {_number(mass)}"]
    return f"const Model robot_model = {{{', '.join(fields)}}};\n"


def _structure(kind: str, name: str, values: Mapping[str, float], arrays: Mapping[str, str]) -> str:
    """A constant structure of C: numbers by field, and arrays that have been written."""
    known = {field for field, *_ in structure(kind)._fields_}
    fields = [f".{key} = {_number(x)}" for key, x in values.items() if key in known]
    fields += [f".{key} = {x}" for key, x in arrays.items() if key in known]
    return f"static const {kind} {name} = {{{', '.join(fields)}}};\n"


def _array(name: str, values: npt.NDArray[Any]) -> str:
    """A constant array; one without entries has one that nobody reads."""
    flat = np.ascontiguousarray(values).ravel()
    kind = "double" if flat.dtype.kind == "f" else "Int"
    # lists that a march may read are pointers to what it does not write
    items = [_number(x) for x in flat.tolist()] or ["0"]
    return f"static const {kind} {name}[] = {{\n{_lines(items)}}};"


def _lines(items: Sequence[str]) -> str:
    def each() -> Iterator[str]:
        for k in range(0, len(items), _PER_LINE):
            yield "  " + ", ".join(items[k : k + _PER_LINE])

    return ",\n".join(each()) + "\n"


def _number(x: float) -> str:
    """To the last bit."""
    if isinstance(x, int):
        return str(x)
    if not np.isfinite(x):
        return "NAN" if np.isnan(x) else "INFINITY" if x > 0 else "-INFINITY"
    return float(x).hex()


def _comment(text: str) -> str:
    """A name that ends no comment of C."""
    return text.replace("*/", "* /").replace("\\", "/")
