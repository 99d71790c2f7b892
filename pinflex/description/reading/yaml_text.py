"""YAML text into plain data, and a change of one value in it."""

from __future__ import annotations

import re
from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any

import yaml

from pinflex.description.reading.schema import shown
from pinflex.errors import DescriptionError, nearest

# What a YAML may be: looked at on its nodes, before anything is built of them.
#
# A name `*a` stands for all of `&a`, and `<<: [*a, *a]` copies its keys, so that a kilobyte may
# mean more values than any memory holds.

MOST_TEXT = 2_000_000  # [characters], some 20 s of reading
MOST_VALUES = 500_000  # of a description with all its aliases written out
_MERGE = "tag:yaml.org,2002:merge"


def _look_through(root: Any, file: str) -> None:
    """Raise at doubled keys, of which one would be lost, and at blocks that have no end."""
    size: dict[int, int] = {}
    keys: dict[int, int] = {}  # pairs of a mapping once its merges are in it
    open_: set[int] = set()
    pending: list[tuple[Any, bool]] = [(root, False)]
    while pending:
        node, ready = pending.pop()
        if id(node) in size:
            continue
        below = _below(node)
        if not ready:
            if id(node) in open_:
                raise _endless(node, file, "contains itself")
            _refuse_doubled_keys(node, file)
            open_.add(id(node))
            pending.append((node, True))
            pending += [(child, False) for child in below if id(child) not in size]
            continue
        open_.discard(id(node))
        if isinstance(node, yaml.MappingNode):
            keys[id(node)] = sum(
                _merged(value, keys) if key.tag == _MERGE else 1 for key, value in node.value
            )
        size[id(node)] = 1 + keys.get(id(node), 0) + sum(size[id(child)] for child in below)
        if size[id(node)] > MOST_VALUES:
            what = f"has more than {MOST_VALUES} values, its aliases written out"
            raise _endless(node, file, what)


def _below(node: Any) -> list[Any]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _merged(node: Any, keys: dict[int, int]) -> int:
    """Pairs that a merge brings in."""
    if isinstance(node, yaml.SequenceNode):
        return sum(keys.get(id(child), 0) for child in node.value)
    return keys.get(id(node), 0)


def _endless(node: Any, file: str, what: str) -> DescriptionError:
    line = node.start_mark.line + 1
    return DescriptionError(
        f"{file}, line {line}: the block {what}. Write what is meant without so many aliases.",
        line=line,
    )


WILD = re.compile(r"[*?\[]")
_STARTS = re.compile(r"^[ \t?:-]+", re.MULTILINE)  # of a line: indents, and what opens blocks
_NESTED = 2000  # levels; libyaml takes ten times as many on the smallest usual stack


class _Loader(yaml.SafeLoader):
    """The safe loader, which also takes 7e10 and 1e-3 for numbers.

    PyYAML follows YAML 1.1, where an exponent needs a point before it and a sign inside; people,
    C and YAML 1.2 do not.
    """


class _Quick(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The same by libyaml, where PyYAML has it: a tenth of the time."""


_SCALARS = ("bool", "int", "float", "timestamp")


def _scalar(tag: str) -> Callable[[Any, Any], Any]:
    """PyYAML's reading of a scalar with an explicit tag; a misfit is an error with its place."""
    read = yaml.SafeLoader.yaml_constructors[f"tag:yaml.org,2002:{tag}"]

    def constructed(loader: Any, node: Any) -> Any:
        try:
            return read(loader, node)
        except (ValueError, KeyError, IndexError, AttributeError):
            problem = f"{shown(node.value)} is no {tag}"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark) from None

    return constructed


for _loader in (_Loader, _Quick):
    for _tag in _SCALARS:
        _loader.add_constructor(f"tag:yaml.org,2002:{_tag}", _scalar(_tag))
    _loader.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$"),
        list("-+.0123456789"),
    )


def load(text: str, file: str) -> Any:
    """Plain Python data of a YAML text; doubled keys are errors, because one would be lost."""
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
        _look_through(node, file)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _refuse_doubled_keys(node: Any, file: str) -> None:
    lines: dict[str, int] = {}
    keys = (key for key, _ in node.value) if isinstance(node, yaml.MappingNode) else ()
    for key in (key for key in keys if isinstance(key, yaml.ScalarNode)):
        line = key.start_mark.line + 1
        if key.value in lines:
            both = " Write both as <<: [*a, *b]." if key.tag == _MERGE else ""
            raise DescriptionError(
                f'{file}, line {line}: duplicate key "{key.value}", first on line '
                f"{lines[key.value]} of the same block. Keep one of the two.{both}",
                line=line,
            )
        lines[key.value] = line


def set_path(raw: Any, assignment: str) -> None:
    """Change parsed YAML in place by "key.path=value"; a path segment may be a glob."""
    path, sign, value_text = assignment.partition("=")
    where = f"override {assignment!r}"
    segments = [s.strip() for s in path.split(".")]
    if not sign or not all(segments):
        raise DescriptionError(f"{where}: not of the form key.path=value. Write one.")
    value = load(value_text, where)
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
