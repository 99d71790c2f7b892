# %% [markdown]
# # Design and fit
#
# Which number should change, what is its best value, and does the finished robot match the
# calculation? Three calls on one model answer this.
#
# ## What matters
#
# A sensitivity is the change of an output in per cent for 1 % more of a number in the YAML. pinflex
# uses exact derivatives where they exist and checked finite differences elsewhere.

# %%
import numpy as np

import pinflex as pf

what = pf.sensitivities("ur5", by=["flexible.*.section.*"], of=["frequency.1", "sag"])
print(what.text())

# %% [markdown]
# ## The best numbers within limits
#
# Find the lightest tubes that do not lower the first frequency.

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
# A hammer test of the real robot yields four frequencies. Which moduli explain them, how well, and
# can the test distinguish the two moduli at all? Here known moduli and noise simulate the
# measurement.

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
# From a terminal: `pinflex sensitivity`, `pinflex design`, `pinflex fit`; for the scatter of many
# robots `pinflex sweep MODEL --random 300 --normal KEY=5%`.
