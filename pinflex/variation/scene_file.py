"""A scene with other numbers as a YAML that loads as it is."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import yaml

from pinflex.description.description import Description
from pinflex.writing import replaced


def write_scene(description: Description, path: str | Path, notes: Iterable[str]) -> Path:
    """Write a scene with comments at its head."""
    path = Path(path)
    raw = yaml.safe_load(description.yaml_text)
    old = None if description.path is None else description.path.parent
    for block, key in ((raw, "urdf"), (raw.get("motion") or {}, "file")):
        if old is not None and isinstance(block.get(key), str) and (old / block[key]).is_file():
            block[key] = os.path.relpath(old / block[key], path.absolute().parent)
    head = "".join(f"# {line}\n" for line in notes)
    with replaced(path) as part:
        part.write_text(head + yaml.safe_dump(raw, sort_keys=False), "utf-8")
    return path
