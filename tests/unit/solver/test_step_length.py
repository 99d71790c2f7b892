"""Default steps of a beam, by its closed form.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - default step: a fortieth of the third period of a cantilever | closed form | 1e-3 | passes
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from pinflex.levels.modes import default_step
from tests.scenes import UNIT_BEAM, Body, load

THIRD = 7.85475744**2 / (2.0 * math.pi)  # Hz: cos x cosh x = -1, with EI = rho A = L = 1


def test_a_step_is_a_fortieth_of_the_third_period_or_a_part_of_the_run(tmp_path: Path) -> None:
    bodies = (Body("beam", "base"), Body("tip", "beam", xyz=(1, 0, 0)))
    m = load(tmp_path, bodies, f"gravity: [0, 0, 0]\nactuated: []\nflexible:{UNIT_BEAM}",
             ["flexible.beam.basis.internal=4"])  # fmt: skip
    # 1e-3: what four modes of the held beam leave of its third
    assert default_step(m, 100.0) == pytest.approx(1.0 / (40.0 * THIRD), rel=1e-3)
    assert default_step(m, 0.1) == 0.1 / 400.0
