"""Every array of a stored run again, from its states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinflex.boundary import public
from pinflex.description.motion import Motion
from pinflex.mechanics.mechanism import Mechanism, takes_model
from pinflex.recovery.recover import recover
from pinflex.recovery.samples import run_of
from pinflex.results.result import Result
from pinflex.solver.solve import default_motion, rigid_reference
from pinflex.threads import one_blas_thread


@public
@takes_model
@one_blas_thread()
def recompute(mechanism: Mechanism, result: Result, motion: Motion | None = None) -> Result:
    """Fields of links and bodies to the last digits, which a compact file keeps to 5e-7.

        run = pf.recompute(pf.load("delta"), pf.Result.load("delta-compare/delta-coupled.npz"))

    Args:
        mechanism: The mechanism that was solved.
        result: Its run, from a file.
        motion: The motion that was solved; default: that of the YAML.
    Raises:
        DescriptionError: Another mechanism: its coordinates differ.
    """
    run = run_of(mechanism, result)
    if "energy/work" in result.arrays:
        flow = [result.array(f"energy/{part}") for part in ("work", "dissipated")]
        run = replace(run, work=np.column_stack(flow))
    moved = default_motion(mechanism) if motion is None else motion
    arrays = recover(mechanism, run, rigid_reference(mechanism, moved, run))
    meta = {key: value for key, value in result.meta.items() if key != "rounded"}
    return Result(result.t, {**result.arrays, **arrays}, meta)
