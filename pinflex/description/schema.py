"""Checked reading of YAML: a wrong value is named by file, key path, value and what is allowed.

Every reader takes the value and `where` it stands, as in "3rrr.yaml: flexible.distal_1.section".
"""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Collection, Iterable
from fnmatch import fnmatchcase
from typing import Any

import yaml

from pinflex.description import ranges
from pinflex.description.yaml_limits import MOST_TEXT, refuse_endless
from pinflex.errors import DescriptionError, nearest

Vec3 = tuple[float, float, float]
WILD = re.compile(r"[*?\[]")
_LETTERS: dict[str, Vec3] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_MERGE = "tag:yaml.org,2002:merge"
_STARTS = re.compile(r"^[ \t?:-]+", re.MULTILINE)  # of a line: indents, and what opens blocks
_NESTED = 2000  # levels; libyaml takes ten times as many on the smallest usual stack
_MOST = 10**9  # of whole numbers


class _Loader(yaml.SafeLoader):
    """The safe loader, which also takes 7e10 and 1e-3 for numbers.

    PyYAML follows YAML 1.1, where an exponent needs a point before it and a sign inside; people,
    C and YAML 1.2 do not.
    """


class _Quick(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The same by libyaml, where PyYAML has it: a tenth of the time."""


for _loader in (_Loader, _Quick):
    _loader.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"),
        list("-+.0123456789"),
    )


def at(where: str, key: object) -> str:
    """Where a key of the block at `where` stands: "x.yaml" + "urdf" -> "x.yaml: urdf"."""
    return f"{where}.{key}" if ": " in where else f"{where}: {key}"


def shown(value: object) -> str:
    """The value as text for a message, cut short: aliases can make a small file endless."""
    short = reprlib.Repr()
    short.maxlevel = 2
    text = short.repr(value)
    return text if len(text) <= 120 else text[:117] + "..."


def load(text: str, file: str) -> Any:
    """Plain Python data of a YAML text; doubled keys are errors, because one would be lost.

    Args:
        text: The YAML text.
        file: Name of the file, for messages.
    """
    if len(text) > MOST_TEXT:
        raise DescriptionError(
            f"{file}: {len(text)} characters. A description has at most {MOST_TEXT}; long tables "
            "of a motion stand in a CSV file."
        )
    try:
        if _shallow(text):
            return _loaded(_Quick, text, file)
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError):
        pass  # said by the reader in Python, whose words and places tell more
    try:
        return _loaded(_Loader, text, file)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 0
        problem = error.problem or error.context or "not YAML"
        raise DescriptionError(
            f"{file}, line {line}: {problem}. Blocks are indented with spaces and written "
            '"key: value". Correct the line, or the one above it.',
            line=line,
        ) from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise DescriptionError(f"{file}: cannot be read as YAML: {error}. Correct it.") from None
    except RecursionError:
        raise DescriptionError(f"{file}: nested too deeply. A description has 5 levels.") from None


def _shallow(text: str) -> bool:
    """Whether libyaml may read it: it has no limit of nesting but the stack, past which it crashes.

    Every block inside another is indented more, or stands behind a dash or a question mark; a list
    may stand as far left as its key. Brackets in texts count as if they were none: a bound is
    enough.
    """
    blocks = max((len(start) for start in _STARTS.findall(text)), default=0)
    return 2 * blocks + text.count("[") + text.count("{") < _NESTED


def _loaded(kind: Any, text: str, file: str) -> Any:
    """Plain data by one of the two readers."""
    loader = kind(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _refuse_doubled_keys(node, file)
        refuse_endless(node, file)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _refuse_doubled_keys(root: Any, file: str) -> None:
    pending, done = [root], set()
    while pending:
        node = pending.pop()
        if id(node) in done:
            continue
        done.add(id(node))
        if isinstance(node, yaml.SequenceNode):
            pending.extend(node.value)
        if not isinstance(node, yaml.MappingNode):
            continue
        lines: dict[str, int] = {}
        for key, value in node.value:
            pending.extend((key, value))
            if not isinstance(key, yaml.ScalarNode):
                continue
            line = key.start_mark.line + 1
            if key.value in lines:
                both = " Write both as <<: [*a, *b]." if key.tag == _MERGE else ""
                raise DescriptionError(
                    f'{file}, line {line}: duplicate key "{key.value}", first on line '
                    f"{lines[key.value]} of the same block. Keep one of the two.{both}",
                    line=line,
                )
            lines[key.value] = line


def mapping(
    value: object, where: str, keys: Collection[str] | None = None, required: Iterable[str] = ()
) -> dict[str, Any]:
    """A block `key: value`; empty values count as not written.

    Args:
        value: The parsed value.
        where: Its place.
        keys: The keys that exist; None allows any name.
        required: The keys that must be written.
    """
    if not isinstance(value, dict):
        hint = f" Its keys: {', '.join(keys)}." if keys else ""
        raise DescriptionError(f"{where}: {shown(value)} is not a block of `key: value`.{hint}")
    for key in value:
        if not isinstance(key, str):
            raise DescriptionError(f"{where}: the key {shown(key)} is not text. Put it in quotes.")
        if keys is not None and key not in keys:
            raise DescriptionError(f"{at(where, key)}: no such key.{nearest(key, keys)}")
    written = {key: item for key, item in value.items() if item is not None}
    for key in required:
        if key not in written:
            raise DescriptionError(
                f"{at(where, key)}: missing. Required here: {', '.join(required)}. Write it."
            )
    return written


def number(
    value: object,
    where: str,
    low: float = -math.inf,
    high: float = math.inf,
    above: float = -math.inf,
    of: str | None = None,
) -> float:
    """A finite number with low <= value <= high and value > above.

    Args:
        value: The parsed value. where: Its place.
        low, high, above: Bounds of the key.
        of: What it is the number of: a quantity of `ranges.RANGES`, whose range also holds, and
            whose units (`ranges.UNITS`) may be written.
    """
    bounds = [f"> {above:g}"] if above > -math.inf else []
    bounds += [f">= {low:g}"] if low > -math.inf else []
    bounds += [f"<= {high:g}"] if high < math.inf else []
    allowed = f"Allowed: a finite number {' and '.join(bounds)}".rstrip() + "."
    value = ranges.measured(value, of)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        hint = ranges.units_of(of) if isinstance(value, str) else ""
        raise DescriptionError(f"{where}: {shown(value)} is not a number. {allowed}{hint}")
    result = ranges.finite(value)
    if not (math.isfinite(result) and low <= result <= high and result > above):
        raise DescriptionError(f"{where}: {shown(value)} is out of range. {allowed}", value=value)
    return result if of is None else ranges.within(result, where, of)


def quantity(kind: str) -> str:
    """What a position of a joint of one freedom is, of `ranges.RANGES`."""
    return "place" if kind == "prismatic" else "angle"


def integer(value: object, where: str, low: int, high: int | None = None) -> int:
    """A whole number, low <= value <= high (None: a thousand million)."""
    most = _MOST if high is None else high
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= most:
        large = isinstance(value, int) and value > most
        bounds = f">= {low}" + (f" and <= {most}" if large or high is not None else "")
        raise DescriptionError(
            f"{where}: {shown(value)} is not valid. Allowed: a whole number {bounds}.", value=value
        )
    return value


def boolean(value: object, where: str) -> bool:
    """true or false."""
    if not isinstance(value, bool):
        raise DescriptionError(f"{where}: {shown(value)} is not valid. Allowed: true, false.")
    return value


def text(value: object, where: str) -> str:
    """A non-empty text."""
    if not isinstance(value, str) or not value.strip():
        raise DescriptionError(f"{where}: {shown(value)} is not a text. Write a name.")
    return value.strip()


def choice(value: object, where: str, names: Collection[str]) -> str:
    """One of the given words."""
    if not isinstance(value, str) or value not in names:
        raise DescriptionError(
            f"{where}: {shown(value)} is not known.{nearest(str(value)[:80], names)}", value=value
        )
    return value


def known(value: object, where: str, names: Collection[str], what: str) -> str:
    """A name that exists in the URDF (or another list); `what` reads "link in 3rrr.urdf"."""
    name = text(value, where)
    if name not in names:
        raise DescriptionError(
            f'{where}: no such {what}: "{name[:80]}".{nearest(name[:80], names)}', name=name
        )
    return name


def items(value: object, where: str, size: int | None = None) -> list[Any]:
    """A list, of `size` entries if given."""
    if not isinstance(value, (list, tuple)) or (size is not None and len(value) != size):
        what = "a list" if size is None else f"a list of {size}"
        raise DescriptionError(f"{where}: {shown(value)} is not {what}. Write [a, b, ...].")
    return list(value)


def numbers(
    value: object, where: str, size: int, low: float = -math.inf, of: str | None = None
) -> tuple[float, ...]:
    """A list of `size` finite numbers >= low, each as in `number`."""
    entries = enumerate(items(value, where, size))
    return tuple(number(v, f"{where}[{i}]", low, of=of) for i, v in entries)


def vector(value: object, where: str, low: float = -math.inf, of: str | None = None) -> Vec3:
    """Three finite numbers >= low, each as in `number`."""
    x, y, z = numbers(value, where, 3, low, of)
    return x, y, z


def direction(value: object, where: str) -> Vec3:
    """A unit vector, from x, y, z, -x, -y, -z or three numbers that are not all zero."""
    if isinstance(value, str):
        letter = choice(value, where, ("x", "y", "z", "-x", "-y", "-z"))
        x, y, z = _LETTERS[letter[-1]]
        return (x, y, z) if len(letter) == 1 else (-x, -y, -z)
    x, y, z = vector(value, where)
    size = math.hypot(x, y, z)
    if not 1e-150 < size < 1e150:
        raise DescriptionError(
            f"{where}: {shown(value)} has no direction. Write x, y, z or [x, y, z]."
        )
    return x / size, y / size, z / size


def names(value: object, where: str, allowed: Collection[str], what: str) -> tuple[str, ...]:
    """A list of different names, each one of those allowed."""
    found: list[str] = []
    for i, item in enumerate(items(value, where)):
        name = known(item, f"{where}[{i}]", allowed, what)
        if name in found:
            raise DescriptionError(f'{where}[{i}]: "{name}" is listed twice. Keep one.', name=name)
        found.append(name)
    return tuple(found)


_DECIMAL = re.compile(r"-?[0-9]{1,20}\.[0-9]{1,20}")


def set_path(raw: Any, assignment: str) -> None:
    """Change parsed YAML in place by "key.path=value"; a path segment may be a glob.

    Args:
        raw: The parsed YAML.
        assignment: Such as "flexible.*.section.thickness=1e-3"; the value is read as YAML.
    """
    path, sign, value_text = assignment.partition("=")
    where = f"override {assignment!r}"
    segments = [s.strip() for s in path.split(".")]
    if not sign or not all(segments):
        raise DescriptionError(f"{where}: not of the form key.path=value. Write one.")
    plain = _DECIMAL.fullmatch(value_text)  # designs differ in hundreds of these
    value = float(value_text) if plain else load(value_text, where)
    blocks: list[Any] = [raw]
    for depth, segment in enumerate(segments):
        final = depth == len(segments) - 1
        following: list[Any] = []
        for block in blocks:
            for key in _matching(block, segment, f"{where}: {'.'.join(segments[:depth])}"):
                if final:
                    block[key] = value
                    continue
                if isinstance(block, dict) and block.get(key) is None:
                    block[key] = {}
                following.append(block[key])
        blocks = following


def _matching(block: Any, segment: str, where: str) -> list[Any]:
    """The keys or list places of a block that a path segment names."""
    if isinstance(block, list) and segment.isdecimal() and int(segment) < len(block):
        return [int(segment)]
    if not isinstance(block, dict):
        raise DescriptionError(
            f'{where}: {shown(block)} has no "{segment}" inside. Set the whole value instead.'
        )
    if not WILD.search(segment):
        return [segment]
    found = [key for key in block if fnmatchcase(str(key), segment)]
    if not found:
        raise DescriptionError(f'{where}: nothing matches "{segment}".{nearest(segment, block)}')
    return found
