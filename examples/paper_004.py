"""A robot whose flexible platform slides through a sleeve: the figures of the paper of 2016.

Sharifnia, Akbarzadeh: An analytical model for vibration and control of a PR-PRP parallel robot with
flexible platform and prismatic joint. Cases 1 to 3 move the platform, each with a sleeve of 0.5 cm
(a point) and of 3 cm; case 4 damps it by three piezoelectric patches. `python paper_004.py FOLDER`
draws figures 4 to 8 and 10 to 13 and prints what there is to compare.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import pinflex as pf
from pinflex.arrays import Array
from pinflex.bodies.family import assumed, quadrature

CASES = {
    1: (),
    2: ("motion.joints.slide_2=0",),
    3: (
        "motion.joints.slide_1=(1 - cos(2*pi*t))/(20*pi)",
        "motion.joints.slide_2=-(1 - cos(2*pi*t))/(20*pi)",
    ),
}
COLOURS = ("#0072B2", "#D55E00")
DOTTED: dict[str, Any] = {"lw": 1.2, "color": "black", "ls": (0, (1, 2))}
SLEEVES = {"0.5 cm": 0.0, "3 cm": 0.03}  # [m] the short one acts as a point
MODES = "flexible.beam.basis.modes={}"
ELEMENTS = (
    "flexible.beam.basis="
    "{{kind: finite_element, elements: {}, order: quintic, boundary: free_free}}"
)
# By length of the sleeve: enough for 1e-5 m over a second with a point, 3e-4 m with 3 cm, whose
# force couples to ever higher modes.
BASES = {
    0.0: (MODES.format(30), ELEMENTS.format(8)),
    0.03: (MODES.format(50), ELEMENTS.format(16)),
}
L, D, EI, MU = 0.5, 0.18, 0.864, 0.2808  # [m] [m] [N m^2] [kg/m]


def run(case: int, sleeve: float, basis: str, dt: float = 1e-3) -> pf.Result:
    """Case 1, 2 or 3 over its second."""
    changes = [*CASES[case], f"loops.sleeve.sleeve={sleeve}", basis]
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


def controlled(modes: int = 30, dt: float = 1e-3, samples: int = 1601) -> dict[str, pf.Result]:
    """Case 4: undamped and without control, and with both (30 modes: 1 % from 50)."""
    source = Path(pf.load("prprp").description.path).parent / "case_4.yaml"  # type: ignore[arg-type]
    coarse = [MODES.format(modes), f"solve.dt={dt}", f"solve.samples={samples}"]
    undamped = pf.load(source, [*coarse, "flexible.beam.damping={rayleigh: [0, 0]}"])
    return {
        "without": pf.solve(undamped, control=False),
        "with": pf.solve(pf.load(source, coarse)),
    }


def draw(folder: Path) -> None:
    rows = {"w_tip": "tip deflection [mm]", "F_A": "$F_A$ [N]", "F_p": "$F_p$ [N]"}
    figures = {name: Figure(figsize=(7, 8), layout="constrained") for name in rows}
    panels = {name: figure.subplots(3, 1, sharex=True) for name, figure in figures.items()}
    path = Figure(figsize=(4.5, 5), layout="constrained")
    axes = path.subplots()
    for case in CASES:
        for (label, sleeve), colour in zip(SLEEVES.items(), COLOURS, strict=True):
            for basis, what in zip(BASES[sleeve], ("modes", "elements"), strict=True):
                r = run(case, sleeve, basis)
                curves = {
                    "w_tip": 1e3 * tip(r),
                    "F_A": smooth(across(r, "slide_2"), r.t),
                    "F_p": smooth(across(r, "slide_1"), r.t),
                }
                line = {"lw": 1.4, "color": colour} if what == "modes" else DOTTED
                for name, curve in curves.items():
                    label_ = f"sleeve {label}, {what}"
                    panels[name][case - 1].plot(r.t, curve, label=label_, **line)
                if what == "modes" and not sleeve:
                    x, _, z = r.frame("tip").position.T
                    axes.plot(x, z, label=f"case {case}")
                    print(f"case {case}: tip from {1e3 * tip(r).min():.2f} to "
                          f"{1e3 * tip(r).max():.2f} mm, F_A {across(r, 'slide_2').mean():.3f} N, "
                          f"F_p {across(r, 'slide_1').mean():.3f} N on average")  # fmt: skip
    for (name, figure), number in zip(figures.items(), (5, 6, 7), strict=True):
        for case, ax in zip(CASES, panels[name], strict=True):
            ax.set(ylabel=rows[name], title=f"case {case}")
            ax.grid(alpha=0.25)
        panels[name][-1].set_xlabel("t [s]")
        figure.legend(*panels[name][0].get_legend_handles_labels(), loc="outside lower center",
                      frameon=False, ncols=2)  # fmt: skip
        figure.savefig(folder / f"figure_{number:02d}_{name}.png", dpi=130)
    axes.set(xlabel="x [m]", ylabel="z [m]", title="path of the tip", aspect="equal")
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    path.savefig(folder / "figure_04_path.png", dpi=130)
    draw_control(folder)


def draw_control(folder: Path) -> None:
    runs = controlled()
    ratio = fast_part(tip(runs["without"]), runs["without"].t)
    ratio /= fast_part(tip(runs["with"]), runs["with"].t)
    print(f"case 4: the patches take the vibration above 4 Hz down {ratio:.1f} times")
    r = runs["with"]
    control, forces = (Figure(figsize=(8, h), layout="constrained") for h in (8, 5.6))
    top, *volts = control.subplots(3, 1, sharex=True)
    pair = forces.subplots(2, 1, sharex=True)
    for (label, one), colour in zip(runs.items(), ("0.55", COLOURS[1]), strict=True):
        line = {"lw": 0.9, "color": colour, "label": f"{label} control"}
        top.plot(one.t, 1e3 * tip(one), **line)
        for ax, joint in zip(pair, ("slide_2", "slide_1"), strict=True):
            ax.plot(one.t, smooth(across(one, joint), one.t), **line)
    top.set(ylabel="tip deflection [mm]", title="figure 10")
    for ax, patch, what in zip(volts, ("pzt_2", "pzt_1"), ("2", "1 and 3"), strict=True):
        ax.plot(r.t, r.arrays[f"control/{patch}"], color=COLOURS[0])
        ax.set(ylabel="voltage [V]", title=f"figure 11: patch {what}")
    for ax, name, number in zip(pair, ("F_A", "F_p"), (12, 13), strict=True):
        ax.set(ylabel=f"${name}$ [N]", title=f"figure {number}")
    for figure, name in ((control, "figure_10_11_control"), (forces, "figure_12_13_forces")):
        for ax in figure.axes:
            ax.grid(alpha=0.25)
        figure.axes[-1].set_xlabel("t [s]")
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center",
                      frameon=False, ncols=2)  # fmt: skip
        figure.savefig(folder / f"{name}.png", dpi=130)
    x, _, z = r.frame("tip").position.T
    path = Figure(figsize=(4.5, 4.8), layout="constrained")
    ax = path.subplots()
    ax.plot(x, z, color=COLOURS[0], lw=1.2)
    ax.set(xlabel="x [m]", ylabel="z [m]", title="figure 8: path of the tip", aspect="equal")
    ax.set_xticks([0.25, 0.30, 0.35, 0.40, 0.45])
    ax.grid(alpha=0.25)
    path.savefig(folder / "figure_08_path.png", dpi=130)


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
