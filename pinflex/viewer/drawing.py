"""The one convention of `.plot()`: axes are returned, `ax` is taken, several panels have names.

A figure of one panel gives its axes, of several an array of them, colour scales last or beside
their panel. `panel` draws one of several alone, which then also goes on axes of the caller's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinflex.errors import DescriptionError, nearest
from pinflex.viewer.panels import HEIGHT, axes_of, panels, shown_axes, styled, title
from pinflex.writing import replaced

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ALONE = 0.75  # of the usual height, for one panel of several
_LISTED = 8  # names in an error


@dataclass(frozen=True)
class Drawing:
    """A figure, and its panels one by one.

    Attributes:
        whole: Makes the figure; None: its one panel alone is the figure.
        panels: By name, draws one panel on axes; its further axes (a scale) it adds itself.
        height: Of one panel alone [in].
    """

    whole: Callable[[], Figure] | None
    panels: Mapping[str, Callable[[Axes], object]]
    height: float = _ALONE * HEIGHT

    def axes(
        self, panel: str | None = None, ax: Axes | None = None, path: str | Path | None = None
    ) -> Any:
        """Draw, and return the axes: one, or an array of several.

        Raises:
            DescriptionError: `ax` for several panels, or no such panel.
        """
        if panel is None and ax is not None:
            panel = self._only()
        if panel is not None and panel not in self.panels:
            raise DescriptionError(f"plot: panel {panel!r}: no such panel.{self._names(panel)}")
        if ax is None:
            whole = self.whole if panel is None else None
            make = whole or self._alone(panel or self._only())
            drawn = shown_axes(make) if path is None else axes_of(make())
        else:
            self.panels[str(panel)](styled(ax))
            title(ax, "")  # a heading is of figures of our own, as in `axes.draw`
            drawn = ax
        if path is not None:
            save(drawn, path)
        return drawn

    def _alone(self, panel: str) -> Callable[[], Figure]:
        def make() -> Figure:
            figure, axes = panels(1, 1, self.height, None)
            self.panels[panel](axes[0, 0])
            return figure

        return make

    def _only(self) -> str:
        """The panel that `ax` is for."""
        if len(self.panels) == 1:
            return next(iter(self.panels))
        how = f"Name one: panel=...{self._names('')}" if self.panels else "Leave ax out."
        raise DescriptionError(f"plot: this figure has several panels, and `ax` holds one. {how}")

    def _names(self, panel: str) -> str:
        return nearest(panel, self.panels, _LISTED)


def save(axes: Any, path: str | Path) -> Path:
    """Write the figure that axes stand in; returns the file."""
    path = check_figure(path)
    figure = np.atleast_1d(axes).flat[0].get_figure(root=True)
    with replaced(path) as part:
        figure.savefig(part)
    return path


def check_figure(path: str | Path) -> Path:
    """The path of a figure, if there is such a kind; its folder is made."""
    path = Path(path)
    if path.suffix not in (".png", ".pdf", ".svg"):
        raise DescriptionError(f"{path}: no such kind of figure. Allowed: .png, .pdf, .svg.")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
