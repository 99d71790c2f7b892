"""Names are words of the field and plain English, not the dialect that grew in the code."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pinflex as pf

ROOT = Path(pf.__file__).parent
# Participles and clauses that stood for things: a reader cannot tell what they are.
DIALECT = frozenset("""
alone apart asked beside came closeness dear ended found gives given gone heard holds kept
lent lets looked manyth meanwhile meant meets none nothing one own ready room rubs said seen shown
somehow spares still taken tells thing told tried wanted whatever whoever
""".split())  # noqa: SIM905  # fmt: skip
# English with one of these words that says what it is.
PLAIN = frozenset(("ModelNotFoundError", "asked", "one_blas_thread", "still"))
# Names of before this test. The list shrinks: rename one, take it away, lower the count.
OLD = frozenset("""
Found Room Spares _Kept _OneRun _Seen _TooDear _alone _apart _asked _beside _beside_motors
_beside_the_centre _dear _ended _found _found_start _given _holds _kept _lent _none _on_one_body
_one_sided _own _own_inertias _ready _require_kept _require_one_answer _require_one_freedom
_require_one_side _room _said _seen _told alone beside elastic_apart found given in_one_run kept
looked_at one one_run own rank_beside require_apart rows_or_none said seen_from shown
shown_axes spares told with_one_more
""".split())  # noqa: SIM905  # fmt: skip
COUNT = 56


def names() -> Iterator[str]:
    """Modules, classes and functions of the package, and the parameters of public functions."""
    for path in ROOT.rglob("*.py"):
        yield path.stem
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                yield node.name
            if isinstance(node, ast.FunctionDef) and node.name in pf.__all__:
                yield from (each.arg for each in (*node.args.args, *node.args.kwonlyargs))
    yield from pf.__all__


def words(name: str) -> set[str]:
    """Words of a name, however it is written."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}


def test_the_words_of_a_name() -> None:
    assert words("_TooDear") == {"too", "dear"} and words("so_manyth") == {"so", "manyth"}
    assert words("to_MJCF") == {"to", "mjcf"}


def test_no_new_name_is_in_dialect() -> None:
    new = {name for name in names() if words(name) & DIALECT} - PLAIN - OLD
    assert not new, f"{sorted(new)}: name the thing, or the action."


def test_the_list_of_old_names_does_not_grow() -> None:
    assert len(OLD) <= COUNT and len(DIALECT) >= 40
    assert all(words(name) & DIALECT for name in OLD)
