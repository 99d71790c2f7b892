"""The figures of paper.md: `python paper/figures.py` writes them beside it, in some ten seconds."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

HERE = Path(__file__).parent
COLOURS = {"rigid": "#666666", "quasistatic": "#0072B2", "ked": "#E69F00", "coupled": "#D55E00"}
EXACT = (
    0.573779  # [m] largest tip lag of the beam spun up, geometrically exact (Simo, Vu-Quoc 1986)
)
SEGMENTS = (1, 2, 3, 4)
WITHOUT_STRETCH = 0.573748  # [m] the same beam that cannot stretch: below its error nothing is told


def delta(path: Path) -> float:
    """What a delta robot does that a rigid one does not; its largest deviation [m]."""
    robot = pf.load("delta")
    runs = {level: pf.solve(robot, level=level, samples=601) for level in COLOURS}
    motor = runs["rigid"].motors[0]
    figure, (left, right) = plt.subplots(1, 2, figsize=(7.5, 2.6), constrained_layout=True)
    for level, run in runs.items():
        left.plot(run.t, run.joint(motor).torque, COLOURS[level], lw=1, label=level)
        if level != "rigid":
            off = run.deviation_from(runs["rigid"], "plate")
            right.plot(run.t, 1e3 * off.norm, COLOURS[level], lw=1, label=level)
    left.set(xlabel="time [s]", ylabel=f"torque of {motor} [N m]")
    right.set(xlabel="time [s]", ylabel="plate off the rigid motion [mm]")
    left.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=200)
    return runs["coupled"].deviation_from(runs["rigid"], "plate").max()


def largest_lag(run: pf.Result) -> float:
    """Largest lag of the tip behind the hub [m], by the parabola through three samples."""
    c, s = run.arrays["joint/q"].T
    x, y, _ = run.frame("tip").position.T
    lag = s * x - c * y
    k = int(np.argmax(lag))
    a, b, top = np.polyfit(run.t[k - 1 : k + 2] - run.t[k], lag[k - 1 : k + 2], 2)
    return float(top - b * b / (4 * a))


def spin_up(path: Path) -> list[float]:
    """Relative error of the beam spun up over the number of bodies."""
    found = []
    for count in SEGMENTS:
        robot = pf.load("spinning_beam", [f"flexible.beam.segments={count}"])
        run = pf.solve(robot, dt=5e-3, until=7.2, samples=361)
        found.append(largest_lag(run) / EXACT - 1)
    figure, axes = plt.subplots(figsize=(3.6, 2.6), constrained_layout=True)
    axes.loglog(SEGMENTS, np.abs(found), "o-", color=COLOURS["coupled"])
    limit = abs(WITHOUT_STRETCH / EXACT - 1)
    axes.axhline(limit, color="#666666", ls="--", lw=1)
    axes.annotate("a beam that cannot stretch", (1, 1.15 * limit), fontsize=8)
    axes.set(xlabel="bodies of the beam", ylabel="error of the largest lag")
    axes.set_xticks(SEGMENTS, [str(count) for count in SEGMENTS])
    axes.minorticks_off()
    figure.savefig(path, dpi=200)
    return found


if __name__ == "__main__":
    print(delta(HERE / "delta.png"), spin_up(HERE / "spin_up.png"))
