"""What a control measured and drove along a run."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pinflex.arrays import Array, IntArray


@dataclass(frozen=True)
class Signals:
    """What a control did.

    Attributes:
        names: Of the drives. B: Forces per drive, shape (nv, nu).
        u: Drives (V | N m | N), shape (nt, nu). measured: m (m | rad), shape (nt, nm).
    """

    names: tuple[str, ...]
    B: Array
    u: Array
    measured: Array

    def at(self, k: slice | IntArray) -> Signals:
        """The same at some of the times."""
        return replace(self, u=self.u[k], measured=self.measured[k])

    def arrays(self) -> dict[str, Array]:
        """Arrays of a result, by flat key."""
        out = {f"control/{name}": self.u[:, k] for k, name in enumerate(self.names)}
        out["measured"] = self.measured
        return out
