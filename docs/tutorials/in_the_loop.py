# %% [markdown]
# # In the loop
#
# A controller, a learner or a test bench asks for one step at a time. `Simulator` takes the equal
# steps of level `coupled`, with motors that follow you (`motion=`) or that you push (`torque=`).

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

robot = pf.load("ur5")
sensors = {
    "elbow": pf.Encoder("elbow_joint", resolution=2 * np.pi / 2**17),
    "strain": pf.StrainGauge("forearm_link", x=0.02, y=0.03),
    "imu": pf.Imu("tool0"),
}
arm = pf.Simulator(robot, dt=1e-3, sensors=sensors)
hold = arm.motors.torque
print("held at rest by", hold.round(2), "N m")
print("the inertial unit feels", arm.sensor("imu")[:3].round(3), "m/s^2")

# %% [markdown]
# ## A controller of your own
#
# A PD law at 1 kHz turns the shoulder by 0.2 rad in 0.4 s, with the torque that held the arm fed
# forward. The torque that a step is given is the one at its end: with what was read at its
# beginning the loop has a delay of one step, as a digital one has.

# %%
stiff = np.array([400.0, 400.0, 200.0, 10.0, 10.0, 1.0])  # [N m/rad], as the arm carries
damped = 0.1 * stiff  # [N m s/rad]
start = arm.motors.position


def pd(now, t):
    s = min(t / 0.4, 1.0)
    goal = start + np.array([0.2, 0, 0, 0, 0, 0]) * s**3 * (10 - 15 * s + 6 * s**2)
    return hold + stiff * (goal - now.position) - damped * now.velocity


arm.reset().record()
strain = []
while arm.time < 0.8:
    arm.step(torque=pd(arm.motors, arm.time))
    strain.append(float(arm.sensor("strain")))
run = arm.result()  # a result like that of pf.solve
turned = arm.motors.position[0] - start[0]
print(f"turned by {turned:.4f} rad, "
      f"stress up to {max(run.link(x).von_mises.max() for x in run.links) / 1e6:.1f} MPa")
assert abs(turned - 0.2) < 2e-3

# %%
figure, axes = plt.subplots(1, 2, figsize=(8, 2.8), layout="constrained")
axes[0].plot(run.t, run.joint("shoulder_pan_joint").angle - start[0])
axes[0].set(xlabel="t [s]", ylabel="shoulder [rad]")
axes[1].plot(run.t[1:], 1e6 * np.array(strain))
axes[1].set(xlabel="t [s]", ylabel="strain [um/m]");

# %% [markdown]
# ## Back to where it was
#
# What goes on from a snapshot is the same to the last bit. A step that cannot be taken (numbers
# that are none, a motor at its stop, an input that jumps too far) raises one sentence, and the
# simulator stays where it was.

# %%
kept = arm.snapshot()
first = [arm.step(torque=hold).motors.position for _ in range(20)]
arm.restore(kept)
again = [arm.step(torque=hold).motors.position for _ in range(20)]
print("the same to the last bit:", np.array_equal(first, again))
try:
    arm.step(torque=[np.nan] * 6)
except pf.DescriptionError as error:
    print(error)

# %% [markdown]
# ## What a step costs
#
# A step takes 12 Newton iterations and one new tangent at the most (`iterations`, `tangents`;
# `every` renews it on a schedule); new ones are made ahead of need, evaluated behind one step and
# factored behind the next. `pinflex bench ur5 --worst` takes a million steps and tells median,
# rare ones and the largest beside the same arithmetic again and again: what both share is the
# machine's. Here a few, on the machine that built this page.

# %%
from pinflex.live.cost import step_cost

cost = step_cost(robot, steps=2000)
print(f"median {1e6 * cost.percentiles[50.0]:.0f} us, 99.9 % within "
      f"{1e6 * cost.percentiles[99.9]:.0f} us; {cost.iterations[1]} iterations at the most")

# %% [markdown]
# ## Without Python
#
# The same steps as an FMU (FMI 2.0, or 3.0 with `--fmi 3`; co-simulation) for Simulink, Modelica
# tools or FMPy, or as C sources: from the shell `pinflex export ur5 --fmu ur5.fmu`, `pinflex export
# ur5 --c ur5_c`. Variables have the names and units of the table of a run, and `stress LINK` is the
# largest normal stress by the strains of a beam. Parameters: `damping` multiplies the damping of
# joints and links, `payload` is the mass in kg that the platform carries. Derivatives of outputs by
# inputs are there (`fmi2GetDirectionalDerivative`): those of one step.
#
# `examples/controller_in_c.py` couples such an FMU with a controller in C, another FMU;
# `examples/lqg_in_the_loop.py` has a Kalman filter behind an encoder and a delay, and
# `examples/learn_to_reach.py` is an environment of gymnasium, with what a few hundred tries learn.

# %%
with tempfile.TemporaryDirectory() as folder:
    sources = pf.export_c(pf.Simulator(robot), Path(folder) / "ur5_c")
    print(sorted(path.name for path in sources.glob("*"))[-12:])
