"""Progress of long work: a bar on stderr, or tqdm's where that is installed (also in notebooks)."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import wraps
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
B = TypeVar("B", bound="Bar")
_WIDTH = 30  # [characters]
_PAUSE = 0.1  # [s] between drawings
Callback = Callable[[int, int], None]  # called with (step, steps)
Progress = Callback | bool | None  # True: a bar; None or False: nothing


class Bar:
    """A bar on stderr, only where a person sees it: call it with (step, steps) inside `with`."""

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

    def say(self) -> None:
        """Show the label alone, at once, for work that counts no steps."""
        if self.shown:
            self.drawn = True
            sys.stderr.write(f"\r{self.label} ...\x1b[K")
            sys.stderr.flush()

    def close(self) -> None:
        """Leave a clean line."""
        if self.drawn:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

    def __enter__(self: B) -> B:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class _Tqdm:
    """tqdm's bar behind the same two calls."""

    def __init__(self, label: str, bar: Any) -> None:
        self.bar = bar(desc=label, leave=False, total=None)

    def __call__(self, step: int, steps: int) -> None:
        """Move on to a step."""
        self.bar.total = steps
        self.bar.update(step - self.bar.n)

    def say(self) -> None:
        """Show the label alone."""
        self.bar.refresh()

    def close(self) -> None:
        """Leave a clean line."""
        self.bar.close()


class Stages:
    """Bars one after the other: call it with what comes next, then `close` it."""

    def __init__(self, make: Callable[[str], Bar | _Tqdm] | None = None) -> None:
        """No bar yet."""
        self.make = make or _bar
        self.bar: Bar | _Tqdm | None = None

    def __call__(self, text: str) -> Callback:
        """Close the last bar and show the next; returns what its steps are told to."""
        self.close()
        bar = self.bar = self.make(text)
        bar.say()
        return bar

    def close(self) -> None:
        """Leave a clean line."""
        if self.bar is not None:
            self.bar.close()
        self.bar = None


@contextmanager
def shown(progress: Progress, label: str) -> Iterator[Callback | None]:
    """What long work calls with (step, steps); a bar is closed at the end."""
    if not isinstance(progress, bool) or not progress:
        yield None if isinstance(progress, bool) else progress
        return
    with closing(_bar(label)) as bar:
        yield bar


def barred(function: Callable[P, R]) -> Callable[P, R]:
    """A function whose progress=True is a bar with its name, closed at its end."""

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        given = kwargs.get("progress")
        if not isinstance(given, bool):
            return function(*args, **kwargs)
        with shown(given, function.__name__) as tell:
            kwargs["progress"] = tell
            return function(*args, **kwargs)

    return called


def callback(progress: Progress) -> Callback | None:
    """The function that is told the steps, of what a `barred` function is given."""
    return None if isinstance(progress, bool) else progress


def _bar(label: str) -> Bar | _Tqdm:
    try:
        with warnings.catch_warnings():  # of widgets that a plain terminal does not have
            warnings.simplefilter("ignore")
            return _Tqdm(label, import_module("tqdm.auto").tqdm)
    except ImportError:
        return Bar(label, shown=True)
