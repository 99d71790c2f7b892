"""A robot whose flexible platform slides through a sleeve: the figures of the paper of 2016.

Sharifnia, Akbarzadeh: An analytical model for vibration and control of a PR-PRP parallel robot with
flexible platform and prismatic joint. Cases 1 to 3 move the platform, each with a sleeve of 0.5 cm
(a point) and of 3 cm; case 4 damps it by three piezoelectric patches. `python paper_004.py FOLDER`
draws figures 4 to 8 and 10 to 13 and prints what there is to compare.
"""

import sys
from pathlib import Path

import numpy as np

import pinflex as pf
from pinflex.arrays import Array
from pinflex.family import assumed, quadrature

CASES = {
    1: (),
    2: ("motion.joints.slide_2=0",),
    3: (
        "motion.joints.slide_1=(1 - cos(2*pi*t))/(20*pi)",
        "motion.joints.slide_2=-(1 - cos(2*pi*t))/(20*pi)",
    ),
}
SLEEVES = {"0.5 cm": 0.0, "3 cm": 0.03}  # [m] the short one acts as a point
ELEMENTS = (
    "flexible.beam.basis={kind: finite_element, elements: 16, order: quintic, boundary: free_free}"
)
L, D, EI, MU = 0.5, 0.18, 0.864, 0.2808  # [m] [m] [N m^2] [kg/m]


def run(case: int, sleeve: float = 0.0, basis: str = "", dt: float = 5e-4) -> pf.Result:
    """Case 1, 2 or 3 over its second."""
    changes = [*CASES[case], f"loops.sleeve.sleeve={sleeve}", *([basis] if basis else [])]
    return pf.solve(pf.load("prprp", changes), dt=dt, samples=501)


def across(result: pf.Result, joint: str) -> Array:
    """Force (N) on the beam across the line of its ends, from the carriage of a slide."""
    q, force = result.arrays["joint/q"], result.arrays[f"reaction/{joint}"]
    theta = np.arctan2(q[:, 0] - q[:, 1], D)
    return np.asarray(np.cos(theta) * force[:, 2] - np.sin(theta) * force[:, 0])


def tip(result: pf.Result) -> Array:
    """Deflection of the tip (m) from the line through hinge and sleeve."""
    return np.asarray(result.link("beam").deflection[:, -1, 1])


def literal_growth(
    modes: int, transposed: bool = False, x: float = 0.18, a: float = 0.015
) -> float:
    """Largest growth rate (1/s) of case 1 with a sleeve of length 2 a, as eq. 24-28 are printed.

    There the sleeve's forces act at three points, phi(x), phi(x + a), phi(x - a), while its
    constraints also hold the slope at x: the work of the forces is not zero. `transposed` takes the
    forces that belong to the constraints, as pinflex does.
    """
    family = assumed(L, "free_free", modes)
    at, weights = (v.ravel() for v in quadrature(family.breaks, family.gauss))
    bent = family.evaluate(at).curv
    K = EI / (MU * L) * bent.T @ (weights[:, None] * bent)
    F = family.evaluate(np.array([0.0, x, x + a, x - a]))
    C = F.f.copy()
    C[2], C[3] = C[2] - a * F.df[1], C[3] + a * F.df[1]
    B = (C if transposed else F.f).T
    Z = np.linalg.svd(C)[2][4:].T
    square = np.linalg.eigvals(Z.T @ (K - B @ np.linalg.solve(C @ B, C @ K)) @ Z)
    return float(np.max(np.abs(np.sqrt(-square.astype(complex)).real)))


def fast_part(w: Array, t: Array, above: float = 4.0) -> float:
    """Size of the part of a signal above a frequency (Hz), in its own unit."""
    spectrum = np.fft.rfft((w - w.mean()) * np.hanning(len(w)))
    spectrum[np.fft.rfftfreq(len(w), t[1] - t[0]) < above] = 0.0
    return float(np.sqrt(np.sum(np.abs(spectrum) ** 2)) / len(w))


def smooth(force: Array, t: Array) -> Array:
    """Zero-phase low-pass at 150 Hz: the sudden start excites every mode there is."""
    from scipy.signal import butter, sosfiltfilt

    low = butter(4, 150.0, fs=1.0 / (t[1] - t[0]), output="sos")
    return np.asarray(sosfiltfilt(low, force))


def controlled(modes: int = 30, dt: float = 1e-3) -> dict[str, pf.Result]:
    """Case 4 without and with control (30 modes: 1 % from 50)."""
    robot = pf.load(
        Path(pf.load("prprp").description.path).parent / "case_4.yaml",  # type: ignore[arg-type]
        [f"flexible.beam.basis.modes={modes}", f"solve.dt={dt}"],
    )
    return {"without": pf.solve(robot, control=False), "with": pf.solve(robot)}


def draw(folder: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = {"w_tip": "tip deflection [mm]", "F_A": "F_A [N]", "F_p": "F_p [N]"}
    figures = {name: plt.subplots(3, 1, figsize=(7, 9), sharex=True) for name in rows}
    path, axes = plt.subplots(figsize=(5, 5))
    for case in CASES:
        for (label, sleeve), colour in zip(SLEEVES.items(), ("C0", "C3"), strict=True):
            for basis, style in (("", "-"), (ELEMENTS, ":")):
                r = run(case, sleeve, basis)
                what = "elements" if basis else "modes"
                curves = {
                    "w_tip": 1e3 * tip(r),
                    "F_A": smooth(across(r, "slide_2"), r.t),
                    "F_p": smooth(across(r, "slide_1"), r.t),
                }
                for name, curve in curves.items():
                    figures[name][1][case - 1].plot(
                        r.t, curve, style, color=colour, label=f"sleeve {label}, {what}"
                    )
                if not basis and not sleeve:
                    x, _, z = r.frame("tip").position.T
                    axes.plot(x, z, label=f"case {case}")
                    print(f"case {case}: tip from {1e3 * tip(r).min():.2f} to "
                          f"{1e3 * tip(r).max():.2f} mm, F_A {across(r, 'slide_2').mean():.3f} N, "
                          f"F_p {across(r, 'slide_1').mean():.3f} N on average")  # fmt: skip
    for (name, (figure, three)), number in zip(figures.items(), (5, 6, 7), strict=True):
        for case, ax in zip(CASES, three, strict=True):
            ax.set(ylabel=rows[name], title=f"case {case}")
            ax.grid(alpha=0.3)
        three[0].legend(fontsize=7, ncol=2)
        three[-1].set_xlabel("t [s]")
        figure.tight_layout()
        figure.savefig(folder / f"figure_{number:02d}_{name}.png", dpi=120)
    axes.set(xlabel="x [m]", ylabel="z [m]", title="path of the tip", aspect="equal")
    axes.legend()
    path.savefig(folder / "figure_04_path.png", dpi=120)
    draw_control(folder)


def draw_control(folder: Path) -> None:
    import matplotlib.pyplot as plt

    runs = controlled()
    ratio = fast_part(tip(runs["without"]), runs["without"].t)
    ratio /= fast_part(tip(runs["with"]), runs["with"].t)
    print(f"case 4: the patches take the vibration above 4 Hz down {ratio:.1f} times")
    figure, axes = plt.subplots(3, 1, figsize=(8, 9), sharex=True)
    forces, force_axes = plt.subplots(2, 1, figsize=(8, 6), sharex=True)
    for label, r in runs.items():
        axes[0].plot(r.t, 1e3 * tip(r), lw=0.8, label=f"{label} control")
        for ax, joint in zip(force_axes, ("slide_2", "slide_1"), strict=True):
            ax.plot(r.t, smooth(across(r, joint), r.t), lw=0.8, label=f"{label} control")
    r = runs["with"]
    axes[0].set(ylabel="tip deflection [mm]", title="figure 10")
    axes[0].legend()
    axes[1].plot(r.t, r.arrays["control/pzt_2"], label="patch 2")
    axes[1].set(ylabel="voltage [V]", title="figure 11")
    axes[2].plot(r.t, r.arrays["control/pzt_1"], label="patches 1 and 3")
    axes[2].set(ylabel="voltage [V]", xlabel="t [s]")
    for ax, name, number in zip(force_axes, ("F_A", "F_p"), (12, 13), strict=True):
        ax.set(ylabel=f"{name} [N]", title=f"figure {number}")
    for ax in (*axes[1:], *force_axes):
        ax.legend()
    force_axes[1].set_xlabel("t [s]")
    for one, name in ((figure, "figure_10_11_control"), (forces, "figure_12_13_forces")):
        one.tight_layout()
        one.savefig(folder / f"{name}.png", dpi=120)
    x, _, z = r.frame("tip").position.T
    path, ax = plt.subplots(figsize=(5, 5))
    ax.plot(x, z)
    ax.set(xlabel="x [m]", ylabel="z [m]", title="figure 8: path of the tip", aspect="equal")
    path.savefig(folder / "figure_08_path.png", dpi=120)


def main() -> float:
    found = pf.modes(pf.load("prprp"), count=4, preload="none").frequencies
    print("case 1, frequencies:", "  ".join(f"{f:.3f}" for f in found), "Hz")
    print(f"forces as printed, 50 modes: they grow by exp({literal_growth(50):.3g} t)")
    if len(sys.argv) > 1:
        folder = Path(sys.argv[1])
        folder.mkdir(parents=True, exist_ok=True)
        draw(folder)
    # 0.1 %: beam elements, exact in time.
    assert abs(found[0] - 7.2187) < 1e-3 * 7.2187
    return float(found[0])


if __name__ == "__main__":
    main()
