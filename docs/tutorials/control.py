# %% [markdown]
# # Control
#
# Design a controller on a linear model, then test it on the nonlinear flexible robot.
#
# ## State space
#
# `linearise` returns x' = A x + B u about a balanced pose, with named states, inputs and outputs;
# `to_scipy()` and `to_control()` convert it for your tools.

# %%
import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

BODY = "material: aluminium_7075, inertia: beam, axial: false, basis: {internal: 1}"
DISTAL = "{shape: rectangle, width: 0.025, thickness: 0.002}"  # [m]
CRANK = "{shape: rectangle, width: 0.025, thickness: 0.004}"
LINKS = f"{{'distal_?': {{{BODY}, section: {DISTAL}}}, 'crank_?': {{{BODY}, section: {CRANK}}}}}"

robot = pf.load("3rrr", [f"flexible={LINKS}", "damping={rayleigh: [0, 1e-4]}", "motion=null"])
model = pf.linearise(robot, motors="acceleration", modes=6)
print(model)
print("inputs ", ", ".join(model.inputs))
print("outputs", ", ".join(model.outputs))
print("modes  ", model.frequencies.round(1), "Hz")

# %%
f = np.geomspace(10, 500, 400)  # [Hz]
response = model.response(f)
figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
axes.loglog(f, np.abs(response[:, 0, 0]))
axes.set(xlabel="f [Hz]", ylabel=f"{model.outputs[0]} per {model.inputs[0]}");
# %% [markdown]
# ## A digital controller on the flexible robot
#
# A PD controller at 1 kHz with a delay of one sample follows a command, with its torques fed
# forward. Between the controller's instants the run solves the coupled equations.

# %%
motion = pf.nonic(platform={"x": 0.06, "y": 0.03, "rz": 0.3}, duration=0.08)
found = pf.command(robot, motion, "exact", before=0.04, after=0.06)
control = pf.track(robot, found, kp=50.0, kd=1.0, period=1e-3, delay=1e-3)
run = pf.solve(robot, found.motion, "coupled", start="static", control=control,
               until=float(found.t[-1]), tol=1e-3)

path = found.reference[0, :2] + motion.evaluate(run.t - found.before)[0][:, :2]
off = np.linalg.norm(run.frame("platform").position[:, :2] - path, axis=1)
print(f"platform off its path by {1e6 * off.max():.1f} um with {np.abs(run.torque).max():.2f} N m")
assert off.max() < 1e-4

# %%
figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
axes.plot(run.t, run.torque, label=run.motors)
axes.set(xlabel="t [s]", ylabel="torque [N m]")
axes.legend(frameon=False);

# %% [markdown]
# How much gain and delay does it leave before the robot oscillates? `pf.margins` says so, at one
# pose or several.

# %%
print(pf.margins(robot, control))

# %% [markdown]
# Any law u(t, m, dm/dt, integral of m) can replace `track`: see `pf.Control`, and
# `pf.digital_pid` for one with anti-windup. The example `closed_loop.py` compares a
# rigid command with an exact one on a robot that resonates at 17 Hz.
