"""Whether told confidence holds: `python -m tests.benchmarks.confidence [--sets N] [--seed S]`.

Four drive stiffnesses and two moduli of the ur5 are fitted to six frequencies with 2 % of noise,
with shapes that say which mode is which; with `--shapes` these have 2 % of noise too and are
fitted. Counts say in how many data sets the 95 % interval of a parameter holds its true value: of
100 sets a right interval gives 91 to 99 nearly always (binomial, two standard deviations). Joint
statements: all six intervals at once (less often than 95 %, nothing says how much), and the true
values where S is within the 95 % quantile of chi^2 with six freedoms of the best S. With
`--simultaneous` the intervals are those that are to hold all at once, in 95 % of the sets
at least. With `--off` the fit starts 20 to 43 % beside the true values. Sets
are shared by `--jobs` processes.

`--summed` asks the same of many sets another way, with no code of the fit: frequencies by sums of
stiffness matrices, and whether S, with one parameter held at its true value, is within the square
of the quantile of its least. A thousand sets take a minute or two.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np
from scipy.stats import chi2, norm

import pinflex as pf
from pinflex.mechanics.evaluation.equations import Equations
from pinflex.mechanics.evaluation.frames import frame_jacobian
from pinflex.variation.variants import variants
from tests.variation.summed import Summed

STIFFNESS = {"shoulder_pan_joint": 2.0e4, "shoulder_lift_joint": 1.6e4, "elbow_joint": 1.0e4,
             "wrist_1_joint": 4.0e3}  # fmt: skip
SENSORS = ("forearm_link", "wrist_1_link", "tool0")
NOISE = 0.02
OFF = np.array([1.3, 0.75, 1.25, 0.7, 0.8, 1.3])  # true values over those of the start


def designs():
    """The ur5 with four drives, its two moduli."""
    drives = [f"joints.{joint}.drive={{stiffness: {k}, gear: 101, motor_inertia: 1.0e-4}}"
              for joint, k in STIFFNESS.items()]  # fmt: skip
    robot = pf.load("ur5", drives)
    return variants(robot, ["joints.*.drive.stiffness", "flexible.*.material.E"])


@cache
def scene(off: bool):
    """The robot to start from, the keys, their true values, exact frequencies and shapes."""
    found = designs()
    robot, keys = found.source, [parameter.key for parameter in found.parameters]
    true = found.first * (OFF if off else 1.0)
    built = found.at(dict(zip(keys, true, strict=True)))
    found = pf.modes(built, count=6)
    rows = np.concatenate([
        frame_jacobian(Equations(built.flexible), found.y, built.frame(name))[:3]
        for name in SENSORS
    ])  # fmt: skip
    shapes = (rows @ found.shapes).T
    return robot, keys, true, found.frequencies, shapes / np.linalg.norm(shapes, axis=1)[:, None]


def one(number: int, seed: int, off: bool, noisy_shapes: bool, simultaneous: bool):
    """Intervals, true values, which are of the profile, rises of S, and CPU seconds of a set."""
    robot, keys, true, f, shapes = scene(off)
    rng = np.random.default_rng([seed, number])  # the same sets however they are shared
    noise = NOISE * rng.standard_normal(6)
    data = {"frequency": f * (1.0 + noise), "std": NOISE * f}
    total = float(np.sum((noise / NOISE) ** 2))
    if noisy_shapes:
        exact, shapes = shapes, shapes + NOISE * rng.standard_normal(shapes.shape)
        size = np.linalg.norm(shapes, axis=1)[:, None]
        along = np.sum(exact * shapes / size, axis=1)[:, None]
        total += float(np.sum(((along * exact - shapes / size) / NOISE) ** 2))
    names = [f"{name}.{axis}" for name in SENSORS for axis in "xyz"]
    data |= dict(zip(names, shapes.T, strict=True))
    start = time.process_time()
    shape_std = NOISE if noisy_shapes else None
    found = pf.fit(robot, data, keys, shape_std=shape_std, simultaneous=simultaneous)
    seconds = time.process_time() - start
    rise = total - float(np.sum(found.residuals**2))
    return found.intervals, true, found.profiled, rise, seconds, found.solves


def summed(count: int, seed: int) -> str:
    """Shares of sets in which profile intervals of exact ends hold the true values."""
    robots = designs()
    robot = Summed(robots, SENSORS)
    f, rises = robot.frequencies, []
    for number in range(count):
        noise = np.random.default_rng([seed, number]).standard_normal(6)
        measured, std = f * (1.0 + NOISE * noise), NOISE * f
        least, x = robot.least(measured, std)
        rises.append([robot.least(measured, std, (k, 0.0), [x])[0] - least for k in range(6)])
    inside = np.array(rises) < norm.ppf(0.975) ** 2
    lines = [f"{count} sets, seed {seed}: held by profile intervals, of 100; standard error"]
    for parameter, share in zip(robots.parameters, inside.mean(axis=0), strict=True):
        error = np.sqrt(max(share * (1 - share), 1 / count**2) / count)
        lines.append(f"{parameter.key} | {100 * share:.1f} | {100 * error:.1f}")
    lines.append(f"all six at once | {100 * np.all(inside, axis=1).mean():.1f}")
    lines.append(f"of the first 100: {', '.join(map(str, inside[:100].sum(axis=0)))}")
    return "\n".join(lines)


def main() -> None:
    """Count, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=100)
    parser.add_argument("--seed", type=int, default=16)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--off", action="store_true", help="start beside the true values")
    parser.add_argument("--shapes", action="store_true", help="noise in shapes, which are fitted")
    parser.add_argument(
        "--simultaneous", action="store_true", help="intervals that hold all at once"
    )
    parser.add_argument("--summed", action="store_true", help="by sums of stiffness matrices")
    args = parser.parse_args()
    if args.summed:
        print(summed(args.sets, args.seed))
        return
    given = {"seed": args.seed, "off": args.off, "noisy_shapes": args.shapes}
    task = partial(one, **given, simultaneous=args.simultaneous)
    rows = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for row in pool.map(task, range(args.sets)):
            rows.append(row)
            if len(rows) % 5 == 0 or len(rows) == args.sets:
                print(_counts(rows), flush=True)
    print(_table(rows, scene(args.off)[1], args))


def _inside(rows) -> np.ndarray:
    return np.array([(x[:, 0] < true) & (true < x[:, 1]) for x, true, *_ in rows])


def _counts(rows) -> str:
    inside = _inside(rows)
    held = ", ".join(map(str, inside.sum(axis=0)))
    return f"{held}; all at once {np.all(inside, axis=1).sum()} of {len(rows)}"


def _table(rows, keys, args) -> str:
    inside, n = _inside(rows), len(rows)
    intervals = np.array([row[0] for row in rows])
    told = np.isfinite(intervals) & (intervals > 0)
    lines = [
        f"{n} sets, seed {args.seed}",
        "parameter | held | low told, high told | profile | high / low, median where both are told",
    ]
    for k, key in enumerate(keys):
        both = np.all(told[:, k], axis=1)
        width = np.median(intervals[both, k, 1] / intervals[both, k, 0]) if any(both) else np.nan
        low, high = told[:, k].sum(axis=0)
        profiled = sum(row[2][k] for row in rows)
        lines.append(f"{key} | {inside[:, k].sum()} | {low}, {high} | {profiled} | {width:.3g}")
    rises = np.array([row[3] for row in rows])
    lines += [
        f"all {len(keys)} intervals at once: {np.all(inside, axis=1).sum()} of {n}",
        f"S within chi^2 of {len(keys)} freedoms: "
        f"{np.sum(rises < chi2.ppf(0.95, len(keys)))} of {n}",
        f"a fit: {np.median([row[4] for row in rows]):.1f} s CPU, "
        f"{np.median([row[5] for row in rows]):.0f} comparisons (medians)",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
