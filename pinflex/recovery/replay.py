"""A finished run again: forces of every part from the states that a Result keeps."""

from __future__ import annotations

import numpy as np

from pinflex.actuation.nominal import Nominal
from pinflex.errors import DescriptionError
from pinflex.integrators.run import Run
from pinflex.mechanics.mechanism import Mechanism
from pinflex.recovery.samples import Samples
from pinflex.results.result import Result


def run_of(mechanism: Mechanism, result: Result) -> Run:
    """The states of a result as a run of the mechanism that it came from.

    Args:
        mechanism: The mechanism that was solved.
        result: Its run.

    Raises:
        DescriptionError: Another mechanism: its coordinates differ.
    """
    flexible = "eta" in result.arrays
    system = mechanism.flexible if flexible else mechanism.rigid
    parts = [("q", "eta"), ("v", "eta_v"), ("a", "eta_a")]
    y, v, a = (
        np.hstack([result.array(f"joint/{x}"), result.array(e)]) if flexible
        else result.array(f"joint/{x}")
        for x, e in parts
    )  # fmt: skip
    lam = result.array("multiplier")
    sizes = (y.shape[1], v.shape[1], lam.shape[1])
    wanted = (system.nq, system.nv, system.closed.n)
    if sizes != wanted or result.meta["name"] != mechanism.name:
        raise DescriptionError(
            f"{result.meta['name']}: the result has {sizes} coordinates, rates and closure rows, "
            f"the mechanism {mechanism.name} has {wanted}. Give the mechanism that was solved."
        )
    path = None
    if "nominal/q" in result.arrays:
        rigid = [result.array(f"nominal/{x}") for x in "qva"]
        path = Nominal(result.t, rigid[0], rigid[1], rigid[2])
    settings = dict(result.meta["settings"])
    return Run(system, result.t, y, v, a, lam, result.torque, {}, settings, path=path)


def samples_of(mechanism: Mechanism, result: Result) -> Samples:
    """Forces at every station, section and joint over the run.

    Args:
        mechanism: The mechanism that was solved.
        result: Its run.
    """
    return Samples(mechanism, run_of(mechanism, result))
