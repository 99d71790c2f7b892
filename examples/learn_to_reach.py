"""A flexible arm as a gymnasium environment: reach without shaking, learnt in a few hundred tries.

    pip install "pinflex[gym]"; python examples/learn_to_reach.py

A beam of 10 m on a motor turns by 0.5 rad. What is learnt are four gains, by the cross-entropy
method (Rubinstein 1999); beside it a quintic with a ZV shaper (Singer and Seering 1990), as short
as the same limit of acceleration lets it be, which knows the first period where the learner knows
nothing. It ends about even: more reward (-7.9 to -8.5), in its band 0.15 s later (2.40 s).
"""

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import pinflex as pf

DT, END, GOAL, MOST, BAND = 0.05, 5.0, 0.5, 0.6, 0.05  # s, s, rad, rad/s^2, m at the tip
GUESS = np.array([5.0, -6.0, 0.0, 0.0])  # gains that bring a rigid arm there


class Reach(gymnasium.Env):
    """Action: acceleration of the motor; seen: way left, speed, strain at the root, its rate."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float64)
    observation_space = gymnasium.spaces.Box(-10.0, 10.0, (4,), np.float64)

    def __init__(self) -> None:
        robot = pf.load("spinning_beam", ["damping.modal=0.01"])
        (link,) = robot.parts
        gauge = pf.StrainGauge(
            link, 0.0, y=-30.0
        )  # so far off it reads about what the tip bends, m
        self.arm = pf.Simulator(robot, dt=DT, sensors={"root": gauge})
        self.tip, self.start = robot.description.platform or "tip", self.arm.snapshot()

    def reset(self, *, seed: int | None = None, options: dict | None = None):
        super().reset(seed=seed)
        self.arm.restore(self.start)
        self.at, self.bent = np.zeros(2), 0.0
        return np.array([GOAL, 0.0, 0.0, 0.0]), {}

    def step(self, action):
        a = MOST * float(np.clip(action, -1.0, 1.0)[0])
        q, v = self.at
        self.at = np.array([q + DT * v + 0.5 * DT * DT * a, v + DT * a])
        self.arm.step(motion=([self.at[0]], [self.at[1]], [a]))
        before, self.bent = self.bent, float(self.arm.sensor("root"))
        x, y, _ = self.arm.frame(self.tip).position
        off = abs(np.arctan2(y, x) - GOAL) * np.hypot(x, y)
        seen = np.array([GOAL - self.at[0], self.at[1], self.bent, (self.bent - before) / DT])
        return seen, -DT * np.log1p(off / BAND), False, self.arm.time > END - DT / 2, {"off": off}


def settled(env: Reach, act) -> tuple[float, float]:
    """Time after which the tip stays in its band [s], and the sum of rewards."""
    seen, _ = env.reset()
    total, since, over = 0.0, 0.0, False
    while not over:
        seen, reward, _, over, info = env.step(act(seen, env.arm.time))
        total += reward
        since = env.arm.time if info["off"] > BAND else since
    return since, total


def learnt(env: Reach, tries: int = 16, rounds: int = 9) -> np.ndarray:
    """Four gains by the cross-entropy method, of which the quarter that did best is kept."""
    random, mean, spread = np.random.default_rng(0), GUESS, np.array([3.0, 4.0, 4.0, 4.0])
    for _ in range(rounds):
        guesses = mean + spread * random.standard_normal((tries, 4))
        scores = [settled(env, lambda seen, t, g=g: [g @ seen])[1] for g in guesses]
        best = guesses[np.argsort(scores)[-tries // 4 :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.1
    return mean


def shaped(env: Reach):
    """Acceleration of a quintic of GOAL, ZV shaped for the first period of the arm on its motor."""
    half = 0.5 / float(pf.modes(env.arm.mechanism, count=1).frequencies[0])
    T = (10 / 3**0.5 * GOAL / 2 / MOST) ** 0.5  # each half of it has its largest acceleration
    return lambda _, t: [
        sum(bump((t + DT / 2 - d) / T) for d in (0, half)) * GOAL / (2 * T * T * MOST)
    ]


def bump(s: float) -> float:
    return 60 * s * (1 - s) * (1 - 2 * s) if 0 < s < 1 else 0.0


env = Reach()
check_env(env, skip_render_check=True)  # that gymnasium takes it
gains = learnt(env)
stays = {
    "guessed": settled(env, lambda seen, t: [GUESS @ seen]),
    "learnt": settled(env, lambda seen, t: [gains @ seen]),
    "shaped": settled(env, shaped(env)),
}
for name, (since, total) in stays.items():
    print(f"{name:>8}: within {1e3 * BAND:.0f} mm from {since:.2f} s on, reward {total:.2f}")
assert stays["guessed"][1] < 1.3 * stays["learnt"][1] < 0.0  # it has learnt not to shake
assert stays["learnt"][0] < 3.5
assert stays["learnt"][1] > 1.2 * stays["shaped"][1]
