"""Workspaces that no run uses now: most of what a short run costs is to make new ones."""

from __future__ import annotations

from typing import Any

_KEPT = 4  # of one kind: runs at the same time are few
_LARGEST = 1.6e7  # bytes: beside a run that fills a larger one, to make it costs nothing


class Spares:
    """Spare workspaces of one system, by kind; they travel to no other process."""

    def __init__(self) -> None:
        self._by_kind: dict[object, list[Any]] = {}

    def __reduce__(self) -> tuple[type[Spares], tuple[()]]:
        return Spares, ()

    def acquire(self, kind: object) -> Any:
        """A spare workspace, its caller's own from now on; None: there is none."""
        try:
            return self._by_kind[kind].pop()
        except (KeyError, IndexError):
            return None

    def release(self, kind: object, workspace: Any, size: float) -> None:
        """Keep a workspace that its owner no longer uses."""
        spare = self._by_kind.setdefault(kind, [])
        if size <= _LARGEST and len(spare) < _KEPT:
            spare.append(workspace)
