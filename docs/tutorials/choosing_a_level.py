# %% [markdown]
# # Choosing a level
#
# A level is how much of the physics is solved. Each one is the limit of the next: `rigid` has no
# elasticity, `quasistatic` balances inertia and gravity at every instant, `ked` vibrates linearly
# about the rigid motion, `coupled` solves everything. Take the simplest that your question allows.
#
# ## All four on one scene
#
# A spatial 3-RRS with links of 5 x 3 mm, moved within 0.2 s and then left to ring.

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
# The scene starts undeformed under gravity and shakes: quasistatic answers with its mean, and the
# linear level follows the vibration until deflections are no longer small.
#
# ## Ask
#
# `advise` looks at a scene, solves cheap models of it and proposes what a tolerance needs: the
# level, which links bend, in which planes, with how many modes.

# %%
from pinflex.__main__ import main

main(["advise", "race_r2", "--tol", "0.05"]);  # in Python: pf.advise(robot, tol=0.05)

# %% [markdown]
# ## Two errors
#
# A run has an error of time integration and one of the model. `tol` bounds the first; the second is
# measured when you ask for it, by a model with more of everything.

# %%
run = pf.solve(pf.load("cantilever"), tol=1e-3)
print("\n".join(run.errors.lines()))

# %% [markdown]
# From a terminal: `pinflex compare MODEL` makes the table above with a verdict, and
# `pinflex solve MODEL --level auto` takes the proposal. The equations of each level are in
# [theory](../theory.md#levels).
