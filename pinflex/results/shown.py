"""How a result is shown: figures, tables of other libraries, the card of a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from pinflex.cards import card, pairs
from pinflex.doors import door
from pinflex.results import report, tables

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pinflex.results.result import Result


class Shown:
    """What a Result offers to look at it."""

    def to_pandas(self) -> Any:
        """The table of `to_csv` as a pandas DataFrame: index t [s], units in `attrs`."""
        return tables.run_frame(cast("Result", self))

    def to_xarray(self) -> Any:
        """Every array as an xarray Dataset: time, names and places as coordinates, units.

        Keys have dots: ds["frame.platform.position"] has the dimensions (t, xyz).
        """
        return tables.run_dataset(cast("Result", self))

    def plot(self, quantity: str | None = None, ax: Axes | None = None) -> Any:
        """Draw a quantity over time; returns the matplotlib axes.

        run.plot("torque"); run.plot("frame/platform"); run.plot("stress")
        """
        return door("viewer.axes", "plot_run")(self, quantity, ax)

    def plot_spectrum(self, quantity: str, ax: Axes | None = None, **options: Any) -> Any:
        """Draw an amplitude spectrum; returns the matplotlib axes."""
        return door("viewer.axes", "plot_spectrum")(self, quantity, ax, **options)

    def _repr_html_(self) -> str:
        run = cast("Result", self)
        heading, *lines = report.summary(run).splitlines()
        cells = [(line[2:20].strip(), line[20:]) for line in lines]
        names = [("torque", ", ".join(run.motors)), ("frames", ", ".join(run.frames))]
        names.append(("links", ", ".join(run.links)))
        return card(heading, pairs([*cells, *names]))
