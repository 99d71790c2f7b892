"""Code blocks of README.md and of the documentation, in order."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
FILES = ("README.md", "CONTRIBUTING.md", "models/README.md", "tests/README.md")
PAGES = (
    *(ROOT / name for name in FILES),
    *sorted((ROOT / "docs").rglob("*.md")),
)
_BLOCK = re.compile(
    r"^(?P<fence>```+)(?P<language>\w*)\n(?P<code>.*?)^(?P=fence)$",
    re.MULTILINE | re.DOTALL,
)

# Its blocks are those of tests/unit/test_extensions.py: tests/unit/test_contributing.py compares.
ELSEWHERE = ("CONTRIBUTING.md",)


@dataclass(frozen=True)
class Block:
    """One fenced block: file, line, language, code."""

    file: str
    line: int
    language: str
    code: str

    @property
    def name(self) -> str:
        """For reports."""
        return f"{self.file}:{self.line}"


def blocks(*languages: str) -> list[Block]:
    """Every block of these languages."""
    return [block for page in PAGES for block in _of(page) if block.language in languages]


def _of(page: Path) -> list[Block]:
    text, file = page.read_text("utf-8"), page.relative_to(ROOT).as_posix()
    found = []
    for match in _BLOCK.finditer(text):
        line = text.count("\n", 0, match.start("fence")) + 1
        found.append(Block(file, line, match["language"], match["code"]))
    return found
