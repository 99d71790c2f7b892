"""The 3-TPT of the article on co-simulation: leg forces and stress fields of solid rods.

The platform goes from X = -0.10 m to 0.10 m at 10 m/min. Each rod is a stepped round bar meshed
with quadratic hexahedra, reduced to its two ends and four modes; a second run has beams that slide
through the mouths of their tubes. The article gives no numbers; the scene is ours
(models/3tpt/SOURCE.md), and its statements are what is checked:

    rigid forces are small and smooth, flexible ones swing about them;
    the stress is nearly uniform along a rod and largest where its section steps.

    python examples/paper_003.py [FOLDER]      figures go to FOLDER, default paper_003
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf
from pinflex.studies.checking.parts import save, summary

STEP = 0.3073231279995044  # place of the step to 16 mm [m]
STROKE = [
    "home.motor_1=0.008312834640687883",  # leg lengths less those at the centre [m]
    "home.motor_2=-0.040373957190651844",
    "home.motor_3=0.05336685933821095",
    "motion.platform={x: 0.2, y: 0, z: 0}",
]
ROD = f"{{kind: mesh, modes: 4, rod: {{diameters: [0.020, 0.016], lengths: [{STEP}, 0.04]}}}}"
NO_BEAM = ["flexible.rod_?.section=null", "flexible.rod_?.axial=null"]
SOLID = [*NO_BEAM, f"flexible.rod_?.basis={ROD}"]
LEGS = (1, 2, 3)
INSIDE = 0.10267687200049563  # length of a rod inside its tube at the centre [m]


def main(folder: Path) -> float:
    folder.mkdir(parents=True, exist_ok=True)
    robot = pf.load("3tpt", [*STROKE, *SOLID])
    body = robot.parts["rod_1"].bodies[0]
    print(summary(body))
    save(body, folder / "rod.npz")
    rigid = pf.solve(robot, level="rigid", until=1.32, samples=661)
    run = pf.solve(robot, level="ked", until=1.32, dt=5e-4, samples=661)
    forces(rigid, run, folder / "forces.png")
    sliding(folder / "sliding_mouth.png")
    place = stress(run, folder / "stress.png")
    refinement(folder / "refinement.png")
    cruise = (rigid.t > 0.02) & (rigid.t < 1.20)
    for leg in LEGS:
        mouth = run.link(f"rod_{leg}").resultant[cruise, 0, 0]
        drive = -rigid.torque[cruise, leg - 1]
        print(
            f"leg {leg}: tension at the mouth {mouth.mean():.2f} N +- {mouth.std():.2f} N rms, "
            f"rigid drive {drive.mean():.2f} N"
        )
    print(f"largest stress at x = {place:.4f} m, the step is at {STEP:.4f} m")
    assert abs(place - STEP) < 1e-6  # a node of the mesh lies on the step
    return place


def forces(rigid: pf.Result, run: pf.Result, path: Path) -> None:
    """Tension of each leg, flexible against rigid (the article's figure 7)."""
    mouth = {leg: run.link(f"rod_{leg}").resultant[:, 0, 0] for leg in LEGS}
    tensions(rigid, run, mouth, "Tension of the legs along X at 10 m/min, solid rods", path)


def sliding(path: Path) -> None:
    """The same with beams that run through the mouths of their tubes."""
    source = Path(pf.load("3tpt").description.path).parent / "mouth.yaml"  # type: ignore[arg-type]
    robot = pf.load(source, STROKE)
    rigid = pf.solve(robot, level="rigid", until=1.32, samples=331)
    run = pf.solve(robot, level="ked", until=1.32, samples=331)
    mouth = {}
    for leg in LEGS:
        rod, inside = run.link(f"rod_{leg}"), INSIDE - run.joint(f"motor_{leg}").position
        # Just beyond the mouth: the section that is there at the time.
        mouth[leg] = np.array(
            [
                np.interp(x + 1e-6, rod.x, N)
                for x, N in zip(inside, rod.resultant[:, :, 0], strict=True)
            ]
        )
    tensions(rigid, run, mouth, "The same, beams that slide through the mouths", path)


def tensions(
    rigid: pf.Result, run: pf.Result, mouth: dict[int, np.ndarray], title: str, path: Path
) -> None:
    figure, axes = plt.subplots(3, 1, figsize=(8, 7), sharex=True, layout="constrained")
    for leg, ax in zip(LEGS, axes, strict=True):
        ax.plot(run.t, -run.torque[:, leg - 1], lw=1.0, color="#0072B2", label="flexible, drive")
        ax.plot(run.t, mouth[leg], lw=1.0, color="#D55E00", label="flexible, mouth of the tube")
        ax.plot(rigid.t, -rigid.torque[:, leg - 1], "k", lw=1.4, label="rigid, drive")
        ax.set_ylabel(f"leg {leg} [N]")
        ax.grid(alpha=0.25)
    axes[0].set_title(title, loc="left", fontsize=10)
    axes[-1].set_xlabel("t [s]")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", frameon=False, ncols=3)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def stress(run: pf.Result, path: Path) -> float:
    """Von Mises stress on the rods at its largest instant (figure 8); returns where it is worst."""
    figure, axes = plt.subplots(3, 2, figsize=(11, 8), layout="constrained")
    worst, at = 0.0, 0.0
    for leg in LEGS:
        key = f"link/rod_{leg}/mesh"
        nodes, mises = run.array(f"{key}/nodes"), run.array(f"{key}/von_mises")
        triangles = run.array(f"{key}/triangles").astype(int)
        k, n = np.unravel_index(np.argmax(mises), mises.shape)
        if mises[k, n] > worst:
            worst, at = float(mises[k, n]), float(nodes[n, 0])
        ax, side = axes[leg - 1]
        seen = triangles[nodes[triangles][:, :, 2].mean(axis=1) > 1e-6]  # the half that faces +z
        colour = 1e-6 * mises[k][seen].mean(axis=1)
        drawn = ax.tripcolor(1e3 * nodes[:, 0], 1e3 * nodes[:, 1], seen, facecolors=colour)
        ax.set(title=f"rod {leg}, t = {run.t[k]:.3f} s, side view", ylabel="y [mm]")
        ax.set_aspect(4.0)
        figure.colorbar(drawn, ax=ax, location="bottom", label="von Mises [MPa]", aspect=40)
        x = np.unique(np.round(nodes[:, 0], 9))
        envelope = mises.max(axis=0)
        worst_at = [envelope[np.abs(nodes[:, 0] - s) < 1e-8].max() for s in x]
        side.plot(1e3 * x, 1e-6 * np.array(worst_at), ".-")
        side.axvline(1e3 * STEP, color="0.6", lw=0.8)
        side.set(ylabel="largest of the run [MPa]", ylim=(0, None))
    axes[-1, 1].set_xlabel("x [mm]; the line is the step from 20 to 16 mm")
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return at


def refinement(path: Path) -> None:
    """First frequencies of the locked mechanism against the size of the cells."""
    rows, sizes = [], (0.08, 0.04, 0.02, 0.01)
    for size in sizes:
        basis = f"{{kind: mesh, modes: 4, size: {size}, rod: {{diameters: [0.020]}}}}"
        robot = pf.load("3tpt", [*NO_BEAM, f"flexible.rod_?.basis={basis}"])
        rows.append(pf.modes(robot, preload="none", count=8).frequencies)
    beam = pf.modes(pf.load("3tpt"), preload="none", count=8).frequencies
    figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
    for k, label in ((0, "1st"), (2, "3rd"), (3, "4th"), (6, "7th")):
        ax.semilogx(
            1e3 * np.array(sizes), [100 * (r[k] / beam[k] - 1) for r in rows], ".-", label=label
        )
    ax.set(
        xlabel="cell length [mm]", ylabel="solid against beam [%]", title="Locked drives at home"
    )
    ax.set_xticks([1e3 * size for size in sizes], [f"{1e3 * size:g}" for size in sizes])
    ax.minorticks_off()
    ax.grid(alpha=0.25)
    ax.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "paper_003"))
