# %% [markdown]
# # Your hammer test
#
# You have a robot whose datasheet does not give the stiffness of its gear and arm. A hammer with a
# force cell and one accelerometer measure both in ten minutes. This tutorial goes from taps to
# numbers with confidence intervals.
#
# The arm turns about a vertical axis. Its motor is braked, but its gear is elastic. An aluminium
# bar of 600 mm carries a tool of 0.4 kg.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

Path("arm.urdf").write_text("""<robot name="arm"><link name="base"/><link name="bar"/>
<link name="tool"><inertial><mass value="0.4"/>
<inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="motor" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
<limit effort="50" velocity="3" lower="-2" upper="2"/></joint>
<joint name="flange" type="fixed"><parent link="bar"/><child link="tool"/>
<origin xyz="0.6 0 0"/></joint></robot>""")
Path("arm.yaml").write_text("""urdf: arm.urdf
actuated: [motor]
joints: {motor: {drive: {gear: 100, motor_inertia: 1.0e-4, stiffness: 4000, damping: 2}}}
flexible:
  bar:
    material: {like: aluminium_6061, rho: 2700}
    section: {shape: rectangle, width: 40 mm, thickness: 12 mm}
    start: bar
    end: tool
    basis: {kind: craig_bampton, internal: 3}
damping: {rayleigh: [0, 2.0e-5]}  # of the aluminium, [1/s] and [s]
platform: tool
""")
robot = pf.load("arm.yaml")
print(pf.modes(robot, count=3))

# %% [markdown]
# ## Taps
#
# Since you have no such arm at hand, a program independent of pinflex simulates the taps, with
# parameters that the fit does not know: forty Euler-Bernoulli elements on a spring with a damper,
# solved frequency by frequency. The hammer hits the tool three times, an accelerometer sits beside
# it, and both signals are noisy.

# %%
TRUE = {"E": 6.55e10, "gear": 2900.0, "damping": 4.0}
LENGTH, WIDTH, THICK, RHO, TOOL, n = 0.6, 0.04, 0.012, 2700.0, 0.4, 40
h, EI, mass = LENGTH / n, TRUE["E"] * WIDTH * THICK**3 / 12, RHO * WIDTH * THICK
K, M = np.zeros((2, 2 * n + 2, 2 * n + 2))
for e in range(n):
    at = slice(2 * e, 2 * e + 4)
    K[at, at] += EI / h**3 * np.array([
        [12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
        [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]])
    M[at, at] += mass * h / 420 * np.array([
        [156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
        [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])
C = 2.0e-5 * K
K[1, 1] += TRUE["gear"]  # the slope at the root turns the gear
C[1, 1] += TRUE["damping"]
M[-2, -2] += TOOL
K, C, M = K[1:, 1:], C[1:, 1:], M[1:, 1:]  # the root does not move

rate, seconds = 2000.0, 4.0  # [Hz], [s]
t = np.arange(int(rate * seconds)) / rate
frequency = np.fft.rfftfreq(len(t), 1 / rate)
push = np.eye(len(K))[-2]
moved = np.array([  # [m/N], at the tool
    np.linalg.solve(K + 1j * w * C - w**2 * M, push)[-2] if w < 4000 else 0.0
    for w in 2 * np.pi * frequency
])
rng = np.random.default_rng(32)


def tap(size):
    """Force [N] of a half sine of 4 ms, and the acceleration [m/s^2] it leaves, with noise."""
    force = size * np.where(t < 4e-3, np.sin(np.pi * t / 4e-3), 0.0)
    seen = np.fft.irfft(-((2 * np.pi * frequency) ** 2) * moved * np.fft.rfft(force))
    return (force + 0.01 * rng.standard_normal(len(t)),
            seen + 0.05 * rng.standard_normal(len(t)))


taps = [tap(size) for size in (60.0, 80.0, 70.0)]
figure, axes = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
axes[0].plot(1e3 * t[:20], taps[0][0][:20])
axes[0].set(xlabel="t [ms]", ylabel="hammer [N]")
axes[1].plot(t[:4000], taps[0][1][:4000], lw=0.7)
axes[1].set(xlabel="t [s]", ylabel="tool [m/s²]");

# %% [markdown]
# ## From taps to a frequency response
#
# The three taps are averaged to $H_1 = S_{fa} / S_{ff}$, and their scatter gives the weight of each
# frequency in the fit. Below 3 Hz and above 150 Hz the force excites too little, so those
# frequencies are left out.

# %%
spectra = [(np.fft.rfft(f), np.fft.rfft(a)) for f, a in taps]
ratio = np.array([a / f for f, a in spectra])
H1 = sum(a * f.conj() for f, a in spectra) / sum(abs(f) ** 2 for f, _ in spectra)
spread = ratio.std(axis=0, ddof=1) / np.sqrt(len(taps))
used = (frequency > 3) & (frequency < 150)
used &= np.arange(len(frequency)) % 4 == 0  # every 1 Hz is plenty
receptance = H1[used] / -((2 * np.pi * frequency[used]) ** 2)
name = "tool.y/tool.y"
measured = {
    "frequency": frequency[used],
    f"{name}.real": receptance.real,
    f"{name}.imag": receptance.imag,
    f"{name}.std": np.maximum(
        spread[used] / (2 * np.pi * frequency[used]) ** 2, 0.01 * abs(receptance)
    ),
}

# %% [markdown]
# ## The fit
#
# There are three unknowns: the modulus of the bar, and the stiffness and damping of the gear. All
# three start at datasheet values, which are 5 to 50 % off.

# %%
KEYS = ["flexible.bar.material.E", "joints.motor.drive.stiffness", "joints.motor.drive.damping"]
found = pf.fit(robot, measured, KEYS)
print(found.text())
for key, best, true in zip(KEYS, found.best, TRUE.values(), strict=True):
    print(f"{key}: {best:.4g}, true {true:.4g}")
    assert abs(best / true - 1) < 0.02

# %%
found.plot();

# %% [markdown]
# ## What it is good for
#
# The fitted robot is a scene like any other. How does it behave in its move, and how wrong would
# the datasheet values have been?

# %%
found.write("fitted.yaml")
move = pf.quintic(joints={"motor": 0.6}, duration=0.25)
for label, file in (("datasheet", "arm.yaml"), ("fitted", "fitted.yaml")):
    flexible = pf.load(file)
    run = pf.solve(flexible, move, level="coupled", until=0.6)
    off = run.deviation_from(pf.solve(flexible, move, level="rigid", until=0.6), "tool")
    print(f"{label}: first frequency {pf.modes(flexible, count=1).frequencies[0]:.2f} Hz, "
          f"the tool is up to {1e3 * off.max():.2f} mm off")

# %% [markdown]
# From a terminal, with the taps in a CSV or a universal file (`.uff`, which analysers write):
# `pinflex fit arm.yaml hammer.uff --vary joints.motor.drive.stiffness`. The fit says so in words if
# a measurement cannot determine a number: two that only act together, or one at its bound.
