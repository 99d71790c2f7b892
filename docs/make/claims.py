"""Pages that stand in the repository already: reports, claims, how to contribute, changes."""

from __future__ import annotations

import os
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")

# file of the repository: page of the site
SITE = {
    "README.md": "index.md",
    "models/README.md": "reference/yaml.md",
    "tests/README.md": "evidence/claims.md",
    "tests/benchmarks/README.md": "evidence/benchmarks.md",
    "tests/benchmarks/RACE.md": "evidence/race.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}


def page(file: str) -> str:
    """A Markdown file of the repository with its links as the site has them."""
    return relinked((ROOT / file).read_text("utf-8"), file)


def relinked(text: str, file: str) -> str:
    """Links to files that are pages lead to these; others become the name of the file."""
    here = os.path.dirname(SITE[file])

    def link(found: re.Match[str]) -> str:
        shown, target, anchor = found[1], found[2], found[3] or ""
        if "://" in target:
            return found[0]
        path = os.path.normpath(os.path.join(os.path.dirname(file), target)).replace(os.sep, "/")
        if path in SITE:
            return f"[{shown}]({os.path.relpath(SITE[path], here or '.')}{anchor})"
        return shown if shown.strip("`") == path else f"{shown} (`{path}`)"

    return _LINK.sub(link, _without_pictures(text))


def _without_pictures(text: str) -> str:
    """Pictures of the repository are not carried along."""
    return re.sub(r"!\[[^\]]*\]\((?!https?:)[^)]*\)", "", text)
