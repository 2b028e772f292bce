"""The laser pulse of a reconstructed path: its own width, and how long it looks leg by leg.

Takes a path, the recording and clock it came from and the camera's response, gives the width that
is left of the recorded ones by deconvolution. What the pulse's flight through a pixel's footprint
adds is known from the path, and taken off as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import check_kinds
from lightflight.display import Card, Shown, number, with_error
from lightflight.reconstruct.model.geometry import footprints, state_of_path
from lightflight.reconstruct.model.picture import measure_picture
from lightflight.reconstruct.model.sighting import Sighting, blind_pixels
from lightflight.reconstruct.sightings import clock_or_nominal
from lightflight.timing.laser_width import (
    LaserWidth,
    apparent_fwhm_ps,
    laser_width_from_pulses,
)
from lightflight.timing.pulses.arrivals import Arrivals, find_arrivals

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.code_clock import CodeClock

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class LaserPulse(Shown):
    """Width of the laser pulse, and what a camera frame shows of its length.

    Attributes
    ----------
    width : LaserWidth
        By deconvolution of the recorded pulses.
    apparent_fwhm_ps : array of float, shape (legs,)
        Length of the pulse in one camera frame as flight time along the leg, at the middle of each
        leg, ps: grows with the leg's angle towards the camera.
    """

    width: LaserWidth

    apparent_fwhm_ps: Floats

    def _card(self) -> Card:
        width = self.width
        seen = ", ".join(number(fwhm) for fwhm in self.apparent_fwhm_ps)
        return Card(
            "LaserPulse",
            [
                ("width (FWHM)", f"{with_error(width.fwhm_ps, width.fwhm_std_ps)} ps"),
                ("recorded", f"{number(width.recorded_fwhm_ps, 4)} ps, {width.n_pulses} pulses"),
                ("in one frame", f"{seen} ps, by leg"),
            ],
        )


def laser_pulse(
    path: LightPath,
    hist: Histograms,
    *,
    response_fwhm_ps: float,
    response_fwhm_std_ps: float = 0.0,
    timing: CodeClock | None = None,
) -> LaserPulse:
    """Width of the laser pulse that drew a path: recorded^2 - response^2 - transit^2.

    Parameters
    ----------
    path : LightPath
        Reconstructed from `hist`.
    hist : Histograms
        The recording.
    response_fwhm_ps, response_fwhm_std_ps : float
        Width of the camera's response alone, and how well it is known, ps.
    timing : TimingCalibration, optional
        The clock; None: nominal codes, with a warning.

    Raises
    ------
    NothingFoundError
        No pixel on the path holds a usable pulse of its own.
    ValueError
        A width is negative or not finite.
    """
    check_kinds("path", "hist", path=path, hist=hist, timing=timing)
    clock = clock_or_nominal(hist, timing)
    arrivals = find_arrivals(hist, timing=clock, response="clock")
    # Variances of independent delays add: laser, response and flight through the footprint.
    width = laser_width_from_pulses(
        arrivals,
        response_fwhm_ps=response_fwhm_ps,
        response_fwhm_std_ps=response_fwhm_std_ps,
        transit_std_ps=_transit_std_ps(path, hist, clock, arrivals),
    )
    middle = np.array([0.5 * (leg.end_mm + leg.start_mm) for leg in path.legs])
    # Only the component of the leg towards the camera stretches what a frame shows.
    towards = -path.camera.sight_directions(middle)
    direction = np.array([leg.direction for leg in path.legs])
    apparent = apparent_fwhm_ps(width.fwhm_ps, direction, towards, medium=path.medium)
    return LaserPulse(width, apparent)


def _transit_std_ps(
    path: LightPath, hist: Histograms, clock: CodeClock, arrivals: Arrivals
) -> Floats:
    """(n,), spread of times over the footprint of each pulse; NaN for pulses not of the path."""
    state = state_of_path(path)
    transit = np.full(len(arrivals.row), np.nan)
    pixel = arrivals.row.astype(np.int64) * arrivals.shape[1] + arrivals.col
    table = path.residuals[path.residuals["used"]]
    of_path = table["row"].astype(np.int64) * arrivals.shape[1] + table["col"]
    # A pixel with two pulses has two widths that its fit cannot tell apart well.
    alone = np.bincount(pixel, minlength=arrivals.shape[0] * arrivals.shape[1])[pixel] == 1
    leg_of = dict(zip(of_path.tolist(), table["leg"].tolist(), strict=True))
    seen = np.array([i for i in np.flatnonzero(alone) if int(pixel[i]) in leg_of], dtype=np.int64)
    if not len(seen):
        return transit
    std_ps = float(np.nanmedian(arrivals.std_ps[seen]))
    watched = Sighting(hist, clock, arrivals, arrivals.arrival_ps, blind_pixels(arrivals, clock))
    picture = measure_picture(state, watched, camera=path.camera, medium=path.medium, std_ps=std_ps)
    print_ = footprints(
        state,
        camera=path.camera,
        medium=path.medium,
        legs=np.array([leg_of[int(pixel[i])] for i in seen]),
        rows=arrivals.row[seen],
        cols=arrivals.col[seen],
    )
    transit[seen] = np.abs(print_.slope_ps_per_px) * picture.spot_std_px
    return transit
