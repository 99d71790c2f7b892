"""Natural frequencies and platform stiffness of many poses, as a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from itertools import combinations_with_replacement
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from pinflex.arrays import Array
from pinflex.doors import door, library
from pinflex.errors import DescriptionError, nearest
from pinflex.report import card, grid
from pinflex.text import frozen
from pinflex.writing import replaced, write_csv

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# A table of named columns, as numpy arrays in memory and as .csv or .parquet on the disk.

Column = npt.NDArray[Any]
SUFFIXES = (".csv", ".parquet")


@frozen
class Columns:
    """Rows of a table, column by column.

    Attributes:
        arrays: By name, read-only, all of one length: numbers (nan where there is none; flags are
            1 and 0) or texts ("" where there is none).
        units: Of the columns that have one.
    """

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
    """Numbers and flags as numbers, all else as text; None becomes nan or ""."""
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


AXES = ("x", "y", "z", "rx", "ry", "rz")
HELD, FREE = "others held", "others free"  # the two stiffnesses along an axis: K_xx and 1/C_xx
_ROUND_OFF = 1e-10  # of the largest compliance, rows scaled to one size
_ACROSS = 1e-3  # share of an axis in rigid directions, above which it cannot move along it alone


@frozen
class PoseMap:
    """Frequencies and compliance at the poses of a grid, or of a motion; G: shape of the grid.

    Attributes:
        name: Of the mechanism.
        grid: Displacements from home by coordinate, each of shape (n,); of a motion the instants
            "t". units: m, rad or s, of each.
        frequencies: Hz, shape (*G, count), negative where unstable; a column follows one mode, so
            columns may cross.
        agreement: Least squared cosine of these modes to those of the neighbouring pose that they
            follow, shape G: near 1 the columns are certain.
        compliance: Of the platform, motors locked, shape (*G, 6, 6), see `platform_compliance`; nan
            where something is free to move, where the model names no platform, or where frequencies
            alone were wanted.
        errors: Why a pose has no numbers, "" where it has, shape G.
        preload: "gravity" or "none". free_motors: Whether frequencies are those with free motors.
        side: Sign that changes at poses in which the motors do not hold the mechanism, shape G.
    """

    name: str
    grid: Mapping[str, Array]
    units: Mapping[str, str]
    frequencies: Array
    agreement: Array
    compliance: Array
    errors: Any
    preload: str
    free_motors: bool
    side: Any = np.nan

    @property
    def passed(self) -> tuple[str, ...]:
        """Neighbours in the grid between which a singular pose lies: the motors let go there."""
        found: list[str] = []
        for k, (name, values) in enumerate(self.grid.items() if np.ndim(self.side) else ()):
            sides = np.moveaxis(self.side, k, 0)
            flips = (sides[1:] * sides[:-1] < 0.0).reshape(len(values) - 1, -1).any(axis=1)
            found += [
                f"{name} = {values[i]:.4g} and {values[i + 1]:.4g}" for i in np.flatnonzero(flips)
            ]
        return tuple(found)

    @property
    def table(self) -> Columns:
        """A row for each pose: grid, status, error, frequencies, stiffness and compliance.

        "K_AB (others held)" is the force (N) or moment (N m) along A per displacement (m, rad)
        along B, the other displacements zero; "1/C_AA (others free)" the force per displacement
        along its own axis, nothing else held. inf where the platform is rigid.
        """
        arrays, units = of_poses(self.grid, self.errors), dict(self.units)
        for k, row in enumerate(self.frequencies.reshape(self.errors.size, -1).T, 1):
            arrays[f"frequency.{k}"], units[f"frequency.{k}"] = column(row.tolist()), "Hz"
        arrays["agreement"] = column(self.agreement.reshape(-1).tolist())
        C = self.compliance.reshape(-1, 6, 6)
        K = [stiffness_of(c)[0] if np.isfinite(c).all() else c for c in C]
        for i, values in enumerate(free_stiffness(C).T):
            arrays[free(i)], units[free(i)] = column(values.tolist()), _unit("stiffness", i, i)
        for what, values in (("stiffness", np.array(K)), ("compliance", C)):
            for i, j in combinations_with_replacement(range(6), 2):
                name = held(i, j) if what == "stiffness" else f"compliance.{AXES[i]}.{AXES[j]}"
                arrays[name], units[name] = column(values[:, i, j].tolist()), _unit(what, i, j)
        return Columns(arrays, units)

    def plot(self, panel: str | None = None, ax: Axes | None = None) -> Any:
        """Draw frequencies and stiffness over the poses; returns the matplotlib axes.

        Args:
            panel: One alone: "frequencies" or "stiffness"; over two coordinates "mode 1 [Hz]" ...
            ax: Where to draw that; default: axes of a new figure.
        """
        return door("viewer.plots.maps", "axes_of_map")(self, panel, ax)

    def _repr_html_(self) -> str:
        return self.table._repr_html_()

    @property
    def along_motion(self) -> bool:
        """Whether the poses are those of a motion."""
        return self.units == {"t": "s"}

    @property
    def rigid(self) -> tuple[str, ...]:
        """Axes along which the platform does not give way at any pose, as x or rz."""
        every = np.diagonal(self.compliance, axis1=-2, axis2=-1).reshape(-1, 6)
        every = every[np.isfinite(every).all(axis=1)]
        return tuple(a for a, C in zip(AXES, every.T, strict=True) if len(C) and not C.any())


def of_poses(grid: Mapping[str, Array], errors: Any) -> dict[str, Column]:
    """First columns of a table of poses: the place in the grid, status and error."""
    places = np.meshgrid(*grid.values(), indexing="ij")
    every = errors.reshape(-1)
    return {n: column(p.reshape(-1).tolist()) for n, p in zip(grid, places, strict=True)} | {
        "status": column(["failed" if error else "done" for error in every]),
        "error": column(list(every)),
    }


def held(i: int, j: int) -> str:
    """Name of an entry of K: the force along i for a displacement along j, the others held."""
    return f"K_{AXES[i]}{AXES[j]} ({HELD})"


def free(i: int) -> str:
    """Name of the stiffness along an axis while the platform is free in the others."""
    return f"1/C_{AXES[i]}{AXES[i]} ({FREE})"


def free_stiffness(compliance: Array) -> Array:
    """1/C_ii (others free), shape (..., 6), N/m | N m/rad, of (..., 6, 6); inf where rigid."""
    C = np.diagonal(np.asarray(compliance, float), axis1=-2, axis2=-1)
    return np.asarray(np.divide(1.0, C, out=np.full(C.shape, np.inf), where=C != 0))


def stiffness_of(compliance: Array) -> tuple[Array, int]:
    """Stiffness of a compliance, others held, and in how many directions the platform gives way.

    K_xx (others held) is the force for a displacement along x while the others are zero; 1/C_xx
    (others free) is that while the platform is free to give way in the others. Where it gives way
    in fewer than six directions (a plane mechanism whose links bend in the plane), force =
    K displacement holds for the displacements that there are; the diagonal of an axis along which
    it cannot move alone is inf (rigid), and its other entries are zero.

    Returns:
        K (N/m, N, N m/rad), shape (6, 6); and the number of directions.
    """
    C = np.asarray(compliance, float)
    # rows of one size: bending is 1e6 times softer than stretch
    size = np.sqrt(np.maximum(np.diag(C), 0.0))
    size = np.where(size > 0, size, 1.0)
    values, V = np.linalg.eigh(C / np.outer(size, size))
    gives = values > _ROUND_OFF * max(float(values[-1]), 0.0)
    K = (V[:, gives] / values[gives]) @ V[:, gives].T / np.outer(size, size)
    rigid = np.linalg.norm(V[:, ~gives], axis=1) > _ACROSS
    K[rigid], K[:, rigid] = 0.0, 0.0
    K[rigid, rigid] = np.inf
    return K, int(np.sum(gives))


def _unit(what: str, i: int, j: int) -> str:
    if what == "stiffness":
        return ("N/m", "N", "N m/rad")[(i > 2) + (j > 2)]
    return ("m/N", "1/N", "rad/(N m)")[(i > 2) + (j > 2)]
