# %% [markdown]
# # Following a path
#
# If the motors follow rigid inverse kinematics exactly, the platform of a flexible robot leaves its
# path. `pf.command` computes the motor motion that keeps it there.
#
# ## The rigid command misses

# %%
import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

BODY = "material: aluminium_7075, inertia: beam, axial: false, basis: {internal: 1}"
DISTAL = "{shape: rectangle, width: 0.025, thickness: 0.002}"  # [m]
CRANK = "{shape: rectangle, width: 0.025, thickness: 0.004}"
LINKS = f"{{'distal_?': {{{BODY}, section: {DISTAL}}}, 'crank_?': {{{BODY}, section: {CRANK}}}}}"

robot = pf.load("3rrr", [f"flexible={LINKS}", "damping={rayleigh: [0, 1e-4]}", "motion=null"])
motion = pf.nonic(platform={"x": 0.06, "y": 0.03, "rz": 0.3}, duration=0.08)  # [m], [rad], [s]

commands = {level: pf.command(robot, motion, level) for level in ("rigid", "exact")}
commands["exact"]

# %% [markdown]
# ## Verify by a forward run
#
# The command is a motion of the joints; level `coupled` applies it to the flexible robot.

# %%
figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
worst = {}
for level, found in commands.items():
    run = pf.solve(robot, found.motion, "coupled", until=float(found.t[-1]), tol=1e-4)
    path = found.reference[0, :2] + motion.evaluate(run.t - found.before)[0][:, :2]
    off = np.linalg.norm(run.frame("platform").position[:, :2] - path, axis=1)
    worst[level] = off.max()
    axes.semilogy(run.t, 1e3 * off + 1e-7, label=f"{level} command")
    print(f"{level:6} command: platform off by {1e3 * off.max():.2g} mm")
axes.set(xlabel="t [s]", ylabel="off its path [mm]")
axes.legend(frameon=False)
assert worst["exact"] < 0.01 * worst["rigid"]

# %% [markdown]
# ## What the motors do differently
#
# If the internal dynamics is non-minimum phase, the motors start before the platform; here they
# also stop a little after it.

# %%
ahead, after = commands["exact"].actuation
print(f"motors move {1e3 * ahead:.1f} ms before the platform and {1e3 * after:.1f} ms after it")
commands["exact"].to_csv("command.csv").stat().st_size  # for the controller, SI units

# %% [markdown]
# ## Or avoid only the vibration
#
# An input shaper needs only a frequency. It does not keep the platform on its path, but it stops
# without ringing.

# %%
first = float(pf.modes(robot, count=1).frequencies[0])
shaped = motion.shaped("zvd", modes=[first])
print(f"first mode {first:.1f} Hz; the move takes {1e3 * (shaped.duration - motion.duration):.1f} "
      "ms longer")

# %% [markdown]
# From a terminal: `pinflex command MODEL -o command.csv --verify`, `pinflex shapers MODEL`.
