"""Equalities of an MJCF that hold a robot with a free base to the world: loops to the ground.

Claims:
    Machines
    - MJCF: a free base held to the world by connect (body, sites) and weld | MuJoCo 4 | 2e-4 m, rad
      | 1e-6 m (pins), 4e-5 m (weld: MuJoCo's gives way)
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf

MODEL = """
<mujoco model="table">
  <option gravity="0 0 -9.81" timestep="0.0005" integrator="RK4"/>
  <worldbody>
    <site name="nail" pos="0.6 0 1.0"/>
    <body name="hull" pos="0.1 0 1.0">
      <freejoint/>
      <inertial pos="0.1 0.05 0" mass="2" diaginertia="0.02 0.03 0.04"/>
      <body name="arm" pos="0.2 0 0">
        <joint name="elbow" type="hinge" axis="0 1 0"/>
        <inertial pos="0.15 0 0" mass="0.5" diaginertia="0.001 0.004 0.004"/>
        <site name="hand" pos="0.3 0 0"/>
      </body>
    </body>
  </worldbody>
  <equality>%s</equality>
</mujoco>
"""
STIFF = 'solref="0.001 1"'
HELD = {
    f'<connect name="pin" body1="hull" anchor="0 0 0" {STIFF}/>': ("spherical", 4),
    f'<connect name="pin" site1="hand" site2="nail" {STIFF}/>': ("spherical", 4),
    f'<weld name="pin" body1="hull" {STIFF}/>': ("weld", 1),
    f'<weld name="pin" body1="world" body2="hull" {STIFF}/>': ("weld", 1),
}


def written(folder: Path, equality: str) -> Path:
    path = folder / "table.xml"
    path.write_text(MODEL % equality, "utf-8")
    return path


@pytest.mark.parametrize("equality", HELD)
def test_a_free_base_is_held_where_the_file_draws_it(equality: str, tmp_path: Path) -> None:
    kind, mobility = HELD[equality]
    m = pf.load(written(tmp_path, equality))
    (loop,) = m.description.loops
    assert (loop.name, loop.kind, loop.frame_b) == ("pin", kind, "world")
    np.testing.assert_allclose(loop.at, (0.6, 0, 1) if "nail" in equality else (0.1, 0, 1))
    np.testing.assert_allclose(m.home[:7], [0.1, 0, 1, 0, 0, 0, 1], atol=1e-12)
    # The hull on a pinned arm may turn about itself: no motor is asked for that, and it is named.
    assert m.report.mobility + len(m.idle.rows) == mobility
    assert not any("pin" in note or "pos of hull" in note for note in m.description.notes)


@pytest.mark.parametrize("equality", list(HELD)[:3])
def test_it_falls_as_in_mujoco(equality: str, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    path = written(tmp_path, equality)
    r = pf.solve(pf.load(path), level="coupled", until=0.2, samples=3, dt=5e-4)
    other = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(other)
    while data.time < 0.2 - 1e-9:
        mujoco.mj_step(other, data)
    q = r.arrays["joint/q"][-1]
    # MuJoCo's equality gives way: a weld by 4e-5 m at this stiffness, pins by 1e-6 m.
    np.testing.assert_allclose(q[:3], data.qpos[:3], atol=2e-4)
    np.testing.assert_allclose(q[3:7], data.qpos[[4, 5, 6, 3]], atol=2e-4)
    elbow = np.arctan2(q[8], q[7])
    assert elbow == pytest.approx(data.qpos[7], abs=5e-4)


def test_a_weld_that_turns_the_base_is_named(tmp_path: Path) -> None:
    relpose = '<weld name="pin" body1="hull" relpose="0 0 0 0.8 0.6 0 0"/>'
    m = pf.load(written(tmp_path, relpose))
    assert m.description.loops == ()
    (note,) = (note for note in m.description.notes if "welds pin" in note)
    assert note.startswith("table.xml: not taken over: the welds pin, which turn a body")
