"""The reference of Python: every public name, by what it is for; mkdocstrings reads docstrings."""

from __future__ import annotations

from collections import defaultdict

import griffe

import pinflex

# package that a name lives in: title of its section, in this order
TITLES = {
    "mechanics": "Load a robot",
    "description": "Motions and controllers",
    "advice": "Solve, and ask which model suffices",
    "live": "In the loop",
    "results": "Results",
    "levels": "Equilibria and vibration",
    "inversion": "Motor commands and linear models",
    "quickest": "The fastest move",
    "studies": "Many cases",
    "variation": "Sensitivity, design, scatter, fit",
    "viewer": "See it",
    "integrators": "Integrators",
    "errors": "Errors",
}
_INTRO = """# Python

```python
import pinflex as pf
```

Every name below is `pf.NAME`. Quantities are SI, angles radians, arrays time first, read-only.
Notation: q rigid coordinates, eta elastic ones, y = (q, eta), lam multipliers of the closures.
"""

_VIEWS = """
## What a result answers with

`result.joint(NAME)`, `.frame(NAME)`, `.link(NAME)`, `.loop(NAME)`, `.drive(NAME)` and
`.deviation_from(other)`.
"""


def _views(package: griffe.Object) -> list[str]:
    """Classes through which a result is read by name."""
    modules = [package["results"][name] for name in ("views", "drives")]
    return [
        member.path
        for module in modules
        for member in module.members.values()
        if not member.is_alias and member.is_class and not member.name.startswith("_")
    ]


def page() -> str:
    """A section for each task, with its names in alphabetical order."""
    package = griffe.load("pinflex", search_paths=["."], resolve_aliases=False)
    sections = defaultdict(list)
    for name in pinflex.__all__:
        member = package.members[name]
        path = member.target_path if member.is_alias else member.path
        sections[path.split(".")[1]].append(name)
    order = [*TITLES, *sorted(set(sections) - set(TITLES))]
    parts = [_INTRO]
    for home in order:
        if sections[home]:
            parts.append(f"\n## {TITLES.get(home, home.capitalize())}\n")
            parts += [f"::: pinflex.{name}\n" for name in sorted(sections[home], key=str.lower)]
        if home == "results":
            parts += [_VIEWS, *(f"::: {path}\n" for path in _views(package))]
    return "\n".join(parts)
