"""One convention of `.plot()`: axes returned, `ax` taken for one panel, several panels named.

Claims:
    Pages, pictures, figures
    - one convention of `.plot()`: axes returned, `ax=` for one panel, `panel=` names it; bars of
      modes, a half wave drawn | frequencies and shares; half sine | 1e-9; 0.02 | passes
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pinflex as pf
from pinflex.errors import DescriptionError

THICK, MODULUS = "flexible.beam.section.thickness", "flexible.beam.material.E"
MOVE = pf.quintic(platform={"x": 0.01, "y": 0.0, "rz": 0.0}, duration=0.3)
GEARED = Path(pf.__file__).parents[1] / "models/ur5/geared.yaml"


class Made:
    """What has a `.plot()`, each made once."""

    def __init__(self) -> None:
        self.beam = pf.load("cantilever", ["gravity=[0, 0, 0]", "damping={modal: 0.01}"])
        self.planar = pf.load("3rrr")
        self._kept: dict[str, Any] = {}

    def __call__(self, name: str) -> Any:
        if name not in self._kept:
            self._kept[name] = getattr(self, f"_{name}")()
        return self._kept[name]

    def _modes(self) -> Any:
        return pf.modes(self.planar, count=4)

    def _motion(self) -> Any:
        return MOVE

    def _away(self) -> Any:
        options: dict[str, Any] = {"until": 0.02, "samples": 21}
        run = pf.solve(self.planar, level="quasistatic", **options)
        return run.deviation_from(pf.solve(self.planar, level="rigid", **options), "platform")

    def _command(self) -> Any:
        return pf.command(self.planar, MOVE, level="quasistatic")

    def _frf(self) -> Any:
        return pf.frequency_response(self.planar)

    def _line(self) -> Any:
        return pf.pose_map(self.planar, {"x": [-0.01, 0.0, 0.01]}, count=2)

    def _map(self) -> Any:
        return pf.pose_map(self.planar, {"x": [-0.01, 0.01], "y": [-0.01, 0.01]}, count=2)

    def _sensitivities(self) -> Any:
        return pf.sensitivities(self.beam, [THICK, MODULUS], ["frequency.1", "mass"])

    def _design(self) -> Any:
        return pf.design(self.beam, "mass", {THICK: (1e-3, 8e-2)}, ["frequency.1 > base"], starts=1)

    def _fit(self) -> Any:
        f = pf.modes(self.beam, count=3).frequencies
        return pf.fit(self.beam, {"frequency": 1.05 * f, "std": 0.01 * f}, [MODULUS])

    def _scatter(self) -> Any:
        normal = {THICK: "2%", MODULUS: "4%"}
        return pf.scatter(self.beam, 16, normal=normal, outputs=["frequency"])


@pytest.fixture(scope="module")
def made() -> Made:
    return Made()


# what is drawn: its panels in a figure, one of them, and what that shows
SEVERAL = {
    "motion": (3, "velocity", lambda a: a.get_ylabel() == "velocity [rad/s | m/s]"),
    "away": (2, "position", lambda a: a.get_ylabel().startswith("position [")),
    "command": (2, "torque", lambda a: a.get_ylabel() == "torque [N m]"),
    "frf": (4, "phase motor_1", lambda a: a.get_ylabel() == "phase [deg]"),
    "line": (2, "frequencies", lambda a: len(a.lines) >= 2),
    "sensitivities": (2, "mass", lambda a: len(a.patches) == 2),
    "design": (2, "change", lambda a: len(a.patches) == 1),
    "fit": (2, "natural frequencies", lambda a: a.get_ylabel() == "Hz"),
    "scatter": (8, "variance frequency.1", lambda a: len(a.patches) == 2),
}


@pytest.mark.parametrize("name", SEVERAL)
def test_several_panels_are_an_array_and_one_goes_on_given_axes(
    name: str, made: Made, plt: Any
) -> None:
    count, panel, shows = SEVERAL[name]
    found = made(name)
    axes = found.plot()
    assert isinstance(axes, np.ndarray) and axes.shape == (count,)
    assert plt.gcf() is axes[0].figure  # a notebook shows it
    alone = found.plot(panel=panel)
    assert plt.gcf() is alone.figure and shows(alone)
    figure, mine = plt.subplots()
    opened = plt.get_fignums()
    assert found.plot(panel=panel, ax=mine) is mine and shows(mine)
    assert plt.get_fignums() == opened and mine.figure is figure
    with pytest.raises(DescriptionError, match="several panels, and `ax` holds one. Name one"):
        found.plot(ax=mine)
    with pytest.raises(DescriptionError, match="no such panel"):
        found.plot(panel="wrong")


def test_a_map_names_its_panels_and_its_colours_stand_beside_them(made: Made, plt: Any) -> None:
    found = made("map")
    assert len(found.plot()) == 2 * 5  # two modes, three stiffnesses, each with its scale
    _, mine = plt.subplots()
    assert found.plot("mode 1 [Hz]", ax=mine) is mine and mine.get_xlabel() == "x from home [m]"


@pytest.mark.parametrize("name", ["sensitivities", "design", "fit", "scatter"])
def test_a_path_writes_the_figure_without_a_window(
    name: str, made: Made, plt: Any, tmp_path: Any
) -> None:
    axes = made(name).plot(tmp_path / "a.png")
    assert len(axes) == SEVERAL[name][0] and not plt.get_fignums()
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(DescriptionError, match=r"\.svg"):
        made(name).plot(tmp_path / "a.gif")


def test_bars_of_modes_are_their_frequencies_split_by_energy(made: Made, plt: Any) -> None:
    found = made("modes")
    ax = found.plot()
    ends: dict[float, float] = {}
    for bar in ax.patches:
        ends[bar.get_y()] = max(ends.get(bar.get_y(), 0.0), bar.get_x() + bar.get_width())
    # widths add up from left to right: round-off of a few of them
    assert [*ends.values()] == pytest.approx(found.frequencies, rel=1e-12)
    first = [bar.get_width() for bar in ax.patches if bar.get_y() == min(ends)]
    share = found.share[0] / found.share[0].sum()
    f = found.frequencies[0]
    seen = sorted(w for w in first if w > 0.01 * f)  # below a per cent they are not named
    assert seen == pytest.approx(sorted(share[share > 0.01] * f), rel=1e-9)
    _, mine = plt.subplots()
    assert found.plot(ax=mine) is mine


def test_the_shape_of_a_mode_is_a_half_wave_of_its_link(made: Made, plt: Any) -> None:
    found = made("modes")
    # three pinned links at one frequency: each shape mixes them; frequencies 1 to 3 are equal
    ax = found.plot(1)
    blue = [line for line in ax.lines if line.get_color() == "#0072B2"]
    assert len(blue) == 2 * 3  # each link at both ends of the swing
    bulge = 0.0
    for line in blue:
        x, y = np.array(line.get_data())
        chord = np.array([x[-1] - x[0], y[-1] - y[0]])
        off = ((x - x[0]) * chord[1] - (y - y[0]) * chord[0]) / np.linalg.norm(chord) ** 2
        half = np.sin(np.pi * np.linspace(0, 1, len(x)))
        if np.abs(off).max() > bulge:
            bulge = float(np.abs(off).max())
            # pinned at both ends: a half sine, drawn over straight pieces of equal length
            assert np.abs(np.abs(off) / bulge - half).max() < 0.02
    assert bulge > 0.05  # large enough to be seen
    _, mine = plt.subplots()
    assert found.plot(2, ax=mine) is mine
    with pytest.raises(DescriptionError, match="mode 5. Allowed: 1 to 4"):
        found.plot(5)


def test_modes_about_a_motion_have_bars_and_no_shape(plt: Any) -> None:
    found = pf.modes(pf.load("3rrr"), at=0.0, count=2)
    assert len(found.plot().patches) >= 2
    with pytest.raises(DescriptionError, match="modes about a motion turn"):
        found.plot(1)


def test_figures_of_a_comparison_take_axes_where_they_have_one_panel(plt: Any) -> None:
    short = pf.load("3rrr", ["solve={until: 0.02, samples: 21, dt: 1e-3}"])
    done = pf.compare(short, levels=["ked"])
    _, mine = plt.subplots()
    assert done.plot("spectrum", ax=mine) is mine
    with pytest.raises(DescriptionError, match="several panels"):
        done.plot("torques", ax=mine)


def test_a_drive_goes_on_given_axes(plt: Any) -> None:
    run = pf.solve(pf.load(str(GEARED)), level="rigid", until=0.1, samples=11)
    _, mine = plt.subplots()
    view = run.drive(run.drives[0])
    assert view.plot(ax=mine) is mine and mine.get_xlabel() == "motor speed [rad/s]"


def test_every_public_plot_takes_ax() -> None:
    import inspect

    public = (getattr(pf, name) for name in pf.__all__)
    found = [one for one in public if isinstance(one, type) and hasattr(one, "plot")]
    assert len(found) >= 9
    for one in found:
        assert "ax" in inspect.signature(one.plot).parameters, one
