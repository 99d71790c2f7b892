"""A controller in C around the exported robot: the same loop as in Python, number by number.

`pf.export_c` writes the flexible UR5 as C sources. The main program here is a PD law at 1 kHz that
turns the shoulder by 0.2 rad; it is compiled with the robot, and its table is held against the
same law around `pf.Simulator`.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import pinflex as pf

STEPS, TURN, RISE = 400, 0.2, 0.3  # steps of 1 ms, [rad], [s]
STIFF = np.array([400.0, 400.0, 200.0, 10.0, 10.0, 1.0])  # [N m/rad]; 0.1 s of it damp
LAW = r"""
#include "robot.h"
#include <stdio.h>

static const double stiff[6] = {400, 400, 200, 10, 10, 1};

int main(void) {
  Robot *robot = robot_new();
  double now[256], start[6], hold[6], command[6]; /* now: torques, positions, velocities, ... */
  if (!robot || robot_outputs() > 256) return 1;
  robot_read(robot, now);
  for (int k = 0; k < 6; k++) hold[k] = now[k], start[k] = now[6 + k];
  for (int step = 0; step < 400; step++) {
    double s = robot_time(robot) / 0.3;
    s = s < 1.0 ? s : 1.0;
    for (int k = 0; k < 6; k++) {
      double goal = start[k] + (k ? 0.0 : 0.2 * (s * s * s * (10.0 + s * (6.0 * s - 15.0))));
      command[k] = hold[k] + stiff[k] * (goal - now[6 + k]) - 0.1 * stiff[k] * now[12 + k];
    }
    int said = robot_step(robot, command);
    if (said != ROBOT_DONE) return said;
    robot_read(robot, now);
    printf("%.17g %.17g\n", now[6], now[12]);
  }
  robot_free(robot);
  return 0;
}
"""


def compiler() -> list[str]:
    """A C compiler: the machine's own, or that of the package ziglang."""
    own = next(filter(None, map(shutil.which, (os.environ.get("CC", "cc"), "gcc", "clang"))), None)
    return [own] if own else [sys.executable, "-m", "ziglang", "cc"]


def in_c(arm: pf.Simulator, folder: Path) -> np.ndarray:
    """Position and velocity of the shoulder after every step, shape (steps, 2)."""
    sources = pf.export_c(arm, folder / "robot")
    (sources / "main.c").write_text(LAW)
    program = folder / "loop"
    files = [str(path) for path in sorted(sources.glob("*.c"))]
    subprocess.run([*compiler(), "-O2", "-o", str(program), *files, "-lm"], check=True)
    table = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    return np.array([line.split() for line in table.splitlines()], float)


def in_python(arm: pf.Simulator) -> np.ndarray:
    """The same by `pf.Simulator`."""
    hold, start, rows = arm.motors.torque, arm.motors.position, []
    for _ in range(STEPS):
        s = min(arm.time / RISE, 1.0)
        goal = start.copy()
        goal[0] += TURN * (s**3 * (10 + s * (6 * s - 15)))
        now = arm.motors
        arm.step(torque=hold + STIFF * (goal - now.position) - 0.1 * STIFF * now.velocity)
        rows.append([arm.motors.position[0], arm.motors.velocity[0]])
    return np.array(rows)


def main() -> float:
    arm = pf.Simulator("ur5", dt=1e-3)
    arm.step(torque=arm.motors.torque)  # from here on motors are pushed, in C as well
    arm.reset()
    with tempfile.TemporaryDirectory() as folder:
        c = in_c(arm, Path(folder))
    python = in_python(arm)
    apart = float(np.abs(c - python).max())
    print(f"shoulder at {c[-1, 0]:.6f} rad after {STEPS} ms; C and Python apart by {apart:.1e}")
    assert abs(c[-1, 0] - TURN) < 0.02
    assert apart < 1e-10
    return apart


if __name__ == "__main__":
    main()
