"""Code blocks of README.md and of the documentation, in order, and why some do not run."""

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
    r"(?:^<!-- not run: (?P<reason>[^>]+?) -->\n)?"
    r"^(?P<fence>```+)(?P<language>\w*)\n(?P<code>.*?)^(?P=fence)$",
    re.MULTILINE | re.DOTALL,
)

# README.md has no marks of its own: how a block begins, and why it does not run here.
NOT_RUN = {
    "pip install . && pinflex compare delta": "an installation; .ci/wheel runs it from the wheel",
    "pinflex compare 3rrs": "20 s of CPU; the command runs in tests/cli on smaller models",
    'pip install -e ".[test]"': "this test suite; .ci/run evaluates that line",
    "pinflex sweep ur5": "30 to 60 s of CPU; sweep and map run in tests/cli on smaller models",
}
# Blocks of the lists that another test holds to the code.
ELSEWHERE = {"CONTRIBUTING.md": "tests/unit/test_contributing.py compares them with its own"}


@dataclass(frozen=True)
class Block:
    """One fenced block: file, line, language, code, and why it does not run ('': it does)."""

    file: str
    line: int
    language: str
    code: str
    reason: str

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
        code, reason = match["code"], match["reason"] or ELSEWHERE.get(file, "")
        if file == "README.md":
            reason = next((why for head, why in NOT_RUN.items() if code.startswith(head)), "")
        found.append(Block(file, line, match["language"], code, reason))
    return found
