"""A start in starved light: neighbouring pixels pooled until a pulse can be seen in them.

Takes an `Sighting` in which hardly any pixel can be fitted alone, gives the same recording with
f x f pixels added into one, on the calibrated clock, seen by a camera of larger pixels. Good for
finding the path; the counts themselves are then fitted pixel by pixel by `photon`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.model import Camera
from lightflight.reconstruct.model.sighting import Sighting, blind_pixels, pixel_counts
from lightflight.recording.histograms import Histograms
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.pulses.arrivals import find_arrivals

Floats = NDArray[np.float64]


def pooled_camera(camera: Camera, factor: int) -> Camera:
    """The same camera with `factor` x `factor` pixels taken as one (what is left over is cut).

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    factor : int
        Pixels along each axis that become one.

    Returns
    -------
    Camera
        Rays keep their directions; (rows // factor, cols // factor) pixels.
    """
    # The first pixel's centre is (0, 0): that of a block lies between its pixels.
    shift = (factor - 1) / 2
    matrix = np.array(camera.matrix, dtype=float)
    matrix[0, :2] /= factor
    matrix[1, :2] /= factor
    matrix[0, 2] = (camera.matrix[0, 2] - shift) / factor
    matrix[1, 2] = (camera.matrix[1, 2] - shift) / factor
    shape = (camera.shape[0] // factor, camera.shape[1] // factor)
    return replace(camera, matrix=matrix, shape=shape)


def pooled_histograms(sighting: Sighting, factor: int) -> Histograms:
    """Counts of `factor` x `factor` pixels added in arrival time, pixel delays taken off.

    Each code's counts go whole to the bin of its middle: half a code of rounding does not matter
    to a start.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    factor : int
        Pixels along each axis that become one.

    Returns
    -------
    Histograms
        Even bins of arrival time, one clock for all.
    """
    hist = sighting.histograms
    rows, cols = (n // factor * factor for n in hist.shape)
    row, col = (index.ravel() for index in np.indices((rows, cols)))
    pixels = pixel_counts(sighting, row, col)
    width = float(hist.bin_width_ps or 1.0)
    middle = 0.5 * (pixels.lower_ps + pixels.upper_ps) - pixels.skew_ps[:, np.newaxis]
    live = pixels.upper_ps > pixels.lower_ps
    counts = np.where(live & ~sighting.blind[row, col][:, np.newaxis], pixels.counts, 0.0)
    period = hist.laser_period_ps
    if period is None:
        first = float(middle[live].min()) - 0.5 * width
        n_bins = int(np.ceil((float(middle[live].max()) - first) / width)) + 1
    else:
        first, n_bins = 0.0, int(np.ceil(period / width))
        # A whole number of bins in the period, so that the last meets the first.
        width = period / n_bins
        middle = np.mod(middle, period)
    bins = np.clip(((middle - first) / width).astype(np.int64), 0, n_bins - 1)
    block = (row // factor) * (cols // factor) + col // factor
    flat = (block[:, np.newaxis] * n_bins + bins).ravel()
    size = (rows // factor) * (cols // factor) * n_bins
    added = np.bincount(flat, weights=counts.ravel(), minlength=size)
    return Histograms(
        np.rint(added).astype(np.uint32).reshape(rows // factor, cols // factor, n_bins),
        bin_width_ps=width,
        laser_period_ps=period,
        first_edge_ps=first,
    )


def pooled_sighting(sighting: Sighting, factor: int) -> Sighting:
    """The recording with pixels pooled, and the pulses found in it.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    factor : int
        Pixels along each axis that become one.

    Returns
    -------
    Sighting
        On a nominal clock: the delays are taken off already.
    """
    hist = pooled_histograms(sighting, factor)
    # Delays and unequal codes were taken off when the counts were added.
    clock = TimingCalibration.nominal(hist)
    arrivals = find_arrivals(hist, timing=clock, response="clock")
    return Sighting(hist, clock, arrivals, arrivals.arrival_ps, blind_pixels(arrivals, clock))
