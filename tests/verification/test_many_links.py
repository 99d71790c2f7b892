"""Many flexible links and long chains: memory, numbers, and what is said without the kernel.

Claims:
    Invariances, a second opinion, workspaces
    - 32 links load and run: most memory of the process | nV^3: 5 GB | 200 MB | 140
    - six equal arms side by side = one alone; all six the same | independence | 1e-3 (steps
      differ); 1e-9 | passes
    - 16 segments in a row: frequencies of a cantilever, too high by (k h)^4 / 1440 | closed form;
      cubic elements | 0.1 of the term | passes
    - without the kernel a chain of 32 is refused, with what to do | - | exact | exact
    Tolerances, collocation
    - delta: bars of both errors cover six segments in each link with every deformation and shear
      (54 elements, 600 coordinates), first 0.06 s | six segments | error <= bar < 5 error | 0.9 %
      of 1.8 %, 2.6 % of 5.2 %, 2.8 % of 5.7 %; without shear whole motion by hand, tol 1e-3: torque
      4.9e-4 of 8.5e-4, deflection 1.8e-3 of 1.1e-2, plate 6.6e-4 of 1.1e-3, 1.1e-3 of 2.0e-3
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import DescriptionError
from pinflex.kernel.library import kernel
from tests.analytical import wave_numbers
from tests.benchmarks.growth import serial, tree
from tests.validation.test_advise import measured, truth

ROOT = Path(__file__).resolve().parents[2]
compiled = pytest.mark.skipif(kernel().functions is None, reason="needs the compiled kernel")


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
def test_32_links_load_and_run_in_200_megabytes() -> None:
    """nV^3 would be 5 GB."""
    script = (
        "import pinflex as pf\n"
        "from tests.benchmarks.growth import memory, tree\n"
        "pf.solve(tree(32), level='coupled', until=0.2, tol=1e-2)\n"
        "print(memory())"
    )
    ended = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert float(ended.stdout) < 200.0  # 140


def test_arms_side_by_side_move_as_one_alone() -> None:
    """What nothing links is factored apart: the same steps, the same torques."""
    keys = {"level": "coupled", "until": 0.2, "tol": 1e-3, "samples": 21}
    alone, six = (pf.solve(tree(links), **keys) for links in (2, 12))
    scale = np.abs(alone.torque).max()
    for k in range(6):
        # Steps differ where norms over all arms do: within the error that is told.
        off = np.abs(six.torque[:, 2 * k : 2 * k + 2] - alone.torque).max() / scale
        assert off < 1e-3
    assert np.ptp(six.torque[:, ::2], axis=1).max() < 1e-9 * scale  # equal arms, in any place


@compiled
def test_a_beam_of_many_modes_needs_no_workspace_of_pinocchio() -> None:
    """154 stations on one joint: 3 GB, which was refused without asking."""
    m = pf.load("prprp", ["flexible.beam.basis.modes=75"])
    assert m.flexible.n_eta == 75 and m.flexible.expansion.model.nv > 400


@compiled
def test_a_chain_of_16_segments_has_the_frequencies_of_a_cantilever() -> None:
    m = serial(16)
    part = m.parts["l"]
    section, rho = part.spec.section, part.spec.material.rho
    k = wave_numbers("clamped_free", 4)
    exact = k**2 * np.sqrt(7e10 * section.Iz / (rho * section.A)) / (2 * np.pi)
    found = pf.modes(m, count=4, preload="none").frequencies
    # Cubic elements are too stiff by (k h)^4 / 720, in the square; the next term is a few per cent.
    too_high = (k / 16) ** 4 / 1440
    np.testing.assert_allclose(found / exact - 1.0, too_high, rtol=0.1, atol=1e-8)


def test_without_the_kernel_a_long_chain_is_refused_and_says_why(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PINFLEX_KERNEL", "0")
    with pytest.raises(DescriptionError, match="compiled kernel needs less.*PINFLEX_KERNEL=0"):
        serial(32)


@compiled
def test_the_error_bars_of_the_delta_cover_six_segments_with_shear() -> None:
    """72 elements with every deformation, on the first part of the pick: 600 coordinates."""
    m = pf.load("delta")
    keys = {"level": "coupled", "until": 0.06, "samples": 31}
    run = pf.solve(m, tol=1e-3, **keys)
    thick = ["flexible.*.shear=true", "flexible.*.rotary_inertia=true", "flexible.*.segments=6"]
    full = pf.load(truth(m).description.with_overrides(thick))
    assert full.flexible.expansion.model.nv > 1000
    exact = pf.solve(full, tol=1e-3, **keys)
    rigid = pf.solve(m, level="rigid", until=0.06, samples=31)
    errors = measured(run, exact, rigid, ("torque", "deflection", "platform"))
    for key, error in errors.items():
        # Shear of the arms is 1 to 3 %; twice what one segment more changes is aimed at.
        assert 0 < error <= run.errors.time[key] + run.errors.model[key] < 5 * error
