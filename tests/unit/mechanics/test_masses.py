"""Models weigh what Pinocchio adds up, and `load` refuses one that does not.

Claims:
    Equations
    - mass, first moment, inertia of 40 random links in 1 to 9 segments with children and riders,
      half on borders (500, every model, 65 robots: `benchmarks/masses.py`) | Pinocchio's sum of the
      URDF; uniform rod | 1e-12 | 8e-15
    - a link that weighs twice, or sits 1 um off its place, is refused by `load` | - | - | passes
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from pinflex.mechanics.model import expansion
from pinflex.mechanics.model.loads import Attachment
from tests.benchmarks.masses import modelled, off_scene, random_rod, share
from tests.every_model import manifold
from tests.scenes import Body, load

ROUNDING = 1e-12  # sums of up to 200 stations and some inertias


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_random_links_weigh_what_their_urdf_and_a_uniform_rod_do(first: int) -> None:
    for seed in range(first, first + 10):
        rod = random_rod(seed)
        m = rod.build()
        assert share(modelled(m), rod.weight(m)) < ROUNDING, seed


def test_every_joint_rotors_and_added_masses_are_counted(tmp_path: Path) -> None:
    more = "added_masses: {water: {at: hand, mass: [3, 1, 2], inertia: [0.1, 0.2, 0.3]}}\n"
    heavy, light = manifold(tmp_path, more), manifold(tmp_path)
    assert off_scene(heavy) < ROUNDING
    assert (modelled(heavy) - modelled(light)).trace() > 6.0  # 3 + 1 + 2 kg, whatever the axes


def test_what_cannot_move_is_not_counted(tmp_path: Path) -> None:
    """A beam on the ground: its end mass at the root and a motor's housing there stay at rest."""
    bodies = (
        Body("beam", "base"),
        Body("housing", "beam", mass=5.0, inertia=(1e-2, 1e-2, 1e-2)),
        Body("end", "beam", xyz=(1, 0, 0), mass=2.0, inertia=(1e-2, 1e-2, 1e-2)),
    )
    yaml = """
actuated: []
flexible:
  beam:
    material: {E: 7.0e10, nu: 0.3, rho: 2700}
    section: {shape: rectangle, width: 0.02, thickness: 0.01}
    end: end
    root: {mass: 3}
    tip: {mass: 1}
"""
    m = load(tmp_path, bodies, yaml)
    assert modelled(m)[0, 0] == pytest.approx(2700 * 2e-4 + 2.0 + 1.0, rel=ROUNDING)


def test_a_link_that_weighs_twice_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    real = expansion._Assembler._append

    def twice(self: expansion._Assembler, *args: Any, **kwargs: Any) -> None:
        for _ in range(1 + self.flexible):
            real(self, *args, **kwargs)

    monkeypatch.setattr(expansion._Assembler, "_append", twice)
    with pytest.raises(pf.AssemblyError, match="internal error: .* does not weigh .* report it"):
        pf.load("ur5")


def test_a_link_a_micrometre_off_its_place_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    real = expansion._Assembler._child

    def beside(
        self: expansion._Assembler, number: int, here: Attachment, placement: pin.SE3
    ) -> None:
        off = np.array([1e-6 if self.flexible and number > 3 else 0.0, 0.0, 0.0])
        real(self, number, here, placement * pin.SE3(np.eye(3), off))

    monkeypatch.setattr(expansion._Assembler, "_child", beside)
    with pytest.raises(pf.AssemblyError, match="inertia at home are off by"):
        pf.load("ur5")
