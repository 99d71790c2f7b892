"""`home` in a YAML: only its values change, every other byte stays.

Claims:
    Equations
    - `--write-home`: only values of `home` change in the file | - | bytes | exact | also
      `cli/test_cli.py`
"""

from __future__ import annotations

import pytest

import pinflex as pf
from pinflex.description.reading import yaml_text
from pinflex.studies.scenes.home import with_home

POSE: dict[str, float | list[float]] = {"a": 2.5, "b": [0.5, 0.25], "c: d": 3.0}
LINES = "home:\n  a: 2.5\n  b: [0.5, 0.25]\n  'c: d': 3.0\n"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("urdf: u  # why\n\n# end\n", f"urdf: u  # why\n{LINES}\n# end\n"),
        ("urdf: u", f"urdf: u\n{LINES}"),
        ("urdf: u\r\n", "urdf: u\r\n" + LINES.replace("\n", "\r\n")),
        ("urdf: u\nhome:\nbase: fixed\n", f"urdf: u\n{LINES}base: fixed\n"),
        ("urdf: u\nhome: {}  # none\n", f"urdf: u\n{LINES.rstrip()}  # none\n"),
        (
            "urdf: u\nhome:   # [rad]\n    a: 2.50  # same\n    b: [1, 1]  # other\n"
            "# tail\nbase: x\n",
            "urdf: u\nhome:   # [rad]\n    a: 2.50  # same\n    b: [0.5, 0.25]  # other\n"
            "    'c: d': 3.0\n# tail\nbase: x\n",
        ),
        (
            "home: {a: 1}  # one\nurdf: u\n",
            "home: {a: 2.5, b: [0.5, 0.25], 'c: d': 3.0}  # one\nurdf: u\n",
        ),
        ("{urdf: u}\n", "{urdf: u, home: {a: 2.5, b: [0.5, 0.25], 'c: d': 3.0}}\n"),
        ("---\nurdf: u\nframes:\n- x\n...\n", f"---\nurdf: u\nframes:\n- x\n{LINES}...\n"),
        ("urdf: u\nbase: |\n  text\n\n# c\n", None),
        ("urdf: u\nhome: {a: &one 1, b: [*one, 1]}\n", None),
    ],
)
def test_only_home_changes(before: str, after: str | None) -> None:
    changed = with_home(before, POSE, "x.yaml")
    assert after is None or changed == after
    data = yaml_text.load(changed, "x.yaml")
    assert data.pop("home") == POSE
    old = yaml_text.load(before, "x.yaml")
    old.pop("home", None)
    assert data == old


def test_a_file_that_shares_home_with_another_block_is_left_alone() -> None:
    shared = "urdf: u\nhome: {a: &one 1, b: [1, 1], 'c: d': 3}\nmotion: *one\n"
    with pytest.raises(pf.DescriptionError, match="an anchor"):
        with_home(shared, POSE, "x.yaml")
