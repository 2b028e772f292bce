"""How large the pixels' active areas are, where the path says it and their counts do not.

Rows of pixels that a leg crosses at one height cannot tell a square spot from a wider round one:
the area then moves its line and the times of its pulses together, and only the whole path shows it.
It is one shared error of a camera's pulses and lines, about the area that was found.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.joint import JointFit, score_of_unfitted
from lightflight.reconstruct.fit.uneven import pulses_by_leg
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.unequal import price

Floats = NDArray[np.float64]

_ANY_STD = 0.5
"""Standard deviation of the fourth power of the active side of which nothing is told."""
_SHAPE_STD = 0.5
"""The same of what else flattens a spot: known pile-up of haze looked like a whole pitch."""
_REACH_STDS = 4.0
"""Spots from its line beyond which a pixel sees no more of a leg: what it would see grows by their
third power."""
_KNOWN_STD = 0.1
"""Counts that know it so well have the last word where they show no area: what they leave moves
lines by a few 1e-4 px."""


def areas_of_path(fit: JointFit, setting: Setting) -> Mapping[int, float] | None:
    """Sides of the active areas that a fine fit asks for, by camera; None: it asks for no other.

    Parameters
    ----------
    fit : JointFit
        With fine pictures.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    mapping of int to float or None
        Pitches, of the cameras whose counts or path show an area.
    """
    if fit.active_px:
        # What it does grows with the fourth power: one step is enough, its error is fitted.
        return None
    asked, views = {}, range(len(fit.solution.cameras))
    sides = {view: _side_of_view(fit, view) for view in views}
    # What counts settle no path says better.
    unsure = [_std_of_fourth(fit, view, by_shape=0.0) > _KNOWN_STD for view in views]
    open_ = [view for view in views if sides[view] > 0.0 or unsure[view]]
    if not open_:
        return None
    by_time, by_line = _columns(fit, setting, open_)
    for k, view in enumerate(open_):
        (score,), ((own,),) = score_of_unfitted(fit, by_time[:, [k]], by_line[:, [k]])
        by_path = score > 0.0 and score**2 / own > 2.0 * price(1, len(fit.times.leg))
        if sides[view] > 0.0 or by_path:
            shown, std = sides[view] ** 4, _std_of_fourth(fit, view)
            # Nothing that is told stands at no area: what counts show stands between.
            towards_none = shown * std**2 / _ANY_STD**2
            asked[view] = _moved(shown, (score * std - towards_none) / own)
    return asked or None


def areas_found(fit: JointFit) -> Mapping[int, tuple[float, float]]:
    """Areas that a fit settled on, by camera: side, and standard deviation of its fourth power.

    Parameters
    ----------
    fit : JointFit
        With fine pictures.

    Returns
    -------
    mapping of int to (float, float)
        In pitches; only cameras whose area was asked for.
    """
    last = fit.freedom.basis.shape[1] + len(fit.solution.modes)
    own = np.diag(fit.solution.covariance)[last - len(fit.active_px) : last]
    return {
        view: (side, float(np.sqrt(var)) * _std_of_fourth(fit, view))
        for (view, side), var in zip(fit.active_px.items(), own, strict=True)
    }


def with_area_errors(fit: JointFit, setting: Setting) -> JointFit:
    """The fit with what is not known of the active areas as errors that times and lines share.

    Parameters
    ----------
    fit : JointFit
        With fine pictures of the areas that it names.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit
        Whose last shared errors these are.
    """
    if not fit.active_px:
        return fit
    by_time, by_line = _columns(fit, setting, fit.active_px)
    return replace(
        fit,
        times=replace(fit.times, modes_ps=np.hstack((fit.times.modes_ps, by_time))),
        lines=replace(fit.lines, modes=fit.lines.whitening @ by_line),
    )


def _moved(fourth: float, step: float) -> float:
    return float(np.clip(fourth + step, 0.0, 1.0) ** 0.25)


def _columns(fit: JointFit, setting: Setting, views: Iterable[int]) -> tuple[Floats, Floats]:
    """One-sigma columns (n, v) of the times, ps, and (a, v) of the lines, px, a camera each."""
    place = {view: k for k, view in enumerate(views)}
    by_time = np.zeros((len(fit.times.leg), len(place)))
    by_line = np.zeros((len(fit.lines.leg), len(place)))
    std = {view: _std_of_fourth(fit, view) for view in place}
    for some in pulses_by_leg(fit, setting):
        view = fit.sightings[some.number].view
        if view in place:
            along, across = some.line.along_across(some.points_px)
            spot = some.light.spot_std_at(along)
            across = np.clip(across, -_REACH_STDS * spot, _REACH_STDS * spot)
            seen = some.light.seen(along, across, some.line.heading_rad(along))
            late = some.prints.slope_ps_per_px * seen.ahead_by_area
            by_time[some.rows, place[view]] = std[view] * late
    first = 0
    for picture, sighting in zip(fit.pictures, fit.sightings, strict=True):
        for leg, light in zip(picture.legs, picture.fits, strict=True):
            if leg.dark:
                continue
            own = slice(first, first + len(light.offset_px))
            first = own.stop
            if sighting.view in place:
                moves = std[sighting.view] * light.area.offset_by_fourth
                by_line[own, place[sighting.view]] = moves
    return by_time, by_line


def _side_of_view(fit: JointFit, view: int) -> float:
    """Side of the active area that the counts of a camera's recordings show, at most, pitches."""
    return max(
        light.area.side_px
        for picture, sighting in zip(fit.pictures, fit.sightings, strict=True)
        for light in picture.fits
        if sighting.view == view
    )


def _std_of_fourth(fit: JointFit, view: int, *, by_shape: float = _SHAPE_STD) -> float:
    """Standard deviation of its fourth power by the counts of all recordings of a camera.

    Zero where none of them are photons: of those nobody asks.
    """
    # One area of all legs: each of them says the same, but those that are dark.
    stds = [
        max(light.area.fourth_std for light in picture.fits)
        for picture, sighting in zip(fit.pictures, fit.sightings, strict=True)
        if sighting.view == view
    ]
    told = sum(std**-2.0 for std in stds if std > 0.0)
    if not told:
        return 0.0
    return float((1.0 / (1.0 / told + by_shape**2) + _ANY_STD**-2.0) ** -0.5)
