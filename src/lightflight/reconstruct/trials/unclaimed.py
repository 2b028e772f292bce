"""Light that no leg explains, and whether it is a leg that the search in the picture left out.

A short leg that turns off beside its neighbour hides in that one's wings as long as legs are
looked for one by one. Once the others are known, the pulses they do not explain are few, and a
leg shows among them; it is kept where the path with it explains them and still fits.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from lightflight import flags
from lightflight.errors import NothingFoundError
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.membership import (
    mean_of_cut_light_ps,
    on_leg,
    prints_of_leg,
    tips_in_view,
)
from lightflight.reconstruct.legs.direction import search_legs
from lightflight.reconstruct.legs.find import ImageLeg, image_leg, is_flash, legs_in_turn
from lightflight.reconstruct.legs.ghosts import on_surfaces
from lightflight.reconstruct.model.geometry import Indices
from lightflight.reconstruct.model.image_plane import along_across, undistorted_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting, first_of_each_view
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason
from lightflight.reconstruct.trials.revise import fit_from_legs, revised, with_n_legs

Floats = NDArray[np.float64]

_LEAST_PULSES = 3
"""So many pulses, at as many places along a line, may be a leg; fewer are left alone."""
_LEAST_PHOTONS = 20.0
"""Dimmer pulses than this may be chance, or a wing."""
EXPLAINED_REACH_PX = 2.5
"""A pulse this near to a leg's line, at its time, is explained as the leg's light, px ..."""
EXPLAINED_REACH_SPOTS = 4.0
"""... or this near in stds of the spot."""
_MUCH_LEFT = 0.15
"""A path that leaves more pulses than this for each that it explains may lack a corner."""
_MARGIN_PX = 1.0
"""So is one this far beyond a corner, px."""
_ERRORS, _PULSES = 6.0, 0.5
"""Times agree within so many errors, or this part of the pulse's own std."""
_MOST_FURTHER = 3
"""More legs than this are not left out by a search: what is beside the path is other light."""
_LINK_PX, _LINK_STDS = 2.3, 2.0
"""Pulses this near to each other in the picture, px, and in time, in their stds, lie together."""
_WORST_CHI2 = 1.5
"""A path with further legs must fit its pulses to this chi-square per degree of freedom, or as well
as the path without them does: where light is uneven neither does better."""


def with_unclaimed_legs(
    sightings: list[Sighting], legs: tuple[ImageLeg, ...], fit: JointFit, setting: Setting
) -> JointFit:
    """The fit with the legs that light beside its path asks for; as it is where none does.

    Parameters
    ----------
    legs : tuple of ImageLeg
        As found in the pictures, which the fit began with.
    """
    left = unclaimed_in_pictures(sightings, fit, setting)
    n_left = sum(map(len, left.values()))
    if n_left < _LEAST_PULSES:
        return fit
    chains = _longer_chains(sightings, legs, left, setting)
    if _leaves_out(fit, legs):
        # Others were parted instead: the legs of the path may go on as well.
        own = _longer_chains(sightings, _legs_of_fit(sightings, fit, setting), left, setting)
        chains += [chain for chain in own if chain not in chains]
    trials = [partial(_fitted, sightings, chain, setting) for chain in chains]
    if n_left > _MUCH_LEFT * np.count_nonzero(fit.times.weight > 0):
        # A line that misses so much may be two, the one too short to be found by itself.
        trials.append(partial(_opened_once, sightings, fit, setting))
    for attempt in trials:
        trial = attempt()
        if isinstance(trial, NoFit) or trial.floor_ps > fit.floor_ps + 1e-9:
            continue
        still = sum(map(len, unclaimed_in_pictures(sightings, trial, setting).values()))
        # Explaining the rest must not cost the fit of the others.
        fits = _misfit(trial) < max(_WORST_CHI2, _misfit(fit))
        if fits and trial.solution.converged and still <= n_left - _LEAST_PULSES:
            return trial
    return fit


def _misfit(fit: JointFit) -> float:
    """Chi-square per degree of freedom."""
    return fit.solution.chi2 / max(fit.solution.dof, 1)


def _leaves_out(fit: JointFit, legs: tuple[ImageLeg, ...]) -> bool:
    """Whether a path has next to no pulse of a leg that was found in a picture."""
    views = np.array([one.view for one in fit.sightings])[fit.sighting_of]
    used = fit.times.weight > 0
    for leg in legs:
        own = np.isin(fit.times.index[used & (views == leg.view)], leg.members)
        if np.count_nonzero(own) < 0.5 * len(leg.members):
            return True
    return False


def _legs_of_fit(
    sightings: list[Sighting], fit: JointFit, setting: Setting
) -> tuple[ImageLeg, ...]:
    """The legs of a path by its pulses in the first recording of each camera."""
    legs = []
    for one in first_of_each_view(sightings):
        number = next(k for k, seen in enumerate(fit.sightings) if seen.view == one.view)
        used = (fit.times.weight > 0) & (fit.sighting_of == number)
        for k in fit.solution.state.seen:
            members = fit.times.index[used & (fit.times.leg == k)].astype(np.intp)
            if len(members) >= _LEAST_PULSES:
                leg = image_leg(one.arrivals, members, setting.at(one.view).camera)
                legs.append(replace(leg, view=one.view))
    return tuple(legs)


def from_unclaimed_legs(
    sightings: list[Sighting], legs: tuple[ImageLeg, ...], setting: Setting
) -> JointFit | None:
    """A fit where the legs found make no path, from those and what light beside them adds.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit or None
        None where no chain makes a path.
    """
    for chain in _longer_chains(sightings, legs, {}, setting):
        trial = _fitted(sightings, chain, setting)
        if not isinstance(trial, NoFit):
            return trial
    return None


def unclaimed_in_pictures(
    sightings: list[Sighting], fit: JointFit, setting: Setting
) -> dict[int, Indices]:
    """By camera, rows of the arrivals of its first recording that no leg of a path explains."""
    return {one.view: unclaimed_by_path(one, fit, setting) for one in first_of_each_view(sightings)}


def unclaimed_by_path(sighting: Sighting, fit: JointFit, setting: Setting) -> Indices:
    """Rows of the arrivals table whose pulses no leg of a path explains; (n,).

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    fit : JointFit
        The joint fit.
    setting : Setting
        Cameras, source, medium and waypoints.

    Returns
    -------
    array of int, shape (n,)
    """
    pulses, errors, std = _telling_pulses(sighting)
    number = next(k for k, one in enumerate(fit.sightings) if one.view == sighting.view)
    state, reach = (
        fit.solution.state,
        max(EXPLAINED_REACH_PX, EXPLAINED_REACH_SPOTS * fit.pictures[number].spot_std_px),
    )
    seen = setting.at(sighting.view)
    if setting.others:
        # On its clock as it was found to be.
        camera = fit.solution.cameras[sighting.view]
        seen = replace(seen, camera=replace(seen.camera, clock_offset_ps=camera.clock_offset_ps))
    gap = np.full((len(pulses), state.n_legs), np.nan)
    spot, tips = (
        fit.pictures[number].spot_std_px,
        tips_in_view(fit.tips, state, setting, sighting.view),
    )
    for k in state.seen:
        print_ = prints_of_leg(sighting, state, seen, pulses, k)
        near = np.abs(print_.lateral_px) < reach
        near &= on_leg(print_, k, state, margin_px=_MARGIN_PX)
        late = sighting.arrival_ps[pulses] - print_.arrival_ps
        cut = late - mean_of_cut_light_ps(print_, k, spot, state, tips, seen)
        gap[near, k] = np.where(np.abs(cut) < np.abs(late), cut, late)[near]
    # Pulses that the fit used are its own, whatever the gates say.
    used = fit.times.weight > 0
    if setting.others:
        used &= fit.sighting_of == number
    taken = np.isin(pulses, fit.times.index[used])
    return pulses[~(taken | _explained(gap, errors, std))]


def unclaimed_by_legs(sighting: Sighting, legs: tuple[ImageLeg, ...], setting: Setting) -> Indices:
    """Rows of the arrivals table whose pulses no leg of the picture explains; (n,).

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    array of int, shape (n,)
    """
    pulses, errors, std = _telling_pulses(sighting)
    arrivals = sighting.arrivals
    points = undistorted_px(setting.camera, arrivals.row[pulses], arrivals.col[pulses])
    gap = np.full((len(pulses), len(legs)), np.nan)
    for k, leg in enumerate(legs):
        along, across = along_across(points, leg.origin_px, leg.direction_px)
        first, last = leg.extent_px
        near = (along > first - _MARGIN_PX) & (along < last + _MARGIN_PX)
        near &= np.abs(across) < EXPLAINED_REACH_PX
        gap[near, k] = (sighting.arrival_ps[pulses] - leg.arrival_ps(along))[near]
    return pulses[~_explained(gap, errors, std)]


def _telling_pulses(sighting: Sighting) -> tuple[Indices, Floats, Floats]:
    """(n,) rows of the arrivals table, errors of their times, and their stds, ps.

    None narrower than is typical: steep legs, about their corners most of all, draw pulses out.
    """
    arrivals = sighting.arrivals
    usable = sighting.usable_pulses
    pulses = usable[arrivals.photons[usable] > _LEAST_PHOTONS]
    errors = arrivals.independent_std_ps[pulses]
    if not len(usable):
        return pulses, errors, np.zeros(0)
    return pulses, errors, np.maximum(arrivals.std_ps[pulses], np.median(arrivals.std_ps[usable]))


def _explained(gap: Floats, errors: Floats, std: Floats) -> NDArray[np.bool_]:
    """True where a pulse is a leg's, or the mixed light of two; `gap` (n, legs), NaN: not near."""
    tolerance = np.maximum(_ERRORS * errors, _PULSES * std)
    with np.errstate(invalid="ignore"):
        own = (np.abs(gap) < tolerance[:, np.newaxis]).any(axis=1)
        mixed = (gap < 0).any(axis=1) & (gap > 0).any(axis=1)
    # Two pulses farther apart than this do not mix: they are told apart.
    near = np.nanmin(np.abs(np.nan_to_num(gap, nan=np.inf)), axis=1, initial=np.inf) < 3.0 * std
    explained: NDArray[np.bool_] = own | (mixed & near)
    return explained


def _longer_chains(
    sightings: list[Sighting],
    legs: tuple[ImageLeg, ...],
    left: dict[int, Indices],
    setting: Setting,
) -> list[tuple[ImageLeg, ...]]:
    """The legs with what may be missing among them in one of the pictures, in each way."""
    chains: list[tuple[ImageLeg, ...]] = []
    for one in first_of_each_view(sightings):
        own = tuple(leg for leg in legs if leg.view == one.view)
        others = tuple(leg for leg in legs if leg.view != one.view)
        here = left.get(one.view, np.empty(0, dtype=np.int64))
        longer = _longer_in_picture(one, own, here, setting.at(one.view))
        chains += [(*chain, *others) for chain in longer]
    return chains


def _longer_in_picture(
    sighting: Sighting, legs: tuple[ImageLeg, ...], left: Indices, setting: Setting
) -> list[tuple[ImageLeg, ...]]:
    """The legs of one picture with what may be missing among them, in each way that can be told.

    `left` are the pulses that the path does not explain; those that the legs in the picture do
    not explain are others, where a leg was dropped or cut short by a false corner.
    """
    # Scaled intensities have no errors of their own that say what a leg explains.
    if not sighting.histograms.poisson:
        return []
    arrivals = sighting.arrivals
    beside = _clusters(sighting, unclaimed_by_legs(sighting, legs, setting), setting)
    searched, lone = _searched(sighting, left, setting), _clusters(sighting, left, setting)
    std = float(np.nanmedian(arrivals.std_ps))
    chains: list[tuple[ImageLeg, ...]] = []
    for further in (beside, searched, [*beside, *searched], lone):
        some = [*legs, *further]
        # Brightest chains win: a further leg must not push out a brighter one.
        strength = [float(arrivals.photons[leg.members].sum()) for leg in some]
        chain = tuple(legs_in_turn(some, strength, std_ps=std))
        new = any(leg in chain for leg in further) and len(chain) <= len(legs) + _MOST_FURTHER
        if new and chain not in chains:
            chains.append(chain)
    return chains


def legs_among(sighting: Sighting, left: Indices, setting: Setting) -> list[ImageLeg]:
    """Legs among some pulses, as the search finds them when it sees these alone, and clusters.

    Parameters
    ----------
    sighting : Sighting
        The recording, on the clock and with its pulses found.
    left : array of int, shape (n,)
        Rows of its arrivals table.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    list of ImageLeg
    """
    searched = _searched(sighting, left, setting)
    # A few pulses beside longer legs may be one, too short for the search.
    members = np.concatenate([leg.members for leg in searched]) if searched else left[:0]
    return [*searched, *_clusters(sighting, np.setdiff1d(left, members), setting)]


def _searched(sighting: Sighting, left: Indices, setting: Setting) -> list[ImageLeg]:
    """Legs that the search in the picture finds when it sees these pulses alone."""
    arrivals = sighting.arrivals
    hidden = np.ones(len(arrivals.flags), dtype=bool)
    # Masked, not removed: rows keep their numbers.
    hidden[left] = False
    masked = arrivals.flags | np.where(hidden, flags.MASKED, 0).astype(arrivals.flags.dtype)
    alone = replace(arrivals, flags=masked)
    try:
        # Beside a corner, its mixed light may bend the times either way.
        return list(search_legs(alone, sighting, setting, None, convex=False))
    except NothingFoundError:
        return []


def _clusters(sighting: Sighting, left: Indices, setting: Setting) -> list[ImageLeg]:
    """Straight legs through pulses that lie together in place and time, few as they may be."""
    if len(left) < _LEAST_PULSES:
        return []
    arrivals = sighting.arrivals
    std = float(np.median(arrivals.std_ps[left]))
    left = left[
        ~on_surfaces(
            arrivals.row[left], arrivals.col[left], arrivals.shape,
            sighting.arrival_ps[left], arrivals.photons[left], std,
        )
    ]  # fmt: skip
    times = sighting.arrival_ps[left]
    points = undistorted_px(setting.camera, arrivals.row[left], arrivals.col[left])
    apart = np.linalg.norm(points[:, np.newaxis] - points, axis=2)
    linked = (apart < _LINK_PX) & (np.abs(times[:, np.newaxis] - times) < _LINK_STDS * std)
    n, label = connected_components(linked, directed=False)
    legs = []
    for k in range(n):
        members = left[label == k]
        if len(members) >= _LEAST_PULSES:
            leg = image_leg(arrivals, members, setting.camera)
            legs.append(replace(leg, view=sighting.view) if sighting.view else leg)
    return [leg for leg in legs if not is_flash(leg, std_ps=std)]


def _opened_once(sightings: list[Sighting], fit: JointFit, setting: Setting) -> JointFit | NoFit:
    """The fit with one corner more, where times and light bend most, or why there is none."""
    n_legs = fit.solution.state.n_legs + 1
    return fit_or_reason(
        lambda: revised(sightings, with_n_legs(sightings, fit, setting, n_legs), setting)
    )


def _fitted(
    sightings: list[Sighting], chain: tuple[ImageLeg, ...], setting: Setting
) -> JointFit | NoFit:
    """The revised joint fit from a chain of legs, or why there is none."""
    return fit_or_reason(
        lambda: revised(sightings, fit_from_legs(sightings, chain, setting, drop=True), setting)
    )
