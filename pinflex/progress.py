"""A progress bar on stderr, and only where a person sees it."""

from __future__ import annotations

import sys
import time

_WIDTH = 30  # [characters]
_PAUSE = 0.1  # [s] between drawings


class Progress:
    """Call it with (step, steps); `close` wipes the line."""

    def __init__(self, label: str, shown: bool | None = None) -> None:
        self.label, self.drawn = label, False
        self.shown = sys.stderr.isatty() if shown is None else shown
        self.began = self.last = time.monotonic()

    def __call__(self, step: int, steps: int) -> None:
        """Draw, at most ten times a second."""
        now = time.monotonic()
        if not self.shown or now - self.last < _PAUSE or steps < 1:
            return
        self.last, self.drawn = now, True
        part = min(max(step / steps, 0.0), 1.0)
        bar = ("#" * round(part * _WIDTH)).ljust(_WIDTH)
        left = f"{(now - self.began) * (1 - part) / part:4.0f} s left" if part > 0.01 else ""
        sys.stderr.write(f"\r{self.label:<12.12} [{bar}] {100 * part:3.0f} % {left}\x1b[K")
        sys.stderr.flush()

    def close(self) -> None:
        """Leave a clean line."""
        if self.drawn:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
