# %% [markdown]
# # Play, stops and clearance
#
# Real gears have backlash, pins have clearance, joints reach their stops, and cables can only pull.
# Each of these is one key of the YAML. Level coupled ends a step wherever a contact begins or ends,
# so contacts cost no accuracy; `run.events` lists them.
#
# ## Backlash
#
# A motor swings a link back and forth; its gear has 0.5 deg of play between the flanks.

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

Path("arm.urdf").write_text("""<robot name="arm"><link name="base"/><link name="link"><inertial>
<origin xyz=".2 0 0"/><mass value="1"/>
<inertia ixx="1e-3" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="elbow" type="revolute"><parent link="base"/><child link="link"/>
<axis xyz="0 1 0"/><limit effort="50" velocity="3" lower="-2" upper="2"/></joint></robot>""")
Path("arm.yaml").write_text("""urdf: arm.urdf
actuated: [elbow]
frames: [link]
joints: {elbow: {drive: {motor_inertia: 0.05, stiffness: 800, damping: 0.5, backlash: 0.5 deg}}}
motion: {kind: harmonic, joints: {elbow: 0.5}, frequency: 2, smooth: 0.3, duration: 1.5}
solve: {level: coupled, start: straight, tol: 1.0e-5}
""")
loose = pf.solve(pf.load("arm.yaml"))
tight = pf.solve(pf.load("arm.yaml", ["joints.elbow.drive.backlash=0"]))
print(len(loose.events), "contacts and releases, the first:", loose.events[0])

figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
for run, name in ((tight, "without play"), (loose, "0.5 deg")):
    axes.plot(run.t, np.degrees(run.drive("elbow").deflection), label=name)
axes.axhspan(-0.25, 0.25, color="0.9")
axes.set(xlabel="t [s]", ylabel="gear [deg]")
axes.legend(frameon=False);

# %% [markdown]
# Its weight holds the link against one flank. It crosses the play (grey) when the motion reverses
# the torque.
#
# ## Stops
#
# `stiffness` and `damping` define an elastic bumper. `restitution` defines a rigid stop, which
# returns a part of the speed instantly; the event records the impulse and the energy loss.

# %%
Path("falling.yaml").write_text("""urdf: arm.urdf
actuated: []
frames: [link]
joints: {elbow: {stops: {upper: 1.0, restitution: 0.6}}}
solve: {level: coupled, start: straight, tol: 1.0e-6, until: 0.9}
""")
rigid = pf.solve(pf.load("falling.yaml"))
for event in rigid.events:
    print(f"{event.time:.4f} s: {event.speed:.3f} rad/s, {event.impulse:.3f} N m s, "
          f"{event.loss:.4f} J")
bumper = pf.solve(
    pf.load("falling.yaml", ["joints.elbow.stops={upper: 1.0, stiffness: 200, damping: 3}"])
)
figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
axes.plot(rigid.t, rigid.joint("elbow").position, label="restitution 0.6")
axes.plot(bumper.t, bumper.joint("elbow").position, label="bumper")
axes.axhline(1.0, color="0.6", lw=0.8)
axes.set(xlabel="t [s]", ylabel="elbow [rad]")
axes.legend(frameon=False);

# %% [markdown]
# A ball that bounces faster and faster comes to rest and stays on its stop until something lifts
# it.
#
# ## Pins with clearance
#
# The three pins of the planar 3-RRR, 5 mm in diameter, get 50 um of clearance and start at the
# centre of their holes. `pin_1` is a joint of the tree: pinflex cuts it and closes it again as a
# loop. The impacts excite the links. (Without `start` the pins begin where the motion presses them
# against their holes, and there are fewer impacts.)

# %%
pins = ["joints.pin_1={clearance: 50 um, pin: 5 mm}"]
pins += [f"loops.pin_{k}.{key}" for k in (2, 3) for key in ("clearance=50 um", "pin=5 mm")]
ideal = pf.solve(pf.load("3rrr"), tol=1e-3, until=0.05, samples=501)
run = pf.solve(pf.load("3rrr", pins), tol=1e-3, until=0.05, samples=501, start="straight")
for name, each in (("ideal", ideal), ("loose", run)):
    print(f"{name} pins: peak torque {np.abs(each.torque).max():.1f} N m")
print(len(run.events), "contacts and releases; energy accounted for to", run.meta["energy_balance"])
print(*run.meta["warnings"], sep="\n")
run.plot("loop/pin_2/orbit");

# %% [markdown]
# Read the last warning: impacts amplify small differences, so after some of them two runs diverge
# with any step, even if their initial speeds differ by only 1e-9. Then use peaks, means and spectra
# with their spread over three runs (pinflex makes the other two on request), or the history up to
# the time that the warning names.

# %%
motor = run.statistics["motor_1"]
print(f"motor_1: rms {motor.rms:.2f} +- {motor.spread[0]:.2f} N m, "
      f"peak {motor.peak:.1f} +- {motor.spread[1]:.1f} N m, of {motor.runs} runs")
figure, ax = plt.subplots(figsize=(8, 3), layout="constrained")
ax.errorbar(motor.frequencies, motor.levels, motor.spread[2:], fmt="o-", capsize=3)
ax.set(xscale="log", yscale="log", xlabel="octave from [Hz]", ylabel="torque, rms [N m]");

# %% [markdown]
# ## To the ideal joint
#
# With less clearance, less play or a stiffer stop, the difference from the ideal joint falls, to
# first order except for the vibration after impacts. For a stop it falls with the duration of
# contact, the square root of its compliance.

# %%
def angle(scene, change):
    return pf.solve(pf.load(scene, [change]), samples=46).joint("elbow").position

def gear(play):
    change = [f"joints.elbow.drive.backlash={play} deg"]
    return pf.solve(pf.load("arm.yaml", change), samples=46, until=0.5).drive("elbow").deflection

tight, bouncing = gear(0), angle("falling.yaml", "joints.elbow.stops={upper: 1, restitution: 1}")
rows = [(f"backlash {x} deg", np.abs(gear(x) - tight).max()) for x in (0.2, 0.1, 0.05)]
for k in (10000, 40000, 160000):
    stiff = angle("falling.yaml", f"joints.elbow.stops={{upper: 1, stiffness: {k}}}")
    rows.append((f"stop {k} N m/rad", np.abs(stiff - bouncing).max()))
Path("swing.yaml").write_text("""urdf: arm.urdf
actuated: []
frames: [link]
joints: {}
solve: {level: coupled, start: straight, tol: 1.0e-3, until: 0.3}
""")
swing = pf.solve(pf.load("swing.yaml"), samples=31)
for gap in (200, 100, 50):
    keys = f"joints.elbow={{clearance: {gap} um, pin: 10 mm, restitution: 0.5}}"
    loose = pf.solve(pf.load("swing.yaml", [keys]), samples=31)
    q = loose.array("joint/q")
    away = np.arctan2(q[:, 3], q[:, 2]) - swing.array("joint/q")[:, 0]
    rows.append((f"clearance {gap} um", float(np.abs(away).max())))
for name, apart in rows:
    print(f"{name:22} {1e3 * apart:8.4f} mrad off the ideal joint")

# %% [markdown]
# ## Cables and nonlinear springs
#
# `springs: {cable: {between: [A, B], stiffness: 1e5, length: 0.4, tension_only: true}}` pulls and
# never pushes. `table: [[0, 0], [0.01, 20], [0.02, 90]]` in place of the stiffness defines a spring
# by points (elongation, pull); `joints: {NAME: {table: ...}}` does the same for a joint.
#
# ## How loose is the platform?
#
# Where can the platform be while its motors stand still? `pf.play` computes this to first order,
# for pins with clearance, balls, and gears with backlash. Here each of the nine pins of the
# 3-RRR has 50 um.

# %%
found = pf.play("3rrr", clearance="50 um")
print(found)
far, turn = found.farthest[0], found.largest_turn[0]
print(f"farthest: {1e6 * far:.0f} um, turned by {1e3 * turn:.2f} mrad")

# %% [markdown]
# Each pin adds its clearance times the force that a unit load along that direction causes
# in it. So the play is largest near singular poses, where a machine is weakest. Over the
# workspace (`pinflex map 3rrr --play 50um --grid x=-.06:.06:7 --grid y=-.06:.06:7 --plot
# play.png` draws the same):

# %%
grid = {"x": np.linspace(-0.06, 0.06, 7), "y": np.linspace(-0.06, 0.06, 7)}
pf.play_map("3rrr", grid, clearance="50 um").plot();

# %% [markdown]
# ## Where does it rest?
#
# A load takes up the play. Level quasistatic, and the equilibria behind modes and `start: static`,
# solve for the resting place. Under 30 N in their plane the two loose pins let the platform drop by
# its play along the load, in addition to the sag of the links. Pins without load stay centred, and
# the run says so; `pinflex check` names them.

# %%
hold, weight = pf.hold(duration=0.1), ["forces.weight={at: platform, force: [0, -30, 0]}"]
ideal, low = (
    pf.solve(pf.load("3rrr", [*weight, *some]), hold, level="quasistatic", samples=2)
    for some in ([], pins)
)
down = ideal.frame("platform").position[0] - low.frame("platform").position[0]
reach = pf.play(pf.load("3rrr", pins)).reach([0, -1, 0, 0, 0, 0])
print(f"let down by {1e6 * down[1]:.1f} um; its play that way is {1e6 * reach:.1f} um")
