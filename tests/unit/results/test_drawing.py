"""Joints, visuals, loops, beam axes of a run: from its meta, or the texts of an older file.

Claims:
    Pages, pictures, figures
    - joints, visuals, loops and beam axes of a drawing are those that an older file's texts give |
      second reader | exact, axes 1e-12 | passes
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.results.drawing import drawing_of, urdf_parts
from pinflex.results.result import Result

OLDER = ("name", "level", "sources", "joints", "frames", "actuated")


@pytest.mark.parametrize("model", ["3rrr", "ur5", "delta"])
def test_an_older_file_is_drawn_alike(model: str) -> None:
    run = pf.solve(pf.load(model), level="quasistatic", samples=11)
    older = {k: v for k, v in run.meta.items() if k in OLDER}
    older["links"] = {link: {} for link in run.links}
    now, then = drawing_of(run.meta), drawing_of(older)
    assert len(now.joints) > 5 and bool(now.loops) == (model != "ur5")
    assert set(now.beams) == set(run.links)
    # every text has the same parts, and the default rule of beam axes is the one that was applied
    assert now.visuals == then.visuals and now.joints.keys() == then.joints.keys()
    for name, joint in now.joints.items():
        assert str(asdict(joint)) == str(asdict(then.joints[name]))
    for name, axes in now.beams.items():
        np.testing.assert_allclose(axes, then.beams[name], atol=1e-12)
    loops = {name: ties for name, ties in now.loops.items() if not name.startswith("spin of")}
    assert loops == then.loops  # idle spins of rods stand in no text


def test_a_visual_that_cannot_be_read_is_left_out() -> None:
    link = '<link name="a"><visual><geometry>{}</geometry></visual></link>'
    for text in ('<box size="1 x 1"/>', "<cone/>", "<mesh/>"):
        assert urdf_parts("<robot>" + link.format(text) + "</robot>")["visuals"] == {}
    found = urdf_parts("<robot>" + link.format('<sphere radius=".5"/>') + "</robot>")
    assert found["visuals"]["a"][0]["size"] == [0.5]


def test_a_damaged_drawing_is_named(tmp_path: Path) -> None:
    run = pf.solve(pf.load("3rrr"), level="rigid", samples=11)
    joints = json.loads(json.dumps(run.meta["drawing"]["joints"]))
    joints["motor_1"]["axis"] = [0.0, 1.0]
    meta = {**run.meta, "drawing": {"joints": joints}}
    file = Result(run.t, dict(run.arrays), meta).save(tmp_path / "run.npz")
    with pytest.raises(pf.DescriptionError, match="meta.drawing.joints.motor_1.axis: "):
        Result.load(file)
