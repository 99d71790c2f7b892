# %% [markdown]
# # A delta robot from a URDF
#
# A parallel robot has loops, but a URDF describes a tree. Leave the joints that close the loops out
# of the URDF and write them in the YAML, one line each.
#
# ## The tree
#
# Three motors turn three arms, each arm carries a rod, and the first rod carries the plate with
# `tool` at its centre. The x axis of an arm points outward and y along the motor axis; the x axis
# of a rod points along the rod. A Python loop writes the equal parts.

# %%
from pathlib import Path

import numpy as np

import pinflex as pf

BASE, ARM, ROD, PLATE = 0.2, 0.3, 0.8, 0.05  # [m] radius of motors, lengths, radius of seats
Q = 0.3  # [rad] of the arms below the horizontal, where the robot starts
A = np.arctan2(np.sqrt(ROD**2 - (BASE + ARM * np.cos(Q) - PLATE) ** 2),
               PLATE - BASE - ARM * np.cos(Q))  # [rad] of the rods, from outward down


def link(name, mass=0.0, length=0.0):
    """A slender link along x; without mass it marks a point."""
    bend, turn = mass * length**2 / 12 + 1e-6 * mass, 5e-5 * mass
    inertia = f'ixx="{turn}" iyy="{bend}" izz="{bend}" ixy="0" ixz="0" iyz="0"'
    body = f'<origin xyz="{length / 2} 0 0"/><mass value="{mass}"/><inertia {inertia}/>'
    return f'<link name="{name}">{f"<inertial>{body}</inertial>" if mass else ""}</link>'


def joint(name, kind, parent, child, x=0.0, yaw=0.0, more=""):
    """A joint at x of its parent, or on a circle of that radius, turned by yaw."""
    place = f"{x * np.cos(yaw)} {x * np.sin(yaw)} 0"
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}" rpy="0 0 {yaw}"/>{more}</joint>'
    )


parts = [link("base"), link("tool"), joint("on_tool", "fixed", "plate", "tool", -PLATE)]
parts += [joint("wrist_1", "floating", "tip_1", "plate"), link("plate", 0.4, -2 * PLATE)]
for k, yaw in ((1, 0.0), (2, 2 * np.pi / 3), (3, 4 * np.pi / 3)):
    axis = '<axis xyz="0 1 0"/><limit lower="-1" upper="1.5" effort="100" velocity="20"/>'
    parts += [link(f"arm_{k}", 0.35, ARM), link(f"rod_{k}", 0.12, ROD), link(f"tip_{k}")]
    parts += [joint(f"motor_{k}", "revolute", "base", f"arm_{k}", BASE, yaw, axis)]
    parts += [joint(f"knee_{k}", "floating", f"arm_{k}", f"rod_{k}", ARM)]
    parts += [joint(f"end_{k}", "fixed", f"rod_{k}", f"tip_{k}", ROD)]
    if k > 1:  # the first rod carries the plate, the others are closed by loops
        parts += [link(f"seat_{k}"), joint(f"on_{k}", "fixed", "tool", f"seat_{k}", PLATE, yaw)]
Path("delta.urdf").write_text(f'<robot name="delta">{"".join(parts)}</robot>');

# %% [markdown]
# ## What the URDF cannot say
#
# The YAML adds `universal` joints, two loops, a guess of the pose (rough angles suffice) and the
# flexible links. Universal joints at both ends of a rod keep the plate level, as the parallelograms
# of a delta do, but only through the torsional stiffness of the rods; so the rods are thick.

# %%
Path("delta.yaml").write_text(f"""
urdf: delta.urdf
joints:
  knee_1: {{type: universal, axes: [y, z]}}
  knee_2: {{type: universal, axes: [y, z]}}
  knee_3: {{type: universal, axes: [y, z]}}
  wrist_1: {{type: universal, axes: [z, y]}}
actuated: [motor_1, motor_2, motor_3]
loops:
  wrist_2: {{kind: universal, between: [tip_2, seat_2], axis: z, axis_b: y}}
  wrist_3: {{kind: universal, between: [tip_3, seat_3], axis: z, axis_b: y}}
home:                      # [rad]
  motor_1: {Q}
  motor_2: {Q}
  motor_3: {Q}
  knee_1: [{A - Q:.2f}, 0]
  knee_2: [{A - Q:.2f}, 0]
  knee_3: [{A - Q:.2f}, 0]
  wrist_1: [0, {-A:.2f}]
platform: tool
flexible:
  "arm_?": {{material: aluminium, section: {{shape: tube, diameter: 0.03, wall: 0.002}}}}
  "rod_?": {{material: carbon_epoxy, section: {{shape: tube, diameter: 0.025, wall: 0.001}}}}
damping: {{modal: 0.01}}
motion: {{kind: quintic, platform: {{x: 0.1, y: 0, z: 0.05}}, duration: 0.25}}
solve: {{level: coupled, until: 0.4}}
""")
robot = pf.load("delta.yaml")

# %% [markdown]
# ## Check before you solve
#
# `pinflex check` counts freedoms and closure rows, computes the sag, and says what it left out and
# why. Eleven coordinates minus eight rows leave the three freedoms of a delta.

# %%
from pinflex.__main__ import main

main(["check", "delta.yaml"]);  # in a terminal: pinflex check delta.yaml

# %% [markdown]
# ## Move the plate

# %%
rigid = pf.solve(robot, level="rigid")
run = pf.solve(robot)
off = run.deviation_from(rigid, "tool")
print(f"plate off by {1e3 * off.max():.3f} mm, first frequency "
      f"{pf.modes(robot, count=1).frequencies[0]:.1f} Hz")
print(f"torque rigid {np.abs(rigid.torque).max():.2f} N m, "
      f"flexible {np.abs(run.torque).max():.2f} N m")
assert run.worst_closure < 1e-8

# %%
page = pf.view(run, "own_delta.html")

# %% [markdown]
# <iframe class="scene" src="delta_from_urdf/own_delta.html" title="The delta in motion"></iframe>
#
# The shipped `delta` has parallelograms: its first frequency is twice as high, with thinner rods.
# Would a simpler level suffice? See [Choosing a level](choosing_a_level.md). You can also start
# from a MuJoCo, SDF or xacro file: `pinflex import FILE` writes the YAML.
