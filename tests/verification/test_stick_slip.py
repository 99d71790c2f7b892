"""What a run tells of the error of its smooth friction, against masses on belts in closed form.

Claims:
    Beams (frequencies relative; L = m = E I = 1)
    - masses on belts: the error of the default smooth friction that a run tells; with what it
      proposes | closed form | told/true 0.4 to 3; 1 % | 0.64 to 2.6; 0.7 %
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from tests.scenes import Body, load


@dataclass(frozen=True)
class Belt:
    """A mass on a belt, held back by a spring: kg, N/m, m/s, N.

    Source: Popp & Stelzer (1990), Phil. Trans. R. Soc. A 332: stick-slip of a single mass.
    """

    mass: float = 1.0
    spring: float = 100.0
    belt: float = 0.05
    static: float = 1.5
    sliding: float = 1.0

    def run(self, folder: Path, friction: str = "") -> pf.Result:
        """Until 2.2 periods after it has broken away."""
        rubs = f"coulomb: {self.sliding}, breakaway: {self.static}{friction}"
        bodies = (
            Body("belt", "base", "prismatic", axis=(1, 0, 0)),
            Body("block", "belt", "prismatic", axis=(1, 0, 0), mass=self.mass),
            Body("wall", "base", xyz=(-1, 0, 0)),
        )
        end = self.breaks + 2.2 * self.period
        yaml = f"""gravity: [0, 0, 0]
actuated: [belt_joint]
joints: {{block_joint: {{friction: {{{rubs}}}}}}}
springs: {{rubber: {{between: [wall, block], stiffness: {self.spring}, length: 1}}}}
motion: {{kind: formula, joints: {{belt_joint: "{self.belt}*t"}}, duration: {end}}}
"""
        return pf.solve(load(folder, bodies, yaml), level="coupled", tol=1e-3, samples=2001)

    @property
    def breaks(self) -> float:
        """When it first breaks away [s]."""
        return self.static / self.spring / self.belt

    @property
    def swing(self) -> float:
        """Half of what it moves to and fro [m]."""
        jump = (self.static - self.sliding) / self.spring
        return float(np.hypot(jump, self.belt * np.sqrt(self.mass / self.spring)))

    @property
    def period(self) -> float:
        """Of sticking and slipping [s]."""
        w, jump = np.sqrt(self.spring / self.mass), (self.static - self.sliding) / self.spring
        return float(2 * (np.pi - np.arctan(jump * w / self.belt)) / w + 2 * jump / self.belt)

    def errors(self, run: pf.Result) -> tuple[float, float]:
        """Relative errors of swing and period."""
        x = run.joint("belt_joint").position + run.joint("block_joint").position
        top = np.flatnonzero((x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:])) + 1
        swing, period = 0.5 * np.ptp(x[run.t > self.breaks]), run.t[top[1]] - run.t[top[0]]
        return float(swing / self.swing - 1), float(period / self.period - 1)


def said(run: pf.Result) -> list[str]:
    return [text for text in run.meta["warnings"] if "sticks and slips" in text]


BELTS = [Belt(), Belt(belt=0.01), Belt(belt=0.2), Belt(mass=10.0), Belt(static=1.1)]


@pytest.mark.parametrize("belt", BELTS)
def test_a_run_tells_what_its_smooth_friction_costs(belt: Belt, tmp_path: Path) -> None:
    run = belt.run(tmp_path)
    (text,) = said(run)
    assert text.startswith("block_joint: it sticks and slips")
    told = float(re.search(r"off by about ([\d.]+) %", text)[1]) / 100  # type: ignore[index]
    true = max(abs(error) for error in belt.errors(run))
    # 0.64 to 2.6 measured: the law is that of the delay, not what each scene makes of it.
    assert 0.4 < told / true < 3.0


@pytest.mark.parametrize("belt", BELTS[::3])
def test_what_it_proposes_is_right_to_one_per_cent(belt: Belt, tmp_path: Path) -> None:
    (text,) = said(belt.run(tmp_path))
    better = belt.run(tmp_path, f", {re.search(r'(stribeck: [^,]*, speed: .*), ...', text)[1]}")  # type: ignore[index]
    assert not said(better)
    assert max(abs(error) for error in belt.errors(better)) < 0.01  # 0.7 and 0.5 % measured


def test_a_joint_that_stops_and_stays_is_not_spoken_of(tmp_path: Path) -> None:
    bodies = (Body("block", "base", "prismatic", axis=(1, 0, 0), mass=2.0),)
    robot = load(tmp_path, bodies, """gravity: [0, 0, 0]
actuated: []
joints: {block_joint: {friction: {coulomb: 4.0, breakaway: 6.0}}}
solve: {level: coupled, until: 1.0, samples: 101, start_speeds: {block_joint: 0.8}}
""")  # fmt: skip
    run = pf.solve(robot)
    assert run.joint("block_joint").velocity[-1] == pytest.approx(0.0, abs=1e-3)
    assert not said(run)
