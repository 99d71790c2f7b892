"""Amplitude spectrum of a record, its peaks, and the natural frequencies that they may be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinflex.arrays import Array
from pinflex.errors import DescriptionError

_PADDING = 4  # spectra are computed on a grid this many times finer than 1 / duration


def amplitudes(t: Array, values: Array, after: float = 0.0) -> tuple[Array, Array]:
    """One-sided amplitude spectrum (Hann window, trend removed, padded to four times).

    Returns:
        Frequencies [Hz] and amplitudes in the unit of values: a sine of height a peaks at a.
    """
    keep = t >= after
    if np.count_nonzero(keep) < 16:
        raise DescriptionError(
            f"spectrum: {np.count_nonzero(keep)} instants after {after:g} s are too few (16). "
            f"Choose an earlier start than {after:g} s, or solve with more samples."
        )
    grid = np.linspace(t[keep][0], t[-1], np.count_nonzero(keep))  # equal steps, as the FFT needs
    window = np.hanning(len(grid))
    even = np.interp(grid, t, values)
    series = window * (even - np.polynomial.Polynomial.fit(grid, even, 1)(grid))
    count = _PADDING * len(grid)
    amplitude = 2 * np.abs(np.fft.rfft(series, count)) / window.sum()
    return np.fft.rfftfreq(count, grid[1] - grid[0]), np.asarray(amplitude)


def highest(frequency: Array, amplitude: Array, count: int) -> list[tuple[float, float]]:
    """The highest peaks (Hz, amplitude), placed between bins by a parabola through three."""
    if not amplitude.max() > 0:
        return []
    level = np.log(np.maximum(amplitude, 1e-12 * amplitude.max()))
    bins = maxima(level, np.log(2), level.max() - np.log(100))
    kept: list[int] = []
    for i in sorted(bins, key=lambda i: -amplitude[i]):
        # lobes of a higher peak fall like 1 / (pi d (d^2 - 1)) at d unpadded bins (Hann)
        away = [max(abs(i - k) / _PADDING, 1.5) for k in kept]
        lobes = [amplitude[k] / (np.pi * d * (d**2 - 1)) for k, d in zip(kept, away, strict=True)]
        if amplitude[i] > 2 * max(lobes, default=0.0):
            kept.append(int(i))
    found = []
    for i in kept[:count]:
        left, top, right = level[i - 1 : i + 2]
        shift = 0.5 * (left - right) / (left - 2 * top + right)
        height = np.exp(top - 0.25 * (left - right) * shift)
        found.append((float(frequency[i] + shift * frequency[1]), float(height)))
    return sorted(found)


def maxima(height: Array, prominence: float = 0.0, least: float = -np.inf) -> list[int]:
    """Local maxima of at least `least`, by `prominence` above the valley to a higher one.

    Of the two valleys the higher one counts. A flat top is found at its middle, an end is none.
    """
    change = np.flatnonzero(np.diff(height)) + 1  # where a new value begins
    starts, stops = np.append(0, change), np.append(change, len(height))
    level = height[starts]
    tops = 1 + np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] > level[2:]))
    kept = []
    for k in tops[level[tops] >= least]:
        if prominence <= 0:
            kept.append(int(starts[k] + stops[k] - 1) // 2)
            continue
        higher = np.flatnonzero(level > level[k])
        left, right = higher[higher < k].max(initial=-1), higher[higher > k].min(initial=len(level))
        valley = max(level[left + 1 : k + 1].min(), level[k:right].min())
        if level[k] - valley >= prominence:
            kept.append(int(starts[k] + stops[k] - 1) // 2)
    return kept


def modes_near(f: float, natural: Sequence[float], resolution: float) -> str:
    """Numbers of the natural frequencies that a peak may be: they shift with pose and load."""
    near = [i for i, own in enumerate(natural, 1) if abs(own - f) <= max(resolution, 0.03 * f)]
    if not near:
        return ""
    several = len(near) > 1
    return f"\nmode{'s' if several else ''} {near[0]}" + (f"-{near[-1]}" if several else "")
