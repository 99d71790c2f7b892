# %% [markdown]
# # In the loop
#
# A controller, a learning agent or a test bench needs one step at a time. `Simulator` takes equal
# steps of level `coupled`; you give the motors a motion (`motion=`) or a torque (`torque=`).

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
# A PD law at 1 kHz turns the shoulder by 0.2 rad in 0.4 s, with the holding torque of the start fed
# forward. A step takes the torque at its end. Computed from the state at its beginning, that
# torque has a delay of one step, as in a digital loop.

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
# ## Go back to an earlier state
#
# From a snapshot the simulator repeats its steps to the last bit. If it cannot take a step (NaN as
# input, a motor at its stop, an input that jumps too far), it raises an error of one sentence and
# keeps its state.

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
# A step takes at most 12 Newton iterations and one new tangent (`iterations`, `tangents`; `every`
# renews it on a schedule). The simulator prepares new tangents ahead of need: it evaluates one
# after a step and factors it after the next. `pinflex bench ur5 --worst` takes a million steps and
# prints their median, high quantiles and maximum, beside those of one repeated piece of arithmetic;
# outliers that both show come from the machine. Here are a few steps, on the machine that built
# this page.

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
# ur5 --c ur5_c`. Variables have the names and units of a run's table; `stress LINK` is the largest
# normal stress from the strains of a beam. You can set two parameters: `damping` multiplies the
# damping of joints and links, `payload` is the mass in kg that the platform carries.
# `fmi2GetDirectionalDerivative` returns derivatives of outputs with respect to inputs over one
# step.
#
# `examples/controller_in_c.py` couples such an FMU with a controller in C, a second FMU;
# `examples/lqg_in_the_loop.py` uses a Kalman filter behind an encoder and a delay;
# `examples/learn_to_reach.py` is a gymnasium environment and trains on it for a few hundred
# episodes.

# %%
with tempfile.TemporaryDirectory() as folder:
    sources = pf.export_c(pf.Simulator(robot), Path(folder) / "ur5_c")
    print(sorted(path.name for path in sources.glob("*"))[-12:])
