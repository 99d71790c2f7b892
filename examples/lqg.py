"""LQG on the linear model, in the loop with a flexible arm: one motor, one encoder.

A blow on the tip of an arm of 0.8 m; the torque acts one sample late. A PD law, the best of 15
pairs of gains, holds the motor. A linear-quadratic regulator with a Kalman filter, made of
`pf.linearise` at 1 kHz with the delay as a state, reads the same encoder of 17 bit and takes more
of the swing out through the same motor.

Source: Astrom, Wittenmark (1997), Computer-Controlled Systems, ch. 11 (LQG, delay as a state).
"""

from pathlib import Path

import numpy as np
from scipy.linalg import expm, solve_discrete_are

import pinflex as pf

DT, TICK = 1e-3, 2 * np.pi / 2**17  # [s], [rad]
ARM = Path(__file__).parent / "arm" / "arm.yaml"
BLOW = "forces={blow: {at: tip, force: [0, 1, 0], until: 0.03}}"  # [N], [s]


class Lqg:
    """Torque from the encoder; the torque that is on its way is a state."""

    def __init__(self, robot: pf.Mechanism) -> None:
        model = pf.linearise(robot, outputs=["hub", "tip.y"], forces=["tip.y"], modes=3)
        n = len(model.A)
        held = expm(DT * np.block([[model.A, model.B], [np.zeros((2, n + 2))]]))
        torque, blow = held[:n, n], np.append(held[:n, n + 1], 0.0)
        self.F = np.block([[held[:n, :n], torque[:, None]], [np.zeros((1, n + 1))]])
        self.G = np.append(np.zeros(n), 1.0)[:, None]
        self.encoder, tip = np.hstack([model.C, np.zeros((2, 1))])
        P = solve_discrete_are(self.F, self.G, 1e5 * np.outer(tip, tip), np.eye(1))
        self.K = (self.G.T @ P @ self.F / (1.0 + self.G.T @ P @ self.G))[0]
        # What the filter expects: pushes of 0.01 N at the tip every sample, and a tick of noise.
        noise = np.array([[TICK**2]])
        S = solve_discrete_are(self.F.T, self.encoder[:, None], 1e-4 * np.outer(blow, blow), noise)
        self.L = S @ self.encoder / (self.encoder @ S @ self.encoder + noise[0, 0])
        self.x = np.zeros(n + 1)

    def __call__(self, read: float) -> float:
        x = self.x + self.L * (read - self.encoder @ self.x)
        u = -float(self.K @ x)
        self.x = self.F @ x + self.G[:, 0] * u
        return u


class Pd:
    """Torque from the encoder and its difference over two samples."""

    def __init__(self) -> None:
        self.before = [0.0, 0.0]

    def __call__(self, read: float) -> float:
        self.before = [*self.before[-2:], read]
        return -5.0 * read - 1.0 * (read - self.before[-3]) / (2 * DT)


def swing(arm: pf.Simulator, law) -> tuple[np.ndarray, float]:
    """Tip off its place [m] after every step, and the largest torque [N m]."""
    arm.reset()
    off, torque, peak = [], 0.0, 0.0
    for _ in range(1500):
        read = TICK * round(float(arm.motors.position[0]) / TICK)
        arm.step(torque=[torque])
        torque = law(read)  # it acts one sample later
        peak = max(peak, abs(torque))
        off.append(float(arm.frame("tip").position[1]))
    return np.array(off), peak


def main() -> dict[str, float]:
    robot = pf.load(str(ARM), [BLOW])
    arm = pf.Simulator(robot, dt=DT)
    left = {}
    for name, law in {"PD": Pd(), "LQG": Lqg(robot)}.items():
        off, peak = swing(arm, law)
        left[name] = float(np.abs(off[1000:]).max())
        print(
            f"{name:>4}: the tip goes {1e3 * np.abs(off).max():.1f} mm, after one second it still "
            f"swings by {1e3 * left[name]:.3f} mm; {peak:.2f} N m"
        )
    assert left["LQG"] < 0.25 * left["PD"]
    return left


if __name__ == "__main__":
    main()
