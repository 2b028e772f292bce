"""Pixels beside a line that are brighter than the line would make them.

A pixel's own light is free in the tests of counts, so that light need not be even; and light of
a piece too short to be a leg, an arm that leaves the picture at once, comes when that of the leg
beside it does. So pixels that a leg lights by the wings of its spot alone are held to these, and to
what the lens throws as far from that leg elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from lightflight.camera.model import Camera
from lightflight.reconstruct.model.counted import Pixels
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.light import LEAST_SHARE
from lightflight.reconstruct.model.picture import Picture
from lightflight.reconstruct.model.strength import span_of_knots
from lightflight.reconstruct.other_light.around import Seen

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_BESIDE_STDS = 2.5
"""From a line on, in standard deviations of its spot, a Gaussian leaves less than 1 in 20 of its
light: most of what is brighter is the lens's doing, or another light's."""
_ALIKE_PX = 0.5
"""Pixels whose distances from a leg differ by less are alike, px."""
_FEWEST_ALIKE = 4
"""Of which the median says what the lens does."""
_MARGIN = 3.0
"""A pixel may be so many times as bright as the median of those alike: lenses are not as sharp
everywhere, nor lines as smooth as their splines."""
_ABOUT_STDS = 3.0
"""A pulse's light comes within so many of its standard deviations."""
_AROUND_PX = 3.0
"""The brightest light of a line so near to a pixel may be what it shows, px."""


@dataclass(frozen=True)
class Brightest:
    """The light that is least likely by chance; `p_value` is that of the least of so many."""

    p_value: float
    place: tuple[int, int]
    lag_ps: float
    photons: float


def brightest_beside(lit: Pixels, seen: Seen, picture: Picture, camera: Camera) -> Brightest:
    """The pixel beside a leg that is least likely as bright as it is.

    Parameters
    ----------
    lit : Pixels
        All n pixels that legs light, as fitted.
    seen : Seen
        The same pixels, and the legs near each.
    picture : Picture
        Lines of the legs.
    camera : Camera
        Of the picture.

    Returns
    -------
    Brightest
        Of chance one where no pixel is brighter than expected.
    """
    points = undistorted_px(camera, seen.rows, seen.cols)
    line, told, beside = _light_of_lines(points, lit, seen, picture)
    counted, others = _counted_about_pulses(lit)
    photons = counted - others
    usual = _usual_share((photons - told) / line, seen, beside)
    expected = _MARGIN * (told + usual * line)
    asked = beside & np.isfinite(expected) & (photons > LEAST_SHARE * line.max(initial=0.0))
    if not asked.any():
        return Brightest(1.0, (0, 0), 0.0, 0.0)
    mean = np.maximum(np.nan_to_num(expected) + others, 1e-9)
    chance = np.where(asked, gammainc(np.maximum(counted, 1e-9), mean), 1.0)
    # Of those that chance cannot tell apart the brightest.
    worst, n = int(np.lexsort((-photons, chance))[0]), int(np.count_nonzero(beside))
    return Brightest(
        float(-np.expm1(n * np.log1p(-min(chance[worst], 1.0 - 1e-16)))),
        (int(seen.rows[worst]), int(seen.cols[worst])),
        float(lit.late_ps[worst, 0]),
        float((photons - expected)[worst]),
    )


def _counted_about_pulses(lit: Pixels) -> tuple[Floats, Floats]:
    """Counts about the times of the legs, and what of them is expected of all else; (n,) each.

    Photons as fitted would not do: where a pixel has hardly any, they are what its prior says.
    """
    edges = lit.cells.edges_ps
    middle = 0.5 * (edges[:, 1:] + edges[:, :-1])
    about = np.zeros(middle.shape, dtype=bool)
    for k in range(lit.late_ps.shape[1]):
        near = (
            np.abs(middle - lit.late_ps[:, k : k + 1])
            < _ABOUT_STDS * lit.drawn_out_ps[:, k : k + 1]
        )
        about |= near & (lit.photons[:, k : k + 1] > 0.0)
    about &= lit.weight > 0.0
    counted = np.where(about, lit.cells.counts, 0.0).sum(axis=1)
    others = np.where(about, lit.mean, 0.0).sum(axis=1) - lit.photons.sum(axis=1)
    return counted, np.maximum(others, 0.0)


def _light_of_lines(
    points: Floats, lit: Pixels, seen: Seen, picture: Picture
) -> tuple[Floats, Floats, Bools]:
    """How bright the lines near n pixels are, what they give these, and whether by wings alone."""
    line, told = np.zeros((2, len(points)))
    beside = np.ones(len(points), dtype=bool)
    for k, (leg, light) in enumerate(zip(picture.legs, picture.fits, strict=True)):
        own = np.flatnonzero((seen.leg == k).any(axis=1))
        if leg.dark or not len(own):
            continue
        along, across = leg.along_across(points[own])
        within = np.clip(along, *span_of_knots(light.spline.t))
        photons = np.where(seen.leg[own] == k, lit.photons[own], 0.0).sum(axis=1)
        on_line = np.abs(across) < 2.0 * picture.spot_std_px
        # A grain, the edge of a shadow or the end of a line is sharper than its spline.
        near = np.linalg.norm(points[own][:, np.newaxis] - points[own][on_line], axis=2)
        around = np.where(near < _AROUND_PX, photons[on_line], 0.0).max(axis=1, initial=0.0)
        bright = np.maximum(np.exp(light.spline(within)), around)
        line[own] += bright
        told[own] += bright * np.exp(light.seen(along, across, leg.heading_rad(along)).log_light)
        beside[own] &= np.abs(across) > _BESIDE_STDS * light.spot_std_at(along)
    return np.maximum(line, 1e-9), told, beside


def _usual_share(share: Floats, seen: Seen, beside: Bools) -> Floats:
    """(n,), median share beyond what is told of others as far from the same leg; NaN: too few."""
    usual = np.full(len(share), np.nan)
    leg, away = seen.leg[:, 0], seen.away_px[:, 0]
    for i in np.flatnonzero(beside):
        alike = beside & (leg == leg[i]) & (np.abs(away - away[i]) < _ALIKE_PX)
        alike[i] = False
        if np.count_nonzero(alike) >= _FEWEST_ALIKE:
            usual[i] = max(float(np.median(share[alike])), 0.0)
    return usual
