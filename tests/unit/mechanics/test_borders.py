"""What sits on the border of two segments of a link belongs to one of them, to round-off or not.

Claims:
    Equations
    - a child, a rider on the border of two segments weighs once: nine borders beside it by an ulp,
      delta in 3 segments | sum of the links | 1e-12 | passes
    - its first frequency in 1, 2, 3, 4 segments | each other | 3e-3 | 2.4e-3
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import pinflex as pf
from tests.scenes import Body, load

# Link, place of the child along it, segments: with floats, some borders lie beside the child by an
# ulp, on either side (0.1 > 0.3 / 3).
BORDERS = (
    (0.3, 0.1, 3),
    (0.3, 0.2, 3),
    (0.6, 0.2, 3),
    (0.6, 0.4, 3),
    (1.2, 0.4, 3),
    (1.2, 0.8, 3),
    (0.7, 0.1, 7),
    (0.7, 0.2, 7),
    (0.9, 0.3, 3),
)
SUMS = 1e-12  # of the mass: sums of a few dozen stations


def rod(folder: Path, length: float, x: float, segments: int, inertia: str) -> pf.Mechanism:
    spread = 2.0 * length**2
    bodies = (
        Body("rod", "base", "continuous", axis=(0, 1, 0), mass=2.0, com=(length / 3, 0, 0),
             inertia=(1e-3, spread, spread)),
        Body("child", "rod", "continuous", xyz=(x, 0, 0), axis=(0, 1, 0), mass=2.0,
             inertia=(1e-3, 1e-3, 1e-3)),
    )  # fmt: skip
    yaml = f"""
actuated: [rod_joint, child_joint]
flexible:
  rod:
    material: {{E: 2.0e11, nu: 0.3, rho: 7800}}
    section: {{shape: rectangle, width: 0.02, thickness: 0.005}}
    length: {length}
    segments: {segments}
    axial: false
"""
    return load(folder, bodies, yaml, inertia=inertia)


@pytest.mark.parametrize("inertia", ["beam", "urdf"])
@pytest.mark.parametrize(("length", "x", "segments"), BORDERS)
def test_a_child_on_a_border_weighs_once(
    length: float, x: float, segments: int, inertia: str, tmp_path: Path
) -> None:
    """With `inertia: urdf` a rider sits at a third of the span, too: the link's own centre."""
    m = rod(tmp_path, length, x, segments, inertia)
    own = 7800 * 0.02 * 0.005 * length if inertia == "beam" else 2.0
    assert pin.computeTotalMass(m.flexible.expansion.model) == pytest.approx(own + 2.0, rel=SUMS)


def test_one_segment_and_more_have_the_same_first_frequency(tmp_path: Path) -> None:
    """In 3 segments the child is on a border: on both it would lower f1 by a quarter."""
    f1 = [pf.modes(rod(tmp_path, 0.3, 0.1, n, "beam")).frequencies[0] for n in (1, 2, 3, 4)]
    # One segment with two internal shapes lacks the kink of the moment under the child.
    np.testing.assert_allclose(f1, f1[-1], rtol=3e-3)


def test_three_segments_of_the_rods_of_delta_weigh_what_one_does() -> None:
    changes = ["flexible.rod_*.section.diameter=0.008", "flexible.rod_*.section.wall=0.001"]
    one, three = (pf.load("delta", [*changes, f"flexible.*.segments={n}"]) for n in (1, 3))
    masses = [pin.computeTotalMass(m.flexible.expansion.model) for m in (one, three)]
    tree = sum(link.inertia.mass for link in one.links if link.name != "base")
    np.testing.assert_allclose(masses, tree, rtol=SUMS)
