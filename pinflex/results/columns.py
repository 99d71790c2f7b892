"""A table of named columns, as numpy arrays in memory and as .csv or .parquet on the disk."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pinflex.doors import library
from pinflex.errors import DescriptionError, nearest
from pinflex.report import card, grid
from pinflex.text import brief
from pinflex.writing import replaced, write_csv

Column = npt.NDArray[Any]
SUFFIXES = (".csv", ".parquet")


@dataclass(frozen=True)
class Columns:
    """Rows of a table, column by column.

    Attributes:
        arrays: By name, read-only, all of one length: numbers (nan where there is none; flags are
            1 and 0) or texts ("" where there is none).
        units: Of the columns that have one.
    """

    __repr__ = brief

    arrays: Mapping[str, Column]
    units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Column:
        if name not in self.arrays:
            raise DescriptionError(f"table: {name}: no such column.{nearest(name, self.arrays)}")
        return self.arrays[name]

    def __len__(self) -> int:
        """Rows."""
        return len(next(iter(self.arrays.values()), ()))

    def __iter__(self) -> Iterator[str]:
        return iter(self.arrays)

    def __contains__(self, name: object) -> bool:
        return name in self.arrays

    def keys(self) -> list[str]:
        """Names of the columns; dict(table) is a plain dictionary of them."""
        return list(self.arrays)

    def to_pandas(self) -> Any:
        """The table as a pandas DataFrame, units in `attrs`."""
        frame = library("pandas", "to_pandas").DataFrame(dict(self.arrays))
        frame.attrs["units"] = dict(self.units)
        return frame

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.arrays)

    def _repr_html_(self) -> str:
        cells = [[_five_digits(x) for x in row] for row in zip(*self.arrays.values(), strict=True)]
        return card(f"table of {len(self)} rows", grid([*self._headed()], cells))

    def _headed(self) -> dict[str, np.ndarray]:
        """Columns by their names with units."""
        return {
            f"{name} [{self.units[name]}]" if self.units.get(name) else name: column
            for name, column in self.arrays.items()
        }

    def save(self, path: str | Path) -> Path:
        """Write .csv or .parquet; a file already there is replaced only by a complete one."""
        path = check_suffix(path)
        if path.suffix == ".csv":
            cells = map(_cells, self.arrays.values())
            return write_csv(path, self._headed(), zip(*cells, strict=True))
        with replaced(path) as part:
            _parquet(self._headed(), part)
        return path


def check_suffix(path: str | Path) -> Path:
    """The path, if a table can be written to it."""
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise DescriptionError(f"{path}: no such kind of table. Allowed: {', '.join(SUFFIXES)}.")
    if path.suffix == ".parquet":
        try:
            import pyarrow  # noqa: F401 - whether it is there, before a long run
        except ImportError:
            raise DescriptionError(
                f"{path}: .parquet needs pyarrow. Run pip install 'pinflex[sweep]', or write .csv."
            ) from None
    return path


def column(values: Sequence[Any]) -> Column:
    """Numbers and flags as numbers, all else as text; None where there is none."""
    if all(value is None or isinstance(value, (bool, int, float)) for value in values):
        array: Column = np.array([np.nan if value is None else value for value in values], float)
    else:
        array = np.array(["" if value is None else str(value) for value in values])
    array.setflags(write=False)
    return array


def _five_digits(value: Any) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _cells(values: Column) -> list[str]:
    write = repr if values.dtype.kind == "f" else str
    return ["" if value != value else write(value) for value in values.tolist()]


def _parquet(headings: Mapping[str, Column], path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    # nan becomes null, as csv leaves it empty
    data = {
        name: pyarrow.array(values.tolist(), from_pandas=True) for name, values in headings.items()
    }
    pyarrow.parquet.write_table(pyarrow.table(data), path)
