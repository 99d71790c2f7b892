# %% [markdown]
# # Choosing a level
#
# A level is the amount of physics that a run solves. Each level is a limit of the next: `rigid` has
# no elasticity, `quasistatic` balances inertia and gravity at every instant, `ked` adds linear
# vibration about the rigid motion, `coupled` solves everything. Take the simplest one that answers
# your question.
#
# ## All four on one scene
#
# The scene is a spatial 3-RRS with links of 5 x 3 mm. It moves for 0.2 s and then rings.

# %%
import time

import matplotlib.pyplot as plt
import numpy as np

import pinflex as pf

robot = pf.load("race_r2")
runs, cost = {}, {}
for level in pf.LEVELS:
    began = time.process_time()
    runs[level] = pf.solve(robot, level=level)
    cost[level] = time.process_time() - began

reference = runs["coupled"]
span = np.abs(reference.torque).max()
print(f"{'level':12}{'platform off [mm]':>20}{'torque off [%]':>17}{'CPU [s]':>10}")
for level, run in runs.items():
    off = run.deviation_from(reference, "platform").max()
    torque = np.abs(run.torque - reference.torque).max() / span
    print(f"{level:12}{1e3 * off:20.3f}{100 * torque:17.2f}{cost[level]:10.2f}")

# %%
figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
for level, run in runs.items():
    if level != "rigid":
        off = run.deviation_from(runs["rigid"], "platform")
        axes.plot(off.t, 1e3 * off.norm, label=level)
axes.set(xlabel="t [s]", ylabel="off rigid [mm]")
axes.legend(frameon=False);
# %% [markdown]
# The scene starts undeformed under gravity and shakes. Level quasistatic gives the mean of this
# vibration; the linear level follows it until deflections are no longer small.
#
# ## Ask
#
# `advise` solves cheap models of a scene and proposes what a tolerance requires: the level, the
# links that bend, their planes, and the number of modes.

# %%
from pinflex.__main__ import main

main(["advise", "race_r2", "--tol", "0.05"]);  # in Python: pf.advise(robot, tol=0.05)

# %% [markdown]
# ## Two errors
#
# A run has an error of time integration and an error of the model. `tol` bounds the first. On
# request pinflex measures the second by comparing with a richer model.

# %%
run = pf.solve(pf.load("cantilever"), tol=1e-3)
print("\n".join(run.errors.lines()))

# %% [markdown]
# From a terminal: `pinflex compare MODEL` prints the table above with a verdict, and
# `pinflex solve MODEL --level auto` uses the proposal. For the equations of each level see
# [theory](../theory.md#levels).
