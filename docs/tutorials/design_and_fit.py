# %% [markdown]
# # Design and fit
#
# What should be changed, what is the best value, and is the robot that was built the one that was
# calculated? Three calls on one model.
#
# ## What matters
#
# Per cent of an output for one per cent of a number of the YAML: exact derivatives where they
# exist, checked differences elsewhere.

# %%
import numpy as np

import pinflex as pf

what = pf.sensitivities("ur5", by=["flexible.*.section.*"], of=["frequency.1", "sag"])
print(what.text())

# %% [markdown]
# ## The best numbers within limits
#
# The lightest tubes with which the first frequency stays where it is.

# %%
lighter = pf.design(
    "ur5", "mass",
    {"flexible.*.section.wall": (0.5e-3, 8e-3), "flexible.*.section.diameter": (0.05, 0.12)},
    keep=["frequency.1 > base"], starts=1,
)
print(lighter.text())
assert lighter.after["mass"] < lighter.before["mass"]

# %%
lighter.write("lighter.yaml")
print(pf.modes(pf.load("lighter.yaml"), count=2).frequencies.round(2), "Hz")

# %% [markdown]
# ## What was built
#
# A hammer test of the real robot found four frequencies. Which moduli explain them, how well, and
# can the two be told apart at all? Here the measurement is made up from known moduli, with noise.

# %%
KEYS = ["flexible.upper_arm_link.material.E", "flexible.forearm_link.material.E"]
robot = pf.load("ur5")
built = pf.load(robot.description, [f"{KEYS[0]}=6.2e10", f"{KEYS[1]}=7.6e10"])
noise = 1 + 0.002 * np.random.default_rng(1).standard_normal(4)
measured = {
    "frequency": pf.modes(built, count=4).frequencies * noise,
    "std": 0.002 * pf.modes(built, count=4).frequencies,
}
found = pf.fit(robot, measured, KEYS)
print(found.text())
for (low, high), true in zip(found.intervals, (6.2e10, 7.6e10), strict=True):
    assert low < true < high

# %%
found.plot();

# %% [markdown]
# From a terminal: `pinflex sensitivity`, `pinflex design`, `pinflex fit`; scatter of many robots is
# `pinflex sweep MODEL --random 300 --normal KEY=5%`.
