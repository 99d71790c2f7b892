"""The tables of claims in `tests/README.md`, made of the docstrings of the tests.

A test file says at the end of its docstring what it shows, under the heading of the table:

    Claims:
        Beams
        - tip of a cantilever under its weight | w L^4 / 8 EI | 1e-6 | 2e-9

with the cells of that table but for the test, which is the file; `also` in a last cell names more.

    python -m tests.claims          writes the tables anew; rows stay in their order
    python -m tests.claims --take   first takes rows written into the tables into the test files

Rows without a test file (a benchmark, an example) stay as they are.
"""

from __future__ import annotations

import ast
import re
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

TESTS = Path(__file__).parent
README = TESTS / "README.md"
_FILE = re.compile(r"`([\w/]+/test_\w+\.py)`")
_WIDTH = 100  # columns of a line of a test
_BLOCK = re.compile(r"\n\nClaims:\n((?:    .*\n?|\n)*)")


@dataclass(frozen=True)
class Claim:
    """A row: the heading of its table, the test file, the other cells, and more tests."""

    heading: str
    file: str
    cells: tuple[str, ...]
    also: str = ""

    def row(self) -> str:
        """As the table has it."""
        test = f"`{self.file}`" + (f", {self.also}" if self.also else "")
        return f"| {' | '.join((self.cells[0], test, *self.cells[1:]))} |"

    def lines(self) -> str:
        """As the docstring has it."""
        text = " | ".join((*self.cells, *([f"also {self.also}"] if self.also else [])))
        return textwrap.fill(
            text, _WIDTH, initial_indent="    - ", subsequent_indent="      ",
            break_long_words=False, break_on_hyphens=False,
        )  # fmt: skip


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]


def of_file(path: Path) -> list[Claim]:
    """The claims of a test file."""
    doc = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    block, heading, claims = _BLOCK.search(f"{doc}\n"), "", list[Claim]()
    for item in re.split(r"\n    (?=\S)", f"\n{block[1].rstrip()}")[1:] if block else ():
        if not item.startswith("- "):
            heading = item
            continue
        cells = [x.strip() for x in re.split(r"(?<!\\)\|", " ".join(item[2:].split()))]
        also = cells.pop()[5:] if cells[-1].startswith("also `") else ""
        claims.append(Claim(heading, str(path.relative_to(TESTS)), tuple(cells), also))
    return claims


def of_tests() -> list[Claim]:
    """The claims of all test files."""
    return [claim for path in sorted(TESTS.rglob("test_*.py")) for claim in of_file(path)]


def of_tables(text: str) -> dict[int, Claim]:
    """Rows of the tables that name a test file, by the number of their line."""
    found, heading, claimed, file = dict[int, Claim](), "", False, ""
    for k, line in enumerate(text.splitlines()):
        if line.startswith("#"):
            heading, claimed = line.lstrip("# "), False
        elif line.startswith("| claim | test |"):
            claimed = True
        elif line.startswith("|") and claimed and not line.startswith("|-"):
            claim, test, *rest = _cells(line)
            file = file if test == "same" else "".join(_FILE.findall(test)[:1])
            if file and (TESTS / file).exists():
                also = "" if test == "same" else test.partition(", ")[2]
                found[k] = Claim(heading, file, (claim, *rest), also)
        elif not line.startswith("|"):
            claimed, file = False, ""
    return found


def tables(text: str, claims: list[Claim]) -> str:
    """The page with the rows of these claims: new ones behind those of their file or table."""
    rows, lines = of_tables(text), text.splitlines()
    left = {(x.heading, x.cells[0]): x for x in claims}
    made: list[tuple[str, str, str]] = []  # line, heading, file
    heading = ""
    for k, line in enumerate(lines):
        heading = line.lstrip("# ") if line.startswith("#") else heading
        if k not in rows:
            made.append((line, heading if line.startswith("|") else "", ""))
            continue
        claim = left.pop((heading, rows[k].cells[0]), None)
        if claim is not None:
            made.append((claim.row(), heading, claim.file))
    for claim in left.values():
        places = [k for k, (_, of, _) in enumerate(made) if of == claim.heading]
        if not places:
            raise ValueError(f"{claim.file}: no table {claim.heading!r} in {README.name}")
        last = max([k for k in places if made[k][2] == claim.file] or places)
        made.insert(last + 1, (claim.row(), claim.heading, claim.file))
    return "\n".join(line for line, *_ in made) + "\n"


def take(text: str) -> list[Path]:
    """Write rows that their test file does not claim into its docstring; the files changed."""
    known = {(x.heading, x.file, x.cells[0]) for x in of_tests()}
    new: dict[str, list[Claim]] = {}
    for claim in of_tables(text).values():
        if (claim.heading, claim.file, claim.cells[0]) not in known:
            new.setdefault(claim.file, []).append(claim)
    for file, claims in new.items():
        _write(TESTS / file, [*of_file(TESTS / file), *claims])
    return [TESTS / file for file in new]


def _write(path: Path, claims: list[Claim]) -> None:
    """Put claims into the docstring of a file."""
    source = path.read_text("utf-8")
    first = ast.parse(source).body[0]
    assert isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant), path
    prefix, doc = re.match(r'(r?)"""(.*?)"""', source, re.DOTALL).groups()  # type: ignore[union-attr]
    doc = re.split(r"\n\nClaims:\n", doc)[0].rstrip()
    lines: list[str] = []
    for heading in dict.fromkeys(x.heading for x in claims):
        lines += [f"    {heading}", *(x.lines() for x in claims if x.heading == heading)]
    block = "\n".join(lines)
    prefix = "r" if "\\" in block + doc else prefix
    rest = source[re.match(r'r?""".*?"""', source, re.DOTALL).end() :]  # type: ignore[union-attr]
    path.write_text(f'{prefix}"""{doc}\n\nClaims:\n{block}\n"""{rest}', "utf-8")


def main() -> None:
    """Write the tables."""
    text = README.read_text("utf-8")
    if "--take" in sys.argv[1:]:
        for path in take(text):
            print(path.relative_to(TESTS))
    README.write_text(tables(text, of_tests()), "utf-8")


if __name__ == "__main__":
    main()
