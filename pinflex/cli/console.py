"""Console of the commands: loading a model, files written, JSON."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import IO, TYPE_CHECKING, Any

from pinflex.errors import DescriptionError
from pinflex.progress import Bar
from pinflex.writing import plain, writable

if TYPE_CHECKING:
    from pinflex.mechanics.mechanism import Mechanism
    from pinflex.variation.design import Design
    from pinflex.variation.fit import Fit


def written(found: Design | Fit, args: argparse.Namespace) -> list[str]:
    """Write the figure and the YAML that --plot and --output ask for; their paths."""
    files = []
    if args.plot is not None:
        found.plot(args.plot)
        files.append(str(args.plot))
    if args.output is not None:
        files.append(str(found.write(args.output)))
    return files


def say_written(files: Sequence[object], how: str = "-o FILE saves it") -> None:
    """Print the files written, or which option writes one."""
    print("\n".join(f"wrote {path}" for path in files) or f"nothing saved ({how})")


def check_files(figure: str | None, *others: str | None) -> None:
    """Refuse before the work what could not be written after it."""
    if figure:
        from pinflex.viewer.plots.drawing import check_figure

        check_figure(figure)
    for path in (*others, figure):
        writable(path)


@contextmanager
def working(text: str) -> Iterator[None]:
    """Status line on a terminal while something is being done."""
    with Bar(text) as bar:
        bar.say()
        yield


def load_model(args: argparse.Namespace) -> Mechanism:
    """Load the model; what the C++ parser of URDFs prints by itself becomes part of the error."""
    from pinflex.mechanics.mechanism import load

    with working(f"loading {args.model}"), _parser_noise(args.debug) as noise:
        try:
            return load(args.model, args.set)
        except DescriptionError as error:
            noise.seek(0)
            lines = [line.strip() for line in noise.read().decode(errors="replace").splitlines()]
            cause = next((line[6:].strip() for line in lines if line.startswith("Error:")), "")
            if not cause:
                raise
            raise DescriptionError(f"{error} The parser says: {cause}.", **error.data) from error


@contextmanager
def _parser_noise(kept: bool) -> Iterator[IO[bytes]]:
    """A file that takes what anything below Python writes to stderr meanwhile."""
    with tempfile.TemporaryFile() as noise:
        if kept:
            yield noise
            return
        sys.stderr.flush()
        try:
            old = os.dup(2)
        except OSError:  # started without a stderr
            yield noise
            return
        os.dup2(noise.fileno(), 2)
        try:
            yield noise
        finally:
            os.dup2(old, 2)
            os.close(old)


def print_json(data: Mapping[str, Any]) -> None:
    """One JSON object on stdout."""
    print(json.dumps(plain(data), indent=2, allow_nan=False))


def answer(
    args: argparse.Namespace,
    data: Mapping[str, Any],
    text: str,
    files: Sequence[object] | None = None,
    how: str = "-o FILE saves it",
) -> int:
    """Print the answer of a command, for people or as JSON, and the files that it has written.

    `text` ends its lines itself. `how` says which option writes a file where none was.
    """
    if args.json:
        print_json({**data, **({} if files is None else {"files": files})})
        return 0
    print(text, end="")
    if files is not None:
        say_written(files, how)
    return 0
