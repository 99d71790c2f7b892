"""What mkdocs calls: pages made from the code are added, formulas become MathML."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import checked
import claims
import commands
import gallery
import mathml
import notebooks
import output_keys
import public_names
import sources_of_formulas
import yaml_keys
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

import pinflex

ROOT = Path(__file__).parents[2]

# page: what makes its Markdown
PAGES: dict[str, Callable[[], str]] = {
    "reference/yaml.md": yaml_keys.page,
    "reference/cli.md": commands.page,
    "reference/python.md": public_names.page,
    "reference/outputs.md": output_keys.page,
    "reference/sources.md": sources_of_formulas.page,
    "evidence/claims.md": lambda: claims.page("tests/README.md"),
    "evidence/benchmarks.md": lambda: claims.page("tests/benchmarks/README.md"),
    "evidence/race.md": lambda: claims.page("tests/benchmarks/RACE.md"),
    "contributing.md": lambda: claims.page("CONTRIBUTING.md"),
    "changelog.md": lambda: claims.page("CHANGELOG.md"),
}


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages, the executed notebooks and the gallery."""
    for path, make in PAGES.items():
        files.append(File.generated(config, path, content=make()))
    made = ROOT / ".docs"
    for folder, prefix in ((notebooks.run_all(made), "tutorials"), (gallery.make(made), "gallery")):
        for file in sorted(folder.rglob("*")):
            if file.is_file() and file.name != "stamp":
                name = f"{prefix}/{file.relative_to(folder).as_posix()}"
                files.append(File.generated(config, name, abs_src_path=str(file)))
    return files


def on_page_content(html: str, **unused: Any) -> str:
    """Formulas as MathML, which browsers draw by themselves."""
    return mathml.drawn(html)


def on_post_build(config: Any) -> None:
    """Stop a build whose pages lead nowhere, fetch from elsewhere or lack a name."""
    if os.environ.get("DOCS_NOTEBOOKS") == "0":
        return  # without what the tutorials write
    found = [*checked.faults(Path(config.site_dir).resolve(), tuple(pinflex.__all__))]
    if found:
        raise PluginError("\n".join(["the site has faults:", *found]))
