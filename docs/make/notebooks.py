"""Tutorials: scripts in the percent format, executed as notebooks and written as Markdown."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import jupytext
from jupyter_client.manager import KernelManager
from nbclient import NotebookClient
from nbconvert import MarkdownExporter
from traitlets.config import Config

ROOT = Path(__file__).parents[2]
TUTORIALS = ROOT / "docs" / "tutorials"
_LIMIT = 600  # [s] of one cell: far above any of them, below a build that hangs


def run_all(made: Path) -> Path:
    """Execute the tutorials that changed, or all if pinflex did; the folder with what they wrote.

    With DOCS_NOTEBOOKS=0 they are converted without being executed, for a quick look at the text.
    """
    folder = made / "tutorials"
    for script in sorted(TUTORIALS.glob("*.py")):
        execute = os.environ.get("DOCS_NOTEBOOKS") != "0"
        out = folder / script.stem
        stamp = _stamp(script) + ("" if execute else " not executed")
        if not (out / "stamp").is_file() or (out / "stamp").read_text() != stamp:
            shutil.rmtree(out, ignore_errors=True)
            out.mkdir(parents=True)
            (folder / f"{script.stem}.md").write_text(page(script, out, execute), "utf-8")
            (out / "stamp").write_text(stamp)
    return folder


def _stamp(script: Path) -> str:
    """Hash of all that a tutorial's outputs follow from."""
    sources = [script, *sorted((ROOT / "pinflex").rglob("*.py")), *sorted(ROOT.glob("models/*/*"))]
    return hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()


def page(script: Path, out: Path, execute: bool = True) -> str:
    """The Markdown of one tutorial; its pictures and files go to `out`."""
    notebook = jupytext.read(script)
    if execute:
        _execute(notebook, out)
    settings = Config({"NbConvertBase": {"display_data_priority": _SHOWN}})
    text, resources = MarkdownExporter(config=settings).from_notebook_node(notebook)
    for name, data in resources["outputs"].items():
        (out / name).write_bytes(data)
        text = text.replace(f"]({name})", f"]({script.stem}/{name})")
    (out / f"{script.stem}.ipynb").write_text(json.dumps(notebook, indent=1), "utf-8")
    return (
        f"{_without_escapes(text)}\n[This page as a notebook]({script.stem}/{script.stem}.ipynb)\n"
    )


def _execute(notebook: Any, out: Path) -> None:
    """Run every cell, in a kernel on sockets of this user alone where the system has such."""
    with tempfile.TemporaryDirectory() as private:
        sockets = {"transport": "ipc", "connection_file": f"{private}/kernel.json"}
        own = {} if os.name == "nt" else sockets
        kernel = KernelManager(**own)
        place = {"metadata": {"path": out}}
        try:
            NotebookClient(notebook, km=kernel, timeout=_LIMIT, resources=place).execute()
        finally:
            kernel.shutdown_kernel(now=True)


_SHOWN = ["text/html", "image/png", "text/markdown", "text/plain"]


def _without_escapes(text: str) -> str:
    """Without the colours that a terminal would show."""
    return re.sub(r"\x1b\[[0-9;]*m", "", text)
