"""How long the pulse looks (Section 4A, Fig. 5c), measured two ways.

The paper does not say which width it plots against the angle:

- *of a pixel*: the width of one pixel's histogram. Relativity leaves it alone: laser, response
  and the transit of the pulse through the pixel's footprint, in squares.
- *of a frame*: the length of the pulse in one camera frame, counted in event time. Light from
  the pulse's head and tail left at different event times and arrives together, which stretches
  the pulse by dt/dt_a = n_p / (n_p - n_r d.u): 58 to 82 ps for 68 ps, from -10 to 10 degrees.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from lightflight.path.light_path import LightPath
from lightflight.reconstruct.limits.conditions import spot_std_of
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.reconstruct.model.sighting import Sighting, pixel_counts
from lightflight.simulate import Scene
from lightflight.units import fwhm_from_std, std_from_fwhm
from studies.zheng2020.reported import BIN_WIDTH_PS

Floats = NDArray[np.float64]

RESPONSE_FWHM_PS = 150.0
"""Response of the camera by its vendor, taken off in squares as the paper does."""

_CODE_VARIANCE = BIN_WIDTH_PS**2 / 12.0
"""Of where a photon came within its code, ps^2."""
_FRAMES = 21
_REACH_ROWS = 3


def widths_of_recording(sighting: Sighting, path: LightPath, scene: Scene) -> dict[str, float]:
    """Median FWHM of the pixels' histograms and of the frames, as measured and deconvolved, ps.

    Parameters
    ----------
    sighting : pulses of one leg, as the paper fits them.
    path : where the leg runs; gives each pixel its event time.
    """
    spot = spot_std_of(scene)
    rows, cols = _pixels_of_leg(sighting)
    state = PathState(path.vertices_mm, float(path.vertex_times_ps[0]))
    foot = footprints(
        state,
        camera=scene.camera,
        medium=scene.medium,
        legs=np.zeros(len(rows), dtype=np.int64),
        rows=rows,
        cols=cols,
    )
    times = path.vertex_times_ps
    event = times[0] + foot.fraction * (times[1] - times[0])
    stretch = abs(float(times[1] - times[0])) / foot.px_per_leg / np.abs(foot.slope_ps_per_px)
    transit = spot * float(np.median(np.abs(foot.slope_ps_per_px)))
    frame = _frame_width(sighting, rows, cols, foot.arrival_ps, event, stretch, spot)
    return {
        "pixel_fwhm_ps": fwhm_from_std(_median_std(sighting)),
        "pixel_deconvolved_ps": width_of_pixels(sighting, spot_ps=transit),
        "frame_fwhm_ps": frame[0],
        "frame_deconvolved_ps": frame[1],
    }


def frame_width_theory_ps(scene: Scene) -> float:
    """By theory, n_p tau / (n_p - n_r d.u) at the leg's point nearest to the optical axis, ps."""
    vertices = np.asarray(scene.vertices_mm, dtype=float)
    direction = (vertices[1] - vertices[0]) / np.linalg.norm(vertices[1] - vertices[0])
    center, axis = scene.camera.center_mm, scene.camera.backward_axis
    across = direction - (direction @ axis) * axis
    length = float((center - vertices[0]) @ across) / float(direction @ across)
    towards = center - (vertices[0] + length * direction)
    towards = towards / np.linalg.norm(towards)
    medium = scene.medium
    slowness = medium.path_group_index - medium.return_group_index * float(direction @ towards)
    return float(medium.path_group_index * scene.pulse_fwhm_ps / slowness)


def _pixels_of_leg(sighting: Sighting) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Every column's pixels near its brightest one; (n,) rows and columns."""
    arrivals = sighting.arrivals
    light = np.zeros(arrivals.shape)
    use = arrivals.usable & (arrivals.photons > 0)
    light[arrivals.row[use], arrivals.col[use]] = arrivals.photons[use]
    middle = np.median(np.argmax(light, axis=0))
    rows, cols = np.indices(light.shape)
    near = (np.abs(rows - middle) < _REACH_ROWS) & ~sighting.blind
    near[:, ((light > 0).sum(axis=0) == 0)] = False
    return rows[near].astype(np.int64), cols[near].astype(np.int64)


def width_of_pixels(sighting: Sighting, *, spot_ps: float) -> float:
    """FWHM of the laser pulse from the pixels' histograms: all else taken off in squares, ps.

    Parameters
    ----------
    spot_ps : standard deviation of the arrival time over a pixel's footprint, ps.
    """
    std = _median_std(sighting)
    # The paper's Gaussian is fitted to counts at the codes' middles: a code's width is in it.
    own = std**2 - std_from_fwhm(RESPONSE_FWHM_PS) ** 2 - _CODE_VARIANCE - spot_ps**2
    return fwhm_from_std(float(np.sqrt(max(own, 0.0))))


def _median_std(sighting: Sighting) -> float:
    """Standard deviation of the bright pixels' pulses, ps."""
    arrivals = sighting.arrivals
    bright = arrivals.usable & (arrivals.photons > 0.2 * np.nanmax(arrivals.photons))
    return float(np.median(arrivals.std_ps[bright]))


def _frame_width(
    sighting: Sighting,
    rows: NDArray[np.int64],
    cols: NDArray[np.int64],
    arrival: Floats,
    event: Floats,
    stretch: Floats,
    spot_px: float,
) -> tuple[float, float]:
    """Mean FWHM of the pulse in single frames, as it is and deconvolved, in event time, ps."""
    counts, when = _counts_on_clock(sighting, rows, cols)
    columns = np.unique(cols)
    light = np.array([counts[cols == c].sum() for c in columns])
    place = np.array([np.mean(event[cols == c]) for c in columns])
    px_ps = float(np.median(np.abs(np.diff(place))))
    widths, own = [], []
    for reading in np.quantile(arrival, np.linspace(0.25, 0.75, _FRAMES)):
        inside = _overlap(when, reading)
        share = np.array([(counts * inside)[cols == c].sum() for c in columns]) / light
        std = _gaussian_std(place, share)
        factor = float(np.interp(reading, np.sort(arrival), stretch[np.argsort(arrival)]))
        # Three codes' widths: the frame, the photon within its code, the code against the frame.
        blur = (std_from_fwhm(RESPONSE_FWHM_PS) ** 2 + 3.0 * _CODE_VARIANCE) * factor**2
        blur += (spot_px * px_ps) ** 2
        widths.append(fwhm_from_std(std))
        own.append(fwhm_from_std(float(np.sqrt(max(std**2 - blur, 0.0)))))
    return float(np.nanmean(widths)), float(np.nanmean(own))


def _counts_on_clock(
    sighting: Sighting, rows: NDArray[np.int64], cols: NDArray[np.int64]
) -> tuple[Floats, tuple[Floats, Floats]]:
    """Counts less the flat background, (n, codes), and each code's arrival interval, ps."""
    pixels = pixel_counts(sighting, rows, cols)
    lower = pixels.lower_ps - pixels.skew_ps[:, np.newaxis]
    upper = pixels.upper_ps - pixels.skew_ps[:, np.newaxis]
    middle = float(np.median(sighting.arrival_ps[sighting.arrivals.usable]))
    near = np.abs(0.5 * (lower + upper) - middle) < 3000.0
    live = upper > lower
    away = np.where(live & ~near, upper - lower, 0.0).sum(axis=1)
    rate = np.where(live & ~near, pixels.counts, 0.0).sum(axis=1) / away
    counts = np.where(live & near, pixels.counts - rate[:, np.newaxis] * (upper - lower), 0.0)
    return counts, (lower, upper)


def _overlap(when: tuple[Floats, Floats], reading_ps: float) -> Floats:
    """Share of each code that lies in the frame about a reading of the camera's clock."""
    lower, upper = when
    low, high = reading_ps - 0.5 * BIN_WIDTH_PS, reading_ps + 0.5 * BIN_WIDTH_PS
    covered = np.clip(np.minimum(upper, high) - np.maximum(lower, low), 0.0, None)
    share: Floats = covered / np.maximum(upper - lower, 1e-9)
    return share


def _gaussian_std(place: Floats, share: Floats) -> float:
    """Standard deviation of a Gaussian with a constant, fitted by least squares."""

    def model(x: Any, height: float, middle: float, std: float, constant: float) -> Any:
        return height * np.exp(-0.5 * ((x - middle) / std) ** 2) + constant

    peak = int(np.argmax(share))
    try:
        found, _ = curve_fit(model, place, share, (share[peak], place[peak], 75.0, 0.0))
    except RuntimeError:
        return float("nan")
    return abs(float(found[2]))
