"""Figures hold the right curves, labels and peaks; nobody compares pixels.

Claims:
    Pages, pictures, figures
    - a peak between the bins of a spectrum, its frequency and height | a sine | 1e-3 of a bin; 2e-4
      | 7e-4; 8e-5
    - amplitudes, labelled peaks, followed modes of the figures | beside each | passes | also
      `unit/studies/test_pose_map.py`
"""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from pinflex.errors import DescriptionError
from pinflex.results.result import Result, peak
from pinflex.viewer import plot
from pinflex.viewer.plot import amplitudes, highest, maxima
from pinflex.viewer.plots import axes as figures
from pinflex.viewer.plots.drawing import panels, save
from tests.synthetic import BENDING, synthetic_result

matplotlib = pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def flexible() -> Result:
    return synthetic_result()


@pytest.fixture(scope="module")
def rigid() -> Result:
    return synthetic_result("rigid")


def labels(ax):
    return [line.get_label() for line in ax.lines if not line.get_label().startswith("_")]


def with_motors(run: Result, count: int) -> Result:
    torque = np.tile(run.torque, (1, 2))[:, :count]
    names = [f"m{i}" for i in range(count)]
    meta = {**run.meta, "actuated": names, "units": {"torque/m1": "N"}}
    return replace(run, arrays={**run.arrays, "torque": torque}, meta=meta)


def test_each_motor_has_its_torques_above_and_their_difference_below(rigid, flexible):
    figure = plot.torques(rigid, {"coupled": flexible})
    assert len(figure.axes) == 6
    above, below = figure.axes[1], figure.axes[4]
    assert above.get_title("left") == "motor_2"
    assert labels(above) == ["rigid", "coupled"]
    assert figure.axes[0].get_ylabel() == "torque [N m]"
    assert below.get_xlabel() == "time [s]"
    assert np.array_equal(above.lines[1].get_ydata(), flexible.torque[:, 1])
    assert np.array_equal(below.lines[0].get_ydata(), flexible.torque[:, 1] - rigid.torque[:, 1])
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["rigid", "coupled"]


@pytest.mark.parametrize("count", [1, 2, 4, 6])
def test_any_number_of_motors_fills_rows_of_three_without_empty_frames(rigid, flexible, count):
    figure = plot.torques(with_motors(rigid, count), {"c": with_motors(flexible, count)})
    assert len(figure.axes) == 2 * count
    assert figure.get_size_inches()[1] == pytest.approx(4.5 * (1 + (count > 3)))


def test_a_linear_motor_is_labelled_as_a_force(rigid, flexible):
    figure = plot.torques(with_motors(rigid, 2), {"c": with_motors(flexible, 2)})
    assert figure.axes[1].get_ylabel() == "force [N]"


def test_deviation_is_drawn_in_millimetres_and_milliradians(rigid, flexible):
    figure = plot.deviation(rigid, flexible)
    position, rotation = figure.axes
    away = flexible.deviation_from(rigid)
    assert position.get_ylabel() == "position [mm]"
    assert rotation.get_ylabel() == "rotation [mrad]"
    assert labels(position) == ["x", "y"]  # a planar mechanism leaves z out
    assert labels(rotation) == ["rz"]
    assert np.allclose(position.lines[1].get_ydata(), 1e3 * away.position[:, 0])
    assert np.allclose(rotation.lines[1].get_ydata(), 1e3 * away.rotation[:, 2])


def test_the_stress_map_shows_every_link_on_one_scale_in_megapascal(flexible):
    figure = plot.stress_map(flexible)
    *panels, bar = figure.axes
    assert bar.get_ylabel() == "von Mises stress [MPa]"
    assert [p.get_title("left").split(":")[0] for p in panels] == list(flexible.links)
    top = max(peak(flexible.link(name).von_mises) for name in flexible.links) / 1e6
    for panel, name in zip(panels, flexible.links, strict=True):
        image = panel.images[0]
        assert image.get_clim() == (0.0, pytest.approx(top))
        expected = flexible.link(name).von_mises.T / 1e6
        assert np.allclose(np.asarray(image.get_array()).ravel(), expected.ravel())
        when, where = np.unravel_index(np.argmax(expected.T), expected.T.shape)
        mark = panel.lines[0].get_xydata()[0]
        assert np.allclose(mark, [flexible.t[when], 1e3 * flexible.link(name).x[where]])


def test_a_rigid_result_has_no_stress_to_map(rigid):
    with pytest.raises(DescriptionError, match=r"no flexible links.*quasistatic"):
        plot.stress_map(rigid)


def test_a_sine_peaks_at_its_frequency_with_its_amplitude():
    t = np.linspace(0.0, 2.0, 2001)
    frequency, amplitude = amplitudes(t, 0.3 * np.sin(2 * np.pi * 37.3 * t) + 5 * t - 2)
    best = int(np.argmax(amplitude))
    assert frequency[best] == pytest.approx(37.3, abs=0.07)  # half a bin of 1 / (4 * 2 s)
    assert amplitude[best] == pytest.approx(0.3, rel=0.01)


@pytest.mark.parametrize("f", [10.03, 10.17, 10.23, 10.31])
def test_a_peak_between_the_bins_is_where_the_vibration_is(f):
    t = np.linspace(0.0, 2.0, 401)
    frequency, amplitude = amplitudes(t, 1.7 * np.sin(2 * np.pi * f * t + 0.3))
    at, height = max(highest(frequency, amplitude, 3), key=lambda peak: peak[1])
    # The logarithm of a Hann window's lobe is a parabola up to 1e-3 of a bin, which is 1 / 8 Hz.
    assert at == pytest.approx(f, abs=1.25e-4)
    assert height == pytest.approx(1.7, rel=2e-4)


def test_two_close_sines_are_both_labelled_and_side_lobes_are_not(flexible):
    t = np.linspace(0.0, 2.0, 2001)
    q = np.sin(2 * np.pi * 30.2 * t) + 0.2 * np.sin(2 * np.pi * 41.7 * t)
    run = Result(t, {"joint/q": q[:, None]}, {"joints": ["a"], "level": "ked"})
    ax = plot.spectrum(run, "joint/a").axes[0]
    found = [float(text.get_text().removesuffix(" Hz")) for text in ax.texts]
    assert found == pytest.approx([30.2, 41.7], abs=0.05)  # labels carry one decimal


def test_the_spectrum_of_the_free_vibration_finds_the_bending_frequency(rigid, flexible):
    figure = plot.spectrum(flexible, "torque/motor_1", reference=rigid, after=0.1)
    ax = figure.axes[0]
    assert [float(t.get_text().removesuffix(" Hz")) for t in ax.texts] == pytest.approx(
        [BENDING], abs=1.0
    )  # a window of 0.1 s resolves 10 Hz; the parabola places the peak to a tenth of that
    assert ax.get_xlabel() == "frequency [Hz]"
    assert ax.get_ylabel() == "amplitude [N m]"
    assert ax.get_title("left") == "torque motor_1 minus rigid, coupled, after 0.1 s"


def test_each_quantity_is_found_by_its_name(flexible):
    values, label, unit = plot.signal(flexible, "link/distal_2/v")
    assert (label, unit) == ("distal_2: deflection v at x = 110 mm", "m")
    assert np.array_equal(values, flexible.link("distal_2").deflection[:, 10, 1])
    values, label, unit = plot.signal(flexible, "frame/platform/y")
    assert np.array_equal(values, flexible.frame("platform").position[:, 1])
    assert plot.signal(flexible, "joint/elbow_1")[1:] == ("position elbow_1", "rad")


@pytest.mark.parametrize("quantity", ["torqe/motor_1", "link/distal_1/q", "frame/platform", ""])
def test_an_unknown_quantity_is_answered_with_the_forms(flexible, quantity):
    with pytest.raises(DescriptionError, match=r"torque/MOTOR|no frame|no flexible link"):
        plot.signal(flexible, quantity)


def test_too_few_instants_make_no_spectrum(flexible):
    with pytest.raises(DescriptionError, match="too few"):
        plot.spectrum(flexible, "torque/motor_1", after=0.199)


def test_a_quantity_that_never_moves_has_an_empty_spectrum(flexible, tmp_path):
    figure = plot.spectrum(flexible, "link/distal_1/w")
    assert not figure.axes[0].texts
    figure.savefig(tmp_path / "flat.png")


def test_a_comparison_has_every_figure_the_results_allow(rigid, flexible, tmp_path):
    drawn = figures.figures_of(rigid, {"coupled": flexible})
    parts = ("deviation", "stress", "spectrum")
    assert [*drawn] == ["torques", *(f"{part}_coupled" for part in parts)]
    for name, figure in drawn.items():
        path = save(figure().axes, tmp_path / "plots" / f"{name}.png")
        assert path.read_bytes()[:4] == b"\x89PNG"


def test_plotting_leaves_no_global_state_and_importing_it_is_light():
    code = (
        "import sys, pinflex.viewer.plot as p; assert 'matplotlib' not in sys.modules\n"
        "from tests.synthetic import synthetic_result as s\n"
        "p.torques(s('rigid'), {'c': s()}); assert 'matplotlib.pyplot' not in sys.modules\n"
        "p.spectrum(s(), 'torque/motor_1'); assert 'scipy.signal' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_every_text_of_a_figure_fits_and_none_needs_a_layout_engine(rigid, flexible):
    runs = {"quasistatic": flexible, "coupled": flexible}
    figures = [
        plot.torques(with_motors(rigid, 6), {"coupled": with_motors(flexible, 6)}),
        plot.deviation(rigid, flexible, still=flexible),
        plot.stress_map(flexible),
        plot.spectrum(flexible, "link/distal_1/v", natural=(60.0, 61.0)),
        plot.torques(rigid, runs),
    ]
    for figure in figures:
        assert figure.get_layout_engine() is None  # which would draw everything twice
        drawn = figure.get_tightbbox()
        assert drawn.x0 > 0
        assert drawn.y0 > 0
        assert drawn.x1 < figure.get_size_inches()[0]
        assert drawn.y1 < figure.get_size_inches()[1]


def test_without_vibration_a_run_is_drawn_by_dashes_beside_it(rigid, flexible):
    figure = plot.deviation(rigid, flexible, still=flexible)
    whole, dashed = figure.axes[0].lines[1:3]
    assert np.array_equal(whole.get_ydata(), dashed.get_ydata())
    assert dashed.is_dashed()
    assert figure.axes[0].get_title("left").endswith("; dashed: coupled")


@pytest.mark.parametrize("prominence", [0.0, 0.3, 1.5])
def test_maxima_are_those_of_scipy(prominence):
    from scipy.signal import find_peaks

    rng = np.random.default_rng(0)
    for height in (rng.standard_normal(300), np.round(rng.standard_normal(300)), np.zeros(5)):
        expected = find_peaks(height, prominence=prominence or None, height=0.2)[0]
        assert maxima(height, prominence, 0.2) == expected.tolist()


def test_peaks_are_labelled_with_the_modes_they_may_be(flexible):
    axes = plot.spectrum(flexible, "link/distal_1/v", natural=(60.0, 61.0, 61.5, 300.0)).axes[0]
    labels = [text.get_text() for text in axes.texts]
    assert any(label.endswith("Hz\nmodes 1-3") for label in labels)
    assert not any("4" in label.partition("\n")[2] for label in labels)


@pytest.mark.parametrize("size", [1.3e-5, 3e-4, 7.5e-4, 0.012, 4300.0, 15000.0, 2e5, 1.3e7])
def test_the_name_of_an_axis_is_beside_its_numbers(size: float) -> None:
    figure, axes = panels(2, 2)
    ax = axes[0, 0]
    ax.plot([0.0, 0.5, 1.0], [-size, size / 3, size])
    ax.set_ylabel("difference [N m]")
    agg = pytest.importorskip("matplotlib.backends.backend_agg")
    agg.FigureCanvasAgg(figure).draw()
    numbers = [x for x in ax.get_yticklabels() if x.get_text()]
    right = ax.yaxis.label.get_window_extent().x1
    assert right < min(x.get_window_extent().x0 for x in numbers)
