"""The equations of a system on the compiled kernel, where there is one and it covers the system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pinflex.bodies.basis import tips_over
from pinflex.description.blocks.flexible import FlexibleLink
from pinflex.errors import DescriptionError
from pinflex.kernel.evaluate import Evaluator
from pinflex.kernel.library import kernel

if TYPE_CHECKING:
    from pinflex.mechanics.model.system import System


def serves(system: System, marched: bool = False) -> bool:
    """Whether the compiled kernel evaluates a system.

    Where nothing gives way the equations are Pinocchio itself, to the last bit, but in a march.
    """
    if kernel().functions is None or (_stiff(system) and not marched):
        return False
    return system.uncovered is None


def evaluated_by(system: System, marched: bool = False) -> str:
    """Which equations serve a system: the build of the kernel, or why it is not used."""
    library = kernel()
    if _stiff(system) and not (marched and serves(system, True)):
        return "Pinocchio (nothing gives way)"
    if library.functions is None:
        return f"numpy and Pinocchio (kernel: {library.said})"
    if system.uncovered is not None:
        return f"numpy and Pinocchio (the kernel has no {system.uncovered})"
    return f"kernel ({library.said})"


def _stiff(system: System) -> bool:
    return system.n_eta == 0 and not len(system.springs.v_at)


class Compiled(Evaluator):
    """The equations of one system by compiled functions (make one per run, and per thread)."""

    def __init__(self, system: System) -> None:
        loads = [force for force, _ in system.loads.forces]
        super().__init__(system.tables, loads, system.node_of_joints)


# What a scene would cost, counted before it is spent: coordinates, memory, steps.
#
# Estimates are there to tell minutes from days; the key `limit` of the description multiplies what
# is taken without asking.

MEMORY = 2e9  # [bytes]
STEPS = 2e7  # of a run: half an hour at the least
SAMPLES = 1_000_000
_STATIONS = 41  # at which a result has the fields of a link
_FIELDS = 26  # numbers at each: displacements, resultants, stresses, three lines


def per_body(spec: FlexibleLink, planes: Sequence[str]) -> tuple[int, int]:
    """Elastic coordinates of one body of a link, and velocity coordinates of its stations."""
    basis = spec.basis
    bending, other = sum(d in planes for d in "vw"), sum(d in planes for d in "up")
    order = 3 if basis.order == "quintic" else 2
    if basis.kind == "finite_element":
        n = basis.elements * (bending * order + other * (order - 1))
        stations = basis.elements * 2 * order
    elif basis.kind == "assumed":
        n, stations = basis.modes * (bending + other), 2 * basis.modes + 4
    else:
        n = (basis.internal + 2) * bending + max(basis.internal - 1, 1) * other
        n += tips_over(spec, planes)
        stations = basis.internal + 4
    return n, stations * (6 if spec.rotary_inertia is True else 4 if "p" in planes else 3) + 6


def require_memory(where: str, spec: FlexibleLink, planes: Sequence[str], limit: float) -> None:
    """Raise where the bodies of one link would take more memory than is taken without asking."""
    n, rows = per_body(spec, planes)
    total = rows * spec.segments
    # G while it is made (measured), and matrices of all elastic coordinates; of workspaces the
    # system knows more (`require_workspace`).
    size = 48.0 * rows * float(n) ** 2 * spec.segments + _matrices(n * spec.segments, total)
    if size > MEMORY * limit:
        key = "segments" if spec.segments > 1 else f"basis.{_count(spec)}"
        raise DescriptionError(
            f"{where}.{key}: {n * spec.segments} elastic coordinates on {total} coordinates of "
            f"stations would take about {_bytes(size)}, {_more(size, MEMORY * limit)}",
            coordinates=n * spec.segments,
        )


def require_workspace(where: str, system: System, limit: float) -> None:
    """Raise where the whole flexible system would take too much memory.

    Without the compiled kernel Pinocchio does the work, on four tensors of its coordinates cubed.
    """
    coordinates, whole = int(system.expansion.model.nv), not serves(system)
    size = 32.0 * float(coordinates) ** 3 if whole else 0.0
    size += _matrices(system.nv, coordinates)
    if size > MEMORY * limit:
        why = (
            f" The compiled kernel needs less, but here is {evaluated_by(system)}." if whole else ""
        )
        raise DescriptionError(
            f"{where}: flexible: the links together have {coordinates} coordinates of stations, "
            f"which take about {_bytes(size)}, {_more(size, MEMORY * limit)}{why}",
            coordinates=coordinates,
        )


def _matrices(n: float, coordinates: float) -> float:
    """Bytes of matrices of n unknowns, and of those by their expanded coordinates."""
    return 8.0 * n * (3.0 * coordinates + 20.0 * n)


def require_steps(mechanism: Any, steps: float, end: float, key: str) -> None:
    """Raise where a run in equal steps would take too many, or keep more than memory holds."""
    limit, system = mechanism.description.limit, mechanism.flexible
    size = 8.0 * steps * (5.0 * system.nv + system.closed.n + 2.0 * len(system.motors) + 4.0)
    if steps <= STEPS * limit and size <= MEMORY * limit:
        return
    ratio = max(steps / (STEPS * limit), size / (MEMORY * limit))
    raise DescriptionError(
        f"{mechanism.name}: solve.{key}: {steps:.3g} steps of {end / steps:.3g} s to "
        f"{end:.4g} s would keep about {_bytes(size)}; {STEPS * limit:.3g} steps and "
        f"{_bytes(MEMORY * limit)} are taken without asking. Take a larger dt or a tol, stop "
        f"earlier, or allow it with `limit: {_round_up(limit * ratio)}` (--limit).",
        steps=steps,
    )


def require_samples(mechanism: Any, samples: int) -> None:
    """Raise where the samples of a run would not fit."""
    limit, system = mechanism.description.limit, mechanism.flexible
    fields = _STATIONS * _FIELDS * len(mechanism.parts)
    size = 8.0 * samples * (6.0 * system.nv + fields + 20.0 * len(mechanism.links))
    if samples <= SAMPLES * limit and size <= 4 * MEMORY * limit:
        return
    ratio = max(samples / (SAMPLES * limit), size / (4 * MEMORY * limit))
    raise DescriptionError(
        f"{mechanism.name}: solve.samples: {samples} instants would take about {_bytes(size)} with "
        f"all their fields; {_bytes(4 * MEMORY * limit)} and {SAMPLES * limit:.3g} instants are "
        f"taken without asking. Take fewer, or allow it with `limit: {_round_up(limit * ratio)}` "
        "(--limit).",
        samples=samples,
    )


def _count(spec: FlexibleLink) -> str:
    return {"finite_element": "elements", "assumed": "modes"}.get(spec.basis.kind, "internal")


def _more(size: float, most: float) -> str:
    ratio = _round_up(size / MEMORY)
    return (
        f"{_bytes(most)} is taken without asking. Take fewer, or allow it with `limit: {ratio}` "
        "(--limit)."
    )


def _round_up(ratio: float) -> str:
    return f"{1.05 * ratio:.2g}"


def _bytes(size: float) -> str:
    return f"{size / 1e9:.3g} GB"
