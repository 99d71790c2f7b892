# %% [markdown]
# # The fastest move
#
# How short can a move be that keeps the motors within their limits and leaves nothing swinging? We
# answer this for the simplest system that swings, whose solution is known, and for a delta.
#
# ## Two masses and a spring
#
# A cart of 1 kg carries a load of 1 kg on a spring of 1 N/m. Its motor pushes with at most 1 N.
# The shortest move from rest to rest over one metre takes 4.2179 s (Liu and Wie 1992).

# %%
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

folder = Path(tempfile.mkdtemp())
inertial = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
limit = '<axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1" velocity="100"/>'
(folder / "two.urdf").write_text(f"""<robot name="two">
<link name="rail"/><link name="cart">{inertial}</link><link name="load">{inertial}</link>
<joint name="drive" type="prismatic"><parent link="rail"/><child link="cart"/>{limit}</joint>
<joint name="spring" type="prismatic"><parent link="cart"/><child link="load"/>{limit}</joint>
</robot>""")
(folder / "two.yaml").write_text("""urdf: two.urdf
gravity: [0, 0, 0]
actuated: [drive]
joints: {spring: {spring: 1}}
platform: load
""")
two = pf.load(folder / "two.yaml")
found = pf.fastest(
    two, {"drive": 1.0}, settle={"position": 1e-6, "speed": 1e-6}, limits={"jerk": np.inf},
    drive="torque", intervals=16, close=1e-3,
)
print(f"{found.duration:.5f} s; a rigid robot of both masses: {found.rigid:.5f} s")

# %% [markdown]
# With `drive="torque"` the motor applies a force and nothing prescribes its motion. `jerk: inf`
# lets the force jump, and `settle` limits the end state to a micrometre and a micrometre per
# second. The force switches from limit to limit three times; there pinflex refines the time grid
# until the duration converges.

# %%
t = np.linspace(0.0, 1.3 * found.duration, 801)
push = 2.0 * found.profile.at(t)[2]  # both masses, times the acceleration of a rigid robot
run = pf.solve(
    two, found.motion, level="coupled", drive="torque", kp=0, kd=0, tol=1e-5,
    asked=("platform",), until=t[-1], samples=len(t),
)
figure, axes = plt.subplots(2, 1, figsize=(8, 4), sharex=True, layout="constrained")
axes[0].plot(t, push)
axes[0].set(ylabel="force [N]")
axes[1].plot(run.t, run.joint("drive").position, label="cart")
axes[1].plot(run.t, run.frame("load").position[:, 0], label="load")
axes[1].axvline(found.duration, color="0.6", lw=0.8)
axes[1].set(xlabel="t [s]", ylabel="position [m]")
axes[1].legend(frameon=False);

# %% [markdown]
# ## A delta
#
# The shipped delta moves its plate by 305 mm. The limits are those of its quintic of 0.3 s: the
# speed of the plate, the torque, and six times the jerk. From the end on the plate must stay within
# 50 um of its resting place; the motors follow a prescribed motion this time. `robust={"payload":
# 0.2}` would demand the same for a heavier and a lighter load, at two to three times the computing
# time.

# %%
from pinflex.quickest.limits import of_motion

delta = pf.load("delta")
to = {"x": 0.305, "y": 0, "z": 0}
limits = of_motion(delta, pf.quintic(platform=to, duration=0.3))
move = pf.fastest(delta, to, settle=50e-6, limits=limits, close=5e-3)
print(move)

# %% [markdown]
# For comparison, under the same limits: jerk-limited profiles with zero-vibration shapers for one
# mode and for two. `move.baselines()` computes 14 to 32 common motions,
# and `move.page("race.html", rows)` writes a page on which they race.

# %%
from pinflex.quickest.baselines import baselines

rows = baselines(move, profiles=("jerk-limited",), shapers=("zv",))
for row in rows:
    print(f"{row.name:24}ends {row.ends:.3f} s, still from {row.settled:.3f} s")
move.plot(rows);

# %% [markdown]
# ## To the controller
#
# The file has one row per millisecond. Played back as a trajectory, it keeps the limits too.

# %%
move.motion.to_csv(folder / "move.csv", 1000, delta)
again = pf.solve(
    delta, pf.trajectory(folder / "move.csv"), level="coupled", tol=1e-4, asked=("platform",),
    until=0.3, samples=1201,
)
rate = np.linalg.norm(again.frame("plate").velocity[:, :3], axis=1)
print(f"torque {100 * np.abs(again.torque).max() / limits['torque']:.1f} %, "
      f"speed of the plate {100 * rate.max() / limits['speed']:.1f} % of their limits")

# %% [markdown]
# From a terminal: `pinflex move delta --to x=0.305 --to y=0 --to z=0 --like 0.3 --settle 50um
# --baselines -o move.csv`. `pinflex move plan.csv --robot ur5` retimes a trajectory that you
# already have.
