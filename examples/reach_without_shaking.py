"""A gymnasium environment: a flexible arm learns to reach without shaking.

The motor turns the arm by half a radian with at most 8 rad/s^2; the tip has to stay within 1 mm.
The action is the acceleration of the motor, 50 times a second; the observation is the way left, a
speed that it still leaves to brake, the speed, and the bending at the root with its rate. Five
numbers are learned: a linear policy, by the noisy cross-entropy method. It is held against a
quintic of the same limit, shaped against the first frequency, which takes 0.71 s. Of five seeds
one beats it clearly (0.56 s); the others end at 0.74, 0.82, 0.92 and 0.94 s.

Source: Szita, Lorincz (2006), Learning Tetris using the noisy cross-entropy method.
"""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import pinflex as pf

ARM = Path(__file__).parent / "arm" / "arm.yaml"
GOAL, MOST, BAND = 0.5, 8.0, 1e-3  # [rad], [rad/s^2], [m]
DT, EVERY, STEPS = 2e-3, 10, 60  # [s], steps of the robot an action, actions: 1.2 s

UNTRAINED = np.array([6.0, 0.0, -2.0, 0.0, 0.0])
TRAINED = np.array([5.61, 2.87, -2.76, -3.01, -0.94])  # learned(env, seed=4), 240 episodes


class Reach(gym.Env):
    """Acceleration of the motor in, reward for a tip that is near its goal out."""

    action_space = gym.spaces.Box(-1.0, 1.0, (1,))
    observation_space = gym.spaces.Box(-np.inf, np.inf, (5,))

    def __init__(self, robot: pf.Mechanism) -> None:
        gauge = pf.StrainGauge("beam", x=0.0, y=0.0015)
        self.arm = pf.Simulator(robot, dt=DT, sensors={"root": gauge})
        self.goal = 0.8 * np.array([np.cos(GOAL), np.sin(GOAL)])

    def _seen(self) -> np.ndarray:
        at, strain = self.arm.motors, 1e3 * float(self.arm.sensor("root"))
        rate, self.strain = (strain - self.strain) / (EVERY * DT), strain
        left = GOAL - at.position[0]
        brakes = left / np.sqrt(abs(left) + 0.05)  # goes as the speed that can still be braked
        return np.array([left, brakes, at.velocity[0], strain, 0.1 * rate], np.float32)

    def off(self) -> float:
        """Distance of the tip from its goal [m]."""
        return float(np.linalg.norm(self.arm.frame("tip").position[:2] - self.goal))

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[np.ndarray, dict]:
        super().reset(seed=seed)
        self.arm.reset()
        self.left, self.strain = STEPS, 0.0
        return self._seen(), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        a = MOST * float(np.clip(action, -1.0, 1.0)[0])
        begun = self.arm.motors
        for t in DT * np.arange(1, EVERY + 1):
            v = begun.velocity + a * t
            self.arm.step(motion=(begun.position + (begun.velocity + v) * t / 2, v, [a]))
        self.left -= 1
        off = self.off()
        late = 0.1 * (off > BAND) * (1.0 - self.left / STEPS)  # the later it shakes, the worse
        return self._seen(), -min(off, 0.05) - late, False, self.left == 0, {}


def episode(env: Reach, policy: np.ndarray) -> tuple[float, float]:
    """Its reward, and when the tip came to stay within the band [s]."""
    (seen, _), total, last = env.reset(), 0.0, 0.0
    for k in range(STEPS):
        seen, reward, _, _, _ = env.step(np.array([policy @ seen]))
        total += reward
        last = (k + 1) * EVERY * DT if env.off() > BAND else last
    return total, last


def learned(env: Reach, rounds: int = 15, tries: int = 16, seed: int = 0) -> np.ndarray:
    """The best policy that the noisy cross-entropy method came across."""
    draw, mean, spread = np.random.default_rng(seed), UNTRAINED, np.full(5, 2.0)
    top, champion = -np.inf, mean
    for noise in np.linspace(0.5, 0.0, rounds):
        found = mean + spread * draw.standard_normal((tries, 5))
        rewards = np.array([episode(env, one)[0] for one in found])
        best = np.argsort(rewards)[-tries // 4 :]
        if rewards[best[-1]] > top:
            top, champion = rewards[best[-1]], found[best[-1]]
        mean, spread = found[best].mean(axis=0), found[best].std(axis=0) + noise
    return champion


def shaped(robot: pf.Mechanism) -> float:
    """When the quintic of the same largest acceleration, shaped (ZV), has the tip in its band."""
    move = pf.quintic(joints={"hub": GOAL}, duration=float(np.sqrt(5.7735 * GOAL / MOST)))
    still = move.shaped("zv", modes=[float(pf.modes(robot, count=1).frequencies[0])])
    run = pf.solve(robot, still, "coupled", until=2.0, samples=2001, tol=1e-4)
    goal = 0.8 * np.array([np.cos(GOAL), np.sin(GOAL)])
    off = np.linalg.norm(run.frame("tip").position[:, :2] - goal, axis=1)
    return float(run.t[np.flatnonzero(off > BAND)[-1]])


def main() -> dict[str, float]:
    robot = pf.load(str(ARM))
    env = Reach(robot)
    untrained, begun = episode(env, UNTRAINED)[0], episode(env, learned(env, 4, 12))[0]
    print(f"reward {untrained:.2f}, after 48 episodes {begun:.2f}")
    reward, after = episode(env, TRAINED)
    times = {"quintic, ZV": shaped(robot), "learned": after}
    for name, t in times.items():
        print(f"{name:>12}: within {1e3 * BAND:g} mm after {t:.3f} s")
    assert untrained < begun < reward
    assert times["learned"] < times["quintic, ZV"]
    return times


if __name__ == "__main__":
    main()
