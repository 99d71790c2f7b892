"""Arrays of a page: small, and right to a millionth of their largest number.

Claims:
    Pages, pictures, figures
    - numbers of a page against those of the run | half a millionth of the largest (of links
      coarser, as said), which is exact | 5e-7
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from pinflex.viewer.view import STEPS, Coarse, deflated, pack
from tests.pages import inflated


def unpacked(text: str) -> Any:
    """What page/load.js does, written a second time."""
    raw = inflated(text)
    start = 4 + int.from_bytes(raw[:4], "little")

    def placed(found: dict[str, Any]) -> Any:
        if "packed" not in found:
            return found
        size, at = int(np.prod(found["shape"])), start + found["packed"]
        planes = np.frombuffer(raw, np.uint8, 4 * size, at).reshape(4, -1)
        folded = sum(plane.astype(np.int64) << 8 * i for i, plane in enumerate(planes))
        steps = (folded >> 1) ^ -(folded & 1)
        series = steps.reshape(-1, found["shape"][0]).T if size else steps
        whole = np.cumsum(np.cumsum(series, axis=0), axis=0).reshape(found["shape"])
        for _ in range(found["along"]):
            whole = np.cumsum(whole, axis=1)
        return (found["step"] * whole).reshape(found["shape"])

    return json.loads(raw[4:start], object_hook=placed)


@pytest.mark.parametrize("size", range(9))
def test_bytes_come_back_whatever_their_number(size: int) -> None:
    raw = np.random.default_rng(size).bytes(size)
    assert inflated(deflated(raw)) == raw
    assert not set(deflated(raw)) & set("<>&\"'")  # as it is within any page


def test_numbers_come_back_to_half_a_step_and_the_largest_exactly() -> None:
    values = np.random.default_rng(1).normal(size=(200, 7, 3))
    found = unpacked(pack({"a": [values, {"b": np.float64(2)}], "name": "x"}))
    top = np.abs(values).max()
    assert np.abs(found["a"][0] - values).max() <= 0.501 * top / STEPS
    assert np.abs(found["a"][0]).max() == pytest.approx(top, rel=1e-15)
    assert (found["a"][1]["b"], found["name"]) == (2.0, "x")


@pytest.mark.parametrize("shape", [(0,), (1,), (5,), (1, 4), (3, 0)])
def test_integers_and_empty_arrays_come_back_as_they_are(shape: tuple[int, ...]) -> None:
    for kind in (np.uint16, np.int16):
        limits = np.iinfo(kind)
        values = np.resize(np.array([limits.max, limits.min, 7], dtype=kind), shape)
        assert np.array_equal(unpacked(pack(values.copy())), values)
    assert np.array_equal(unpacked(pack(np.zeros(shape))), np.zeros(shape))


def test_smooth_motion_takes_less_than_a_byte_a_number() -> None:
    t = np.linspace(0, 1, 601)[:, None]
    waves = np.sin(2 * np.pi * (3 * t + np.linspace(0, 1, 100)))
    assert len(pack(waves)) < 0.6 * waves.size  # 0.47 measured; 5.3 as float32 in base64


def test_waves_along_a_link_take_half_of_it_and_come_back() -> None:
    t, x = np.linspace(0, 1, 201)[:, None, None], np.linspace(0, 1, 21)[None, :, None]
    waves = np.sin(20 * t) * np.sin(np.pi * x) * np.array([1.0, 0.3, -0.1])
    text = pack({"w": Coarse(waves, 2**12), "again": Coarse(waves.copy(), 2**12)})
    found = unpacked(text)
    assert np.abs(found["w"] - waves).max() <= 0.501 / 2**12 * np.abs(waves).max()
    assert np.array_equal(found["w"], found["again"])
    once = pack({"w": Coarse(waves, 2**12)})
    assert len(text) < len(once) + 200  # equal arrays are kept once
    shuffled = np.ascontiguousarray(np.random.default_rng(2).permutation(waves.swapaxes(0, 1)))
    assert len(once) < 0.5 * len(pack({"w": Coarse(shuffled.swapaxes(0, 1), 2**12)}))


def test_what_is_no_data_is_refused() -> None:
    with pytest.raises(TypeError, match="set has no place in a page"):
        pack({"a": {1, 2}})
