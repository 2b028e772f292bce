"""The tail that all pulses of a recording share, before any path is known.

Where much of the light is late, pulses that are fitted without a tail come late by more than their
width, and the more where two legs meet: legs are not where they are. So the strengths of late light
are first taken from the brightest pixels, each with its own pulse.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import NothingFoundError
from lightflight.reconstruct.model.cells import cells_about, lag_edges
from lightflight.reconstruct.model.expected_counts import Pulses, Tails
from lightflight.reconstruct.model.pulse_shape import Shape, shape_of
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.other_light.around import FINE_GROWTH, FINE_STDS
from lightflight.reconstruct.other_light.strengths import tails_of
from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]

_SAMPLE = 64
"""Pixels that are enough for the shape of all pulses."""
_BRIGHT = 0.1
"""Of the brightest pixel's light: dimmer ones are not asked."""
_LEAST = 0.05
"""Of a pulse: where less is late, legs are where they seem to be (they were with a fifth late), and
times are corrected once the path is known."""
_MOST_MISSING = 0.1
"""Of what is late in one way, less than none in another: more of that is no tail but an echo."""
_FLIGHT_STD = 0.5
"""By how much flight through the footprint may draw out a pulse with a tail before a path says by
how much: half the variance that it adds, in the pulse's own. Held alike, steep light uneven in
brightness was a tail shorter than the pulse, which moved all times by a quarter of their width."""
_MOST_TIMES = 4
_AS_NARROW = 0.8
"""Cells are made anew where the core of pulses is narrower than this part of what it seemed."""
_STEP, _ENDS = 0.02, (-8.0, 20.0)
"""Of a tabulated shape: in its standard deviations, and its ends in these and in waits."""


def shape_with_tail(sighting: Sighting, *, nominal: bool) -> tuple[Response, float] | None:
    """Shape of all pulses where much of their light is late; None where it is not.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    nominal : bool
        Whether the widths of the codes were never measured.

    Returns
    -------
    shape : Response
        What was calibrated, or a Gaussian, with the late part of the light; its place is that of
        the light that is not late.
    std_ps : float
        Standard deviation of the light that is not late, ps.
    """
    arrivals, rows = sighting.arrivals, sighting.usable_pulses
    photons = arrivals.photons[rows]
    if not len(rows):
        return None
    order = rows[np.argsort(-photons, kind="stable")]
    pixel = arrivals.row[order].astype(np.int64) * sighting.blind.shape[1] + arrivals.col[order]
    own = order[np.sort(np.unique(pixel, return_index=True)[1])][:_SAMPLE]
    own = own[arrivals.photons[own] > _BRIGHT * photons.max()]
    shape = shape_of(sighting.timing.response)
    std, late = float(np.median(arrivals.std_ps[own])), np.zeros((len(own), 1))
    if sighting.timing.response is not None:
        # A tail stretched over another tail would leave nothing to be late.
        std = min(std, sighting.timing.response.std_ps)
    free = np.full((len(own), 1), _FLIGHT_STD)
    for _ in range(_MOST_TIMES):
        lags = lag_edges(std, FINE_STDS * std, FINE_GROWTH, sighting.histograms.laser_period_ps)
        at = arrivals.row[own].astype(np.int64), arrivals.col[own].astype(np.int64)
        cells = cells_about(sighting, *at, sighting.arrival_ps[own], lags, nominal=nominal)
        wide = np.full((len(own), 1), std)
        pulses = Pulses(late, wide, shape, flight_std=None if shape.is_gaussian else free)
        try:
            found, pixels = tails_of(cells, pulses)
        except (NothingFoundError, np.linalg.LinAlgError):
            return None
        core, late = float(np.median(pixels.std_ps)), pixels.late_ps
        if core > _AS_NARROW * std:
            break
        std = core
    late_share = sum(share for share, _ in found if share > 0.0)
    missing = -sum(share for share, _ in found if share < 0.0)
    if late_share < _LEAST or missing > _MOST_MISSING * late_share:
        return None
    tails = [(share / max(1.0, late_share), wait) for share, wait in found if share > 0.0]
    return _with_tail(shape, core, tails), core


def _with_tail(shape: Shape, std_ps: float, tails: Tails) -> Response:
    """A shape of some width, shares of it late."""
    end = _ENDS[1] * max(wait for _, wait in tails) / std_ps - _ENDS[0]
    # Steps grow beyond the core: a tail has no edges.
    z = np.concatenate((np.arange(_ENDS[0], -_ENDS[0], _STEP), np.geomspace(-_ENDS[0], end, 400)))
    density = (1.0 - sum(share for share, _ in tails)) * shape.at(z)[1]
    for share, wait in tails:
        ratio = np.full(1, std_ps / wait)
        density = density + share * ratio * shape.kept_back(z, ratio)
    return Response(z * std_ps, np.maximum(density, 0.0), place_ps=0.0)
