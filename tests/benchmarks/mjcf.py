"""Robots of others: forces of every coordinate of an MJCF against MuJoCo's inverse dynamics.

    python -m tests.benchmarks.mjcf             those of dm_control, gymnasium, gymnasium-robotics
    python -m tests.benchmarks.mjcf FOLDER ...  every .xml and .mjcf below

At one random state each; loops, contacts and limits are off on both sides. A file that MuJoCo does
not compile, or in which nothing moves, is counted and not listed; a difference over 1e-10 is
followed by what pinflex says that it leaves out. The exit status is 1 if it names nothing that acts
by itself.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import warnings
import zipfile
from pathlib import Path

import mujoco

import pinflex as pf
from pinflex.description import description
from tests.mujoco_inverse import difference

PACKAGES = ("dm_control", "gymnasium", "gymnasium-robotics")
NEAR = 1e-10  # of the largest force
QUIET = ("the gears", "the control laws", "solref", "contacts", "sensors", "keyframes", "shapes",
         "the tendons", "the actuators", "the range", "the motors")  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", nargs="*", type=Path)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        if not asked.folders:
            fetch(Path(folder))
        return compare(asked.folders or [Path(folder)])


def fetch(folder: Path) -> None:
    """The wheels of the packages, unpacked."""
    pip = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "-d", str(folder)]
    subprocess.run([*pip, *PACKAGES], check=True, env={**os.environ, "PIP_NO_COLOR": "1"})
    for wheel in folder.glob("*.whl"):
        zipfile.ZipFile(wheel).extractall(folder)


def compare(folders: list[Path]) -> int:
    files = sorted(p for at in folders for end in ("xml", "mjcf") for p in at.rglob(f"*.{end}"))
    exact, named, silent, skipped = 0, 0, 0, 0
    for path in files:
        try:
            if not mujoco.MjModel.from_xml_path(str(path)).nv:
                raise ValueError("nothing moves")
        except ValueError:
            skipped += 1
            continue
        label = f"{path.parent.name}/{path.name}"
        try:
            off = difference(path)
        except pf.PinflexError as error:
            silent += 1
            print(f"{label:46} {error}", flush=True)
            continue
        print(f"{label:46} {off:8.1e}", flush=True)
        if off < NEAR:
            exact += 1
            continue
        said = [note.partition("not taken over: ")[2] for note in description.read(path).notes]
        causes = [note for note in said if not note.startswith(QUIET)]
        named, silent = named + bool(causes), silent + (not causes)
        print(*causes, sep="\n", flush=True)
    print(
        f"{exact} within {NEAR:g}, {named} further off for a reason that is named, {silent} "
        f"refused or without a reason; {skipped} files are parts of others"
    )
    return int(silent > 0)


if __name__ == "__main__":
    sys.exit(main())
