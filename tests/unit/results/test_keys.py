"""Every array of a result stands in the table of keys, as it is there, and is drawn by its key."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.recovery import recover
from pinflex.results import quantities
from pinflex.results.drives import DriveView
from pinflex.results.quantities import KEYS, Key, joint_unit, key_of, unit_of
from pinflex.results.result import Result
from pinflex.results.views import FrameView, JointView, LinkView, LoopView

ROOT = Path(pf.__file__).parents[1]
SHORT = {"until": 2e-3, "samples": 3}
SIZES = {"nt": 3, "nx": 21}  # sections of a link of one body
# Runs that hold all kinds of arrays between them, but those of `ELSEWHERE`.
RUNS = {
    "ked": lambda: pf.solve("3rrr", level="ked", **SHORT),
    "geared": lambda: pf.solve(ROOT / "models/ur5/geared.yaml", level="coupled", dt=1e-3, **SHORT),
}
ELSEWHERE = {"control/NAME", "measured", "rigid/torque", "energy/loads", "loop/NAME/orbit"}
ELSEWHERE |= {f"link/NAME/mesh/{what}" for what in ("nodes", "triangles", "von_mises")}


@pytest.fixture(scope="module")
def runs() -> dict[str, Result]:
    return {name: make() for name, make in RUNS.items()}


def test_every_array_is_in_the_table_as_it_is_there(runs: dict[str, Result]) -> None:
    seen = set()
    for run in runs.values():
        for key in (*run.arrays, "shaking", f"reaction_world/{run.joints[0]}"):
            known, shape = key_of(key), run[key].shape
            assert known is not None, key
            wanted = re.findall(r"\w+", known.shape)
            assert len(shape) == len(wanted), key
            for size, word in zip(shape, wanted, strict=True):
                fixed = int(word) if word.isdigit() else SIZES.get(word, size)
                assert size == fixed, key
            one = shape[2:] if key.startswith("link/") else shape[1:]
            assert len(known.columns) in (0, int(np.prod(one))), key
            seen.add(known.key)
    assert {one.key for one in KEYS} - seen == ELSEWHERE


def test_every_array_is_drawn_by_its_key(runs: dict[str, Result], plt: Any) -> None:
    for run in runs.values():
        for key in (*run.arrays, "shaking"):
            ax, values = run.plot(key), run[key]
            if key.startswith("link/") and values.ndim > 1:
                place = np.abs(values).max(axis=(0, *range(2, values.ndim))).argmax()
                values = values[:, place]
            drawn = [line.get_ydata() for line in ax.lines]
            assert np.reshape(drawn, (-1, len(values))) == pytest.approx(
                values.reshape(len(values), -1).T
            ), key
            unit = run.unit(key)
            assert not unit or "torque" in key or ax.get_ylabel().endswith(f"[{unit}]"), key
            plt.close("all")


def test_units_are_those_of_the_quantity(runs: dict[str, Result]) -> None:
    """Of a pressure, a force, a rotation, a speed; and of one joint what its kind asks for."""
    run = runs["ked"]
    units = {"link/distal_1/stress/von_mises": "Pa", "link/distal_1/resultant": "N, N m"}
    units |= {"frame/platform/rotation": "", "frame/platform/velocity": "m/s, rad/s"}
    units |= {"torque": "N m", "torque/motor_1": "N m", "joint/q/motor_1": "rad", "t": "s"}
    assert {key: run.unit(key) for key in units} == units
    hexapod = pf.solve("hexapod", level="rigid", **SHORT)
    assert hexapod.unit("torque/slide_1") == "N" and hexapod.unit("joint/v/slide_1") == "m/s"


def test_the_page_has_every_key_once() -> None:
    sys.path.insert(0, str(ROOT / "docs/make"))
    try:
        import output_keys  # type: ignore[import-not-found]
    finally:
        sys.path.pop(0)
    rows = re.findall(r"^\| `([^`]+)` \|", output_keys.page(), re.M)
    assert rows == [one.key for one in KEYS]
    assert {line.count("|") for line in output_keys.page().splitlines() if line[:1] == "|"} == {6}


def test_views_show_keys_of_the_table() -> None:
    for view in (JointView, FrameView, LinkView, LoopView, DriveView):
        assert len(view.arrays) > 0
        for attribute, key in view.arrays.items():
            assert hasattr(view, attribute) and unit_of(key) is not None, key
    assert FrameView.position.__doc__ == (
        "Origin of an output frame, in the world [m], shape (nt, 3)."
    )


def test_units_of_a_joint_that_slides() -> None:
    """By dimensions: work is torque times angle and force times way, in J both."""
    keys = ("joint/q", "joint/v", "joint/a", "torque")
    assert [joint_unit(key, True) for key in keys] == ["m", "m/s", "m/s^2", "N"]
    assert [joint_unit(key, False) for key in keys] == ["rad", "rad/s", "rad/s^2", "N m"]
    assert joint_unit("drive/NAME/power", True) == "W"


def test_a_row_that_says_how_is_a_quantity_of_every_run_and_of_its_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Power of the motors, beside what the run's own torques and speeds make."""
    power = Key(
        "power", "(nt,)", "W", "mechanical power of the motors",
        of=lambda s: (s.run.torque * s.run.v[:, s.run.system.motors]).sum(axis=1),
    )  # fmt: skip
    none = Key("absent", "(nt,)", "", "nothing that this run has", of=lambda s: None)
    for module in (quantities, recover):
        monkeypatch.setattr(module, "KEYS", (*KEYS, power, none))
    key_of.cache_clear()
    run = pf.solve("3rrr", level="ked", **SHORT)
    own = sum(run.torque[:, k] * run.joint(name).velocity for k, name in enumerate(run.motors))
    for result in (run, Result.load(run.save(tmp_path / "run.npz"))):
        assert np.max(np.abs(own)) > 0.0
        np.testing.assert_allclose(result["power"], own, rtol=1e-14)  # the same sums in any order
        assert result.unit("power") == "W" and "absent" not in result.arrays
    monkeypatch.undo()
    key_of.cache_clear()
