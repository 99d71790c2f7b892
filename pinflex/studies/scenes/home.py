"""Home as the block `home` of a YAML, and writing it there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml

from pinflex.arrays import Array
from pinflex.description.description import read
from pinflex.description.reading import yaml_text
from pinflex.errors import DescriptionError
from pinflex.mechanics.mechanism import Mechanism
from pinflex.writing import replaced

_PACKAGE = Path(__file__).resolve().parents[2]  # what is in it came with an installation
_ZERO = 5e-10  # [rad | m] a value that is not written: joints stand at zero anyway


def home_values(mechanism: Mechanism) -> dict[str, float | list[float]]:
    """Value of each joint at home, as `home` takes it; joints at zero are left out."""
    model, q = mechanism.rigid.rigid, mechanism.home
    found: dict[str, float | list[float]] = {}
    for name, joint in zip(model.names[1:], model.joints[1:], strict=True):
        part = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nv == 1 and joint.nq == 2:  # a continuous joint: cosine and sine
            part = np.array([np.arctan2(part[1], part[0])])
        elif joint.nv == 3 and joint.nq == 4 and joint.shortname() == "JointModelPlanar":
            part = np.array([*part[:2], np.arctan2(part[3], part[2])])
        values = [float(f"{x:.9g}") for x in part]
        stem = name.rpartition(".")[0]
        if stem and mechanism.description.joints.get(stem) is not None:
            both = found.setdefault(stem, [])  # NAME.1 and NAME.2 are the axes of a universal joint
            assert isinstance(both, list)
            both.append(values[0])
            continue
        found[name] = values[0] if joint.nv == 1 else values
    neutral = pin.neutral(model)
    return {
        name: value
        for name, value in found.items()
        if {name, f"{name}.1"} & {*mechanism.description.home}
        or not _at_rest(model, neutral, name, value)
    }


def _at_rest(model: pin.Model, neutral: Array, name: str, value: float | list[float]) -> bool:
    if model.existJointName(name):
        joint = model.joints[model.getJointId(name)]
        if joint.nq > 2 and joint.shortname() != "JointModelPlanar":
            rest = neutral[joint.idx_q : joint.idx_q + joint.nq]
            return bool(np.max(np.abs(rest - value)) < _ZERO)
    return bool(np.max(np.abs(value)) < _ZERO)


def write_home(mechanism: Mechanism) -> Path:
    """Write the closed pose into the YAML that the mechanism was read from, and return its path.

    Comments and all other lines stay; the file is replaced in one step, so that it is never half
    written.

    Raises:
        DescriptionError: There is no such file, it came with pinflex, or it cannot be written.
    """
    path = mechanism.description.path
    if path is None:
        raise DescriptionError(f"{mechanism.name}: home: read from no file. Write the block there.")
    path = path.resolve()
    if path.is_relative_to(_PACKAGE) or "site-packages" in path.parts:
        raise DescriptionError(
            f"{mechanism.name}: home: this model came with an installed package, and the next "
            "update would undo the change. Copy its folder and give the copy."
        )
    raw = path.read_bytes()
    # what the robot's file says joins the YAML's own text, so both are read
    if read(path).yaml_text != mechanism.description.yaml_text:
        raise DescriptionError(
            f"{path.name}: home: the model is not that of the file (an override, or the file has "
            "changed since), and its pose may not fit. Write the changes into the file first."
        )
    mark = b"\xef\xbb\xbf" if raw.startswith(b"\xef\xbb\xbf") else b""
    text = with_home(raw[len(mark) :].decode("utf-8"), home_values(mechanism), path.name)
    with replaced(path) as part:
        part.write_bytes(mark + text.encode("utf-8"))
    return path


# A YAML text with another `home`; every other byte stays as its author wrote it.

_DIGITS = 1e-8  # relative or absolute; nine digits are written


def with_home(text: str, values: Mapping[str, float | list[float]], file: str) -> str:
    """The text with the block `home` replaced, or appended where there is none."""
    before = yaml_text.load(text, file)
    changed = _changed(text, values, before)
    if not _only_home_differs(changed, before, values, file):
        lines = _lines(values, "\r\n" if "\r\n" in text else "\n")
        raise DescriptionError(
            f"{file}: home: this file is written in a way that does not let the block be replaced "
            f"alone (an anchor, several documents). Write it yourself:\n{lines}"
        )
    return changed


def _changed(
    text: str, values: Mapping[str, float | list[float]], before: Mapping[str, Any]
) -> str:
    """The text with the block replaced, or with a new one at its end."""
    newline = "\r\n" if "\r\n" in text else "\n"
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    assert isinstance(root, yaml.MappingNode)
    lines = _lines(values, newline)
    for key, value in root.value:
        if key.value == "home":
            if isinstance(value, yaml.MappingNode) and value.value:
                return _edited(text, value, before["home"], values, newline)
            first, last = key.start_mark.index, max(_end(value), key.end_mark.index + 1)
            inner = _flow(values) if root.flow_style else lines
            return text[:first] + inner + text[last:]
    if root.flow_style:
        at = text.rindex("}", 0, root.end_mark.index)
        return f"{text[:at].rstrip().rstrip(',')}, {_flow(values)}{text[at:]}"
    at = max(_end(value) for pair in root.value for value in pair)
    line = text.find("\n", at)
    at = len(text) if line < 0 else line
    at -= at > 0 and text[at - 1 : at] == "\r"
    return text[:at] + newline + lines + (text[at:] or newline)


def _only_home_differs(
    changed: str,
    before: Mapping[str, Any],
    values: Mapping[str, float | list[float]],
    file: str,
) -> bool:
    """Whether the changed text says the values, and everything else as before."""
    try:
        after = yaml_text.load(changed, file)
        now = after.pop("home")
        if after != {k: v for k, v in before.items() if k != "home"}:
            return False
        return now.keys() >= values.keys() and all(_same(now[k], x) for k, x in values.items())
    except (DescriptionError, AttributeError, KeyError, TypeError):
        return False


def _edited(
    text: str,
    block: yaml.MappingNode,
    old: Mapping[str, Any],
    values: Mapping[str, float | list[float]],
    newline: str,
) -> str:
    """The text with new values in the entries of a block, and entries that it lacks after them."""
    pieces: list[tuple[int, int, str]] = []
    for key, value in block.value:
        new = values.get(key.value)
        if new is not None and not _same(old.get(key.value), new):
            shown = in_flow({"x": new}).partition(": ")[2]
            pieces.append((value.start_mark.index, _end(value), shown))
    more = [in_flow({name: v}) for name, v in values.items() if name not in old]
    last = _end(block.value[-1][1])
    if more and block.flow_style:
        pieces.append((last, last, "".join(f", {entry}" for entry in more)))
    elif more:
        indent = " " * block.value[0][0].start_mark.column
        line = text.find("\n", last)
        line = len(text) if line < 0 else line - (text[line - 1] == "\r")
        pieces.append((line, line, "".join(f"{newline}{indent}{entry}" for entry in more)))
    for first, after, shown in sorted(pieces, reverse=True):
        text = text[:first] + shown + text[after:]
    return text


def _same(a: object, b: float | list[float]) -> bool:
    """Values that are one to the digits written."""
    one, other = (x if isinstance(x, list) else [x] for x in (a, b))
    if len(one) != len(other) or not all(isinstance(x, int | float) for x in one):
        return False
    return all(abs(x - y) <= _DIGITS * max(1.0, abs(y)) for x, y in zip(one, other, strict=True))


def _lines(values: Mapping[str, float | list[float]], newline: str) -> str:
    if not values:
        return "home: {}"
    rows = [f"  {in_flow({name: value})}" for name, value in values.items()]
    return newline.join(["home:", *rows])


def _flow(values: Mapping[str, float | list[float]]) -> str:
    return in_flow({"home": dict(values)})


def in_flow(block: dict[str, Any]) -> str:
    """One line "key: value"."""
    dumped = yaml.safe_dump(block, default_flow_style=True, width=10**6, allow_unicode=True)
    return str(dumped).strip()[1:-1]


def _end(node: yaml.Node) -> int:
    """Where a value ends in the text; a block ends with its last entry, not with what follows."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[-1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)
