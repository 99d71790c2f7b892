"""The compact file of a run: what is exact, what is rounded and by how much, what it refuses.

Claims:
    Equations
    - compact file of a run: states bit for bit, fields within half a step; displacement from rigid
      too | step 2^-20 | 4.8e-7 | 4.77e-7; delta: 7.5 MB for 45 MB
    - what compare draws without reading its files back: what they hold | the file | exact | exact
    - its arrays again from its states | the run itself | 1e-11 | passes
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.results import archive
from pinflex.results.archive import STEPS, decode, encode
from pinflex.viewer.scene import build_scene


@pytest.fixture(scope="module")
def run() -> pf.Result:
    return pf.solve(pf.load("3rrr"), level="coupled", until=0.1, samples=201, dt=2.5e-4)


def apart(back: np.ndarray, values: np.ndarray) -> float:
    """Largest difference over the largest value of its component."""
    axes = tuple(range(values.ndim - 1)) if values.ndim > 2 else None
    largest = np.abs(values).max(axis=axes, keepdims=True)
    return float(np.max(np.abs(back - values) / np.where(largest > 0, largest, 1.0)))


def test_states_are_exact_and_fields_within_half_a_step(run: pf.Result, tmp_path: Path) -> None:
    back = pf.Result.load(run.save(tmp_path / "run.npz", compact=True))
    assert back.arrays.keys() == run.arrays.keys()
    rounded = set()
    for key, values in run.arrays.items():
        if not np.array_equal(back.arrays[key], values):
            rounded.add(key.split("/")[0])
            half = 0.5 + 0.5 * (f"{key}_rigid" in run.arrays)  # of it, and of its difference
            assert apart(back.arrays[key], values) <= 1.000001 * half / STEPS  # by design
    assert rounded == {"link", "body"}
    assert "5e-7" in back.meta["rounded"] and "rounded" not in run.meta


@pytest.mark.parametrize("compact", [True, False])
def test_what_is_drawn_without_the_file_is_what_the_file_holds(
    run: pf.Result, tmp_path: Path, compact: bool
) -> None:
    back = pf.Result.load(run.save(tmp_path / "run.npz", compact=compact))
    read: dict[str, np.ndarray] = {}
    members = archive.contents(run.t, run.arrays, run.meta, compact, read)
    assert archive.meta_of(members) == dict(back.meta) and read.keys() == back.arrays.keys()
    for key, values in read.items():
        np.testing.assert_array_equal(values, back.arrays[key], key)


def test_recomputed_from_its_states_it_is_the_run_again(run: pf.Result, tmp_path: Path) -> None:
    back = pf.Result.load(run.save(tmp_path / "run.npz", compact=True))
    again = pf.recompute(pf.load("3rrr"), back)
    assert again.arrays.keys() == run.arrays.keys() and "rounded" not in again.meta
    for key, values in run.arrays.items():
        if values.size:  # the same equations on the same states: round-off
            scale = float(np.abs(values).max()) or 1.0
            assert np.abs(again.arrays[key] - values).max() <= 1e-11 * scale, key
    with pytest.raises(pf.DescriptionError, match="Give the mechanism that was solved"):
        pf.recompute(pf.load("ur5"), back)


def test_it_is_a_fraction_of_the_exact_file(run: pf.Result, tmp_path: Path) -> None:
    whole, small = run.save(tmp_path / "a.npz"), run.save(tmp_path / "b.npz", compact=True)
    assert small.stat().st_size < whole.stat().st_size / 4  # delta, 401 instants: a sixth


def test_the_exact_file_is_that_of_an_older_pinflex(run: pf.Result, tmp_path: Path) -> None:
    for compact, number in ((False, 1), (True, archive.FORMAT)):
        path = run.save(tmp_path / "run.npz", compact=compact)
        with np.load(path, allow_pickle=False) as npz:
            assert json.loads(str(npz[archive.HEADER]))["format"] == number
    back = pf.Result.load(run.save(tmp_path / "exact.npz"))
    assert all(np.array_equal(back.arrays[k], x) for k, x in run.arrays.items())


def test_a_run_goes_on_from_a_compact_file(tmp_path: Path) -> None:
    robot, keys = pf.load("3rrr"), {"level": "coupled", "dt": 5e-4}
    half = pf.solve(robot, until=0.02, samples=21, **keys)
    on = [
        pf.solve(robot, until=0.03, resume=half.save(tmp_path / "half.npz", compact), **keys)
        for compact in (False, True)
    ]
    assert np.array_equal(on[0].torque, on[1].torque)


def test_a_small_displacement_is_as_fine_as_a_large_one(run: pf.Result, tmp_path: Path) -> None:
    """The platform is off by micrometres: a millionth of a position would hide it."""
    back = pf.Result.load(run.save(tmp_path / "run.npz", compact=True))
    for name in (*(f"link/{x}/centreline" for x in run.links), "body/crank_1/pose"):
        away, kept = (r.arrays[name] - r.arrays[f"{name}_rigid"] for r in (run, back))
        # half a step, and the rounding of positions of a metre
        assert np.abs(kept - away).max() <= 0.5 / STEPS * np.abs(away).max() + 1e-15


def test_its_page_shows_the_same_scene(run: pf.Result, tmp_path: Path) -> None:
    back = pf.Result.load(run.save(tmp_path / "run.npz", compact=True))
    scenes = [build_scene(r, meshes=None) for r in (run, back)]
    assert scenes[0]["scale"] == pytest.approx(scenes[1]["scale"], rel=1e-5)
    for link, again in zip(*(scene["links"] for scene in scenes), strict=True):
        for part in ("disp", "rigid"):
            # the page itself keeps steps of a millionth
            assert np.abs(link[part] - again[part]).max() <= 2e-6 * np.abs(link[part]).max()


@pytest.mark.parametrize("shape", [(5,), (4, 3), (6, 7, 6), (3, 2, 3, 4), (1, 1)])
def test_any_array_goes_there_and_back(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(1).standard_normal(shape) * np.logspace(-9, 9, shape[-1])
    for key in ("eta", "body/a/pose", "link/a/deflection"):
        members, coded = encode({key: values})
        back = decode(key, np.asarray(members[key]), coded[key])
        assert back.shape == shape
        assert np.array_equal(back, values) if key == "eta" else apart(back, values) < 5e-7


def test_what_has_no_number_or_no_time_is_kept_as_it_is() -> None:
    hole = np.array([[1.0, np.nan], [np.inf, 2.0]])
    arrays = {"link/a/deflection": hole, "link/a/x": np.arange(3.0), "eta": np.zeros((2, 0))}
    members, coded = encode(arrays)
    assert set(coded) == {"link/a/deflection"} and "step" not in coded["link/a/deflection"]
    back = decode("k", np.asarray(members["link/a/deflection"]), coded["link/a/deflection"])
    assert np.array_equal(back, hole, equal_nan=True)
    assert members["link/a/x"] is arrays["link/a/x"]


@pytest.mark.parametrize(
    "change",
    [{"shape": [3, 10**9]}, {"shape": []}, {"shape": [-2, 3]}, {"shape": "x"}, {"step": ["a"]}],
)
def test_a_file_that_says_wrong_shapes_is_damaged(change: dict[str, Any], tmp_path: Path) -> None:
    values = {"link/a/stress/axial": np.arange(12.0).reshape(4, 3)}
    contents = archive.contents(np.arange(4.0), values, {}, compact=True)
    header = json.loads(str(contents[archive.HEADER]))
    header["coded"]["link/a/stress/axial"] |= change
    np.savez(tmp_path / "bad.npz", **contents | {archive.HEADER: np.array(json.dumps(header))})
    with pytest.raises(pf.DescriptionError, match=r"bad\.npz"):
        pf.Result.load(tmp_path / "bad.npz")
