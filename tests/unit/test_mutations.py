"""Mutations (tests/mutations.py) are of the code as it is: each finds its place, and its tests."""

from __future__ import annotations

import subprocess
import sys

from tests.mutations import MUTATIONS, ROOT

# Instead of changing a module or the kernel: is there one place that reads so?
_LOOKS = """
def altered(module, old, new):
    import importlib.util
    looked(importlib.util.find_spec(module).origin, old)

def recompiled(file, old, new):
    from pinflex.kernel import build
    looked(build.SOURCE / file, old)

def looked(file, old):
    import pathlib
    count = pathlib.Path(file).read_text().count(old)
    assert count == 1, f"{count} places of {file} read {old!r}"
"""
_EACH = """
from tests.mutations import MUTATIONS
for name, (code, _) in MUTATIONS.items():
    try:
        exec(code, dict(globals()))
    except Exception as error:
        print(f"{name}: {type(error).__name__}: {error}")
"""


def test_every_mutation_finds_its_place():
    done = subprocess.run(
        [sys.executable, "-c", _LOOKS + _EACH],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert not done.returncode, done.stderr
    assert not done.stdout, done.stdout


def test_every_mutation_has_tests_to_notice_it():
    for name, (_, paths) in MUTATIONS.items():
        assert paths, name
        for path in paths:
            assert (ROOT / path.split("::")[0]).exists(), f"{name}: {path}"
