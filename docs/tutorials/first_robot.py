# %% [markdown]
# # First robot
#
# A motor turns an arm of 0.6 m, described in twenty lines. What does its elasticity do to a quick
# move? You need nothing but pinflex ([Start](../start.md)); building this page executes every line
# below.
#
# ## Two files
#
# A **URDF** describes links, joints and masses. The massless link `tool` on a fixed joint marks a
# point.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

Path("arm.urdf").write_text("""
<robot name="arm">
  <link name="base"/>
  <link name="arm">
    <inertial>
      <origin xyz="0.3 0 0"/> <mass value="0.3888"/>
      <inertia ixx="3.4e-5" iyy="0.01168" izz="0.01168" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="tool">
    <inertial>
      <mass value="0.5"/>
      <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="motor" type="continuous">
    <parent link="base"/> <child link="arm"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="flange" type="fixed">
    <parent link="arm"/> <child link="tool"/> <origin xyz="0.6 0 0"/>
  </joint>
</robot>
""");

# %% [markdown]
# The **YAML** adds what a URDF cannot say: which link bends, its material and section, and the
# motion. The reference lists [every key](../reference/yaml.md) with its unit and default.

# %%
Path("arm.yaml").write_text("""
urdf: arm.urdf
gravity: [0, 0, 0]                # [m/s^2] the arm turns in a horizontal plane
platform: tool
flexible:
  arm:
    material: aluminium
    section: {shape: rectangle, width: 0.04, thickness: 0.006}   # [m] the thin side bends
damping: {modal: 0.01}
motion: {kind: quintic, joints: {motor: 1.0}, duration: 0.4}     # [rad], [s]
solve: {level: coupled, until: 0.8}
""")
robot = pf.load("arm.yaml")

# %% [markdown]
# ## Is it what I meant?
#
# Compare the first frequency with the motor locked to that of a massless cantilever with the tool
# and 33/140 of the arm's mass at its tip (Rayleigh's estimate).

# %%
modes = pf.modes(robot, count=3)
EI, L = 7.0e10 * 0.04 * 0.006**3 / 12, 0.6
estimate = np.sqrt(3 * EI / L**3 / (0.5 + 33 / 140 * 0.3888)) / (2 * np.pi)
print(modes.frequencies.round(2), "Hz; estimate", round(float(estimate), 2), "Hz")
assert abs(modes.frequencies[0] / estimate - 1) < 0.05

# %% [markdown]
# ## Move it
#
# Solve the same motion twice: rigid, and with every elastic link.

# %%
rigid = pf.solve(robot, level="rigid")
flexible = pf.solve(robot, level="coupled")
off = flexible.deviation_from(rigid, "tool")

figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 4.5), layout="constrained")
above.plot(rigid.t, rigid.torque, "k--", label="rigid")
above.plot(flexible.t, flexible.torque, label="flexible")
above.set_ylabel("torque [N m]")
above.legend(frameon=False)
below.plot(off.t, 1e3 * off.norm)
below.set(xlabel="t [s]", ylabel="tool off [mm]");
# %%
print(f"tool off by {1e3 * off.max():.2f} mm")
print(f"stress {1e-6 * flexible.link('arm').von_mises.max():.1f} MPa")

# %% [markdown]
# ## See it
#
# One file plays in any browser. Turn the robot with the mouse. The page magnifies deflections from
# the rigid pose and colours them by stress.

# %%
page = pf.view(flexible, "first_robot.html")

# %% [markdown]
# <iframe class="scene" src="first_robot/first_robot.html" title="The arm in motion"></iframe>
#
# From a terminal the whole tutorial is `pinflex compare arm.yaml`. Next: a robot whose
# [loops close](delta_from_urdf.md).
