"""The kinetic energy of rotors, also where Pinocchio leaves it out.

Claims:
    Machines
    - kinetic energy of a rotor on an oblique axis, which Pinocchio 4.1 forgets | (I + J) v^2 / 2 |
      1e-12 | passes
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pinflex as pf

ARM = """<robot name="arm"><link name="base"/>
  <link name="rod"><inertial><mass value="2"/><inertia ixx="0.3" ixy="0" ixz="0" iyy="0.3" iyz="0"
    izz="0.3"/></inertial></link>
  <joint name="motor" type="continuous"><parent link="base"/><child link="rod"/>
    <axis xyz="AXIS"/></joint></robot>"""
SCENE = """urdf: arm.urdf
gravity: [0, 0, 0]
joints: {motor: {rotor_inertia: 0.5}}
motion: {kind: cycloid, joints: {motor: 1}, duration: 0.5}
"""


@pytest.mark.parametrize("axis", ["0 0 1", "0 -1 0", "0.6 0 0.8"])
def test_a_rotor_has_its_energy_whatever_its_axis(tmp_path: Path, axis: str) -> None:
    (tmp_path / "arm.urdf").write_text(ARM.replace("AXIS", axis), "utf-8")
    path = tmp_path / "arm.yaml"
    path.write_text(SCENE, "utf-8")
    run = pf.solve(pf.load(path), level="rigid", samples=21)
    speed = run.joint("motor").velocity
    energy = run.array("energy/kinetic")
    np.testing.assert_allclose(energy, 0.5 * (0.3 + 0.5) * speed**2, rtol=1e-12, atol=1e-15)
