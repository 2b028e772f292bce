"""Second thoughts on the number of legs, once the whole path has been fitted.

The search in the picture sees legs one by one; a fitted path shows more sharply where one leg
is really two (times and lines bend at one place) and where two are really one (a corner that
turns nothing). Both are decided by likelihood, with thresholds far beyond chance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import GeometryError, NothingFoundError
from lightflight.reconstruct.fit.ends import freedom_at
from lightflight.reconstruct.fit.joint import JointFit, fit_joint, pulse_std_ps, pulses_of_legs
from lightflight.reconstruct.fit.least_squares import Solution, fit_path
from lightflight.reconstruct.fit.start import state_from_legs
from lightflight.reconstruct.fit.through_glass import pieces_of
from lightflight.reconstruct.legs.find import ImageLeg, Images
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.trials.images import state_from_images
from lightflight.reconstruct.trials.outcome import NoFit, fit_or_reason

Floats = NDArray[np.float64]

_MOST_ROUNDS = 6
"""Most changes of the number of legs, one at a time: merge and split must not go in circles."""
_BEND_CHI2 = 50.0
"""A bend this significant (chi-square of one number) makes a second leg worth trying."""
_GAIN_CHI2 = 40.0
"""A further leg must lower chi-square by this much beyond its parameters' worth."""
_DOUBTFUL_GAINS = 10.0
"""A corner worth more than this many times that on the same pulses is one: no refit is asked."""
_LARGE_FLOOR = 0.2
"""Scatter of the times beyond their errors that asks for a reason, in stds of a pulse."""
_THINNED_UP_TO_PULSES = 5
"""A leg that no more pulses than this speak for must earn its place."""
_MOST_THINNED = 3
"""So many such legs are taken out at once at most."""
_DIM = 0.25
"""Of the brightest leg's light per pixel: a reflection or a second pulse mostly holds a tenth, a
leg behind mirrors half and more."""
_LEAST_TURN_DEG = 2.5
"""Corners that turn less are model error or curvature, not mirrors."""
_CLEAR_TURN_DEG = 12.0
"""Corners that turn more are no error of the model, but may be chance."""
_SURE_TURN_DEG = 45.0
"""Corners that turn more part lines which no chance makes one."""
_CHANCE_CHI2 = 14.0
"""What three numbers more, those of a corner, win by chance in one path of 300."""


def fit_from_legs(
    sightings: list[Sighting],
    legs: tuple[ImageLeg, ...],
    setting: Setting,
    *,
    drop: bool,
) -> JointFit:
    """Joint fit from legs in the picture; with `drop`, without those that fit in no chain.

    The weakest leg goes first: a ghost or the mixed light about a corner is seen by few pixels.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    legs : tuple of ImageLeg
        Legs as found in the picture, in the order of flight.
    setting : Setting
        Camera, source, medium and waypoints.
    drop : bool
        Try again without the weakest leg where a chain makes no path.

    Returns
    -------
    JointFit
        Of the longest chain that makes one.

    Raises
    ------
    GeometryError, NothingFoundError
        As the first attempt did, where no subset of the legs makes a path.
    """
    first_problem: Exception | None = None
    while legs:
        try:
            state, seen = _begun(sightings, legs, setting)
            return fit_joint(sightings, state, setting, legs=seen)
        except (GeometryError, NothingFoundError, np.linalg.LinAlgError) as problem:
            # The first attempt had all legs: its reason is the one worth telling.
            first_problem = first_problem or problem
            if not drop or len(legs) == 1:
                break
            weakest = min(range(len(legs)), key=lambda k: legs[k].n_pixels)
            # A leg of so many pixels is no ghost: that it fits in no chain must be told.
            if legs[weakest].n_pixels > 8:
                break
            legs = legs[:weakest] + legs[weakest + 1 :]
    assert first_problem is not None
    if isinstance(first_problem, np.linalg.LinAlgError):
        raise GeometryError(
            "the legs found make no path that can be computed: give n_legs, a starting path, or "
            "mask the pixels that do not belong to the flight"
        ) from first_problem
    raise first_problem


def _begun(
    sightings: list[Sighting], legs: tuple[ImageLeg, ...], setting: Setting
) -> tuple[PathState, Sequence[Images]]:
    """A first path from legs in the pictures, and of each leg its images.

    Where glass stands in the beam only the first picture is searched, its legs cut at the glass.
    """
    camera, source, medium = setting.camera, setting.source, setting.medium
    if setting.others and not medium.blocks:
        return state_from_images(legs, setting, std_ps=pulse_std_ps(sightings))
    legs = tuple(leg for leg in legs if leg.view == 0)
    if not medium.blocks:
        state = state_from_legs(legs, camera=camera, source=source, medium=medium)
        return state, [(leg,) for leg in legs]
    pieces = pieces_of(legs, medium.blocks, camera, sightings[0].arrivals)
    told = tuple(piece for shown in pieces.shown for piece in shown if piece is not None)
    state = state_from_legs(told, camera=camera, source=source, medium=medium, pieces=pieces)
    state, told = pieces.through_glass(state, setting.cameras)
    return state, [(leg,) for leg in told]


def fit_from_brightest(
    sightings: list[Sighting], legs: tuple[ImageLeg, ...], setting: Setting
) -> JointFit | None:
    """Joint fit from the brightest legs that make a path, where all of them make none.

    What a wall, a window or a second pulse shows of the flight runs along lines of its own, as long
    as legs and dimmer: it is left out here, and the verdict says that the path leaves light.

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
        None where not even one leg makes a path.
    """
    order = np.argsort(-_light_of(sightings, legs), kind="stable")
    for n in range(len(legs) - 1, 0, -1):
        chain = tuple(legs[k] for k in sorted(order[:n]))
        fit = fit_or_reason(partial(fit_from_legs, sightings, chain, setting, drop=False))
        if not isinstance(fit, NoFit):
            return fit
    return None


def bright_legs(sightings: list[Sighting], legs: tuple[ImageLeg, ...]) -> tuple[ImageLeg, ...]:
    """Legs that are no reflection's and no second pulse's by their light per pixel.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, with their pulses found.
    legs : tuple of ImageLeg
        Legs as found in the picture.

    Returns
    -------
    tuple of ImageLeg
    """
    light = _light_per_px(sightings, legs)
    least = _DIM * light.max(initial=0.0)
    return tuple(leg for leg, own in zip(legs, light, strict=True) if own > least)


def _light_per_px(sightings: list[Sighting], legs: tuple[ImageLeg, ...]) -> Floats:
    """(n,), photons of each pixel of a leg, on average."""
    per_px: Floats = _light_of(sightings, legs) / [leg.n_pixels for leg in legs]
    return per_px


def _light_of(sightings: list[Sighting], legs: tuple[ImageLeg, ...]) -> Floats:
    """(n,), photons of legs, each in the first recording of the camera that it was found in."""
    seen = {one.view: one.arrivals.photons for one in reversed(sightings)}
    return np.array([seen[leg.view][leg.members].sum() for leg in legs], dtype=np.float64)


def fit_without_dim_legs(
    sightings: list[Sighting], legs: tuple[ImageLeg, ...], setting: Setting
) -> JointFit | None:
    """Joint fit without the legs that are dim beside the brightest, where they may be its image.

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
        None where no leg is dim, or the others make no path. A leg may be dim itself, beside one
        that comes towards the camera: where all dim ones but it are an image, they go alone.
    """
    light = _light_per_px(sightings, legs)
    dimmest = np.argsort(light, kind="stable")
    for n_dim in range(len(legs) - len(bright_legs(sightings, legs)), 0, -1):
        chain = tuple(legs[k] for k in sorted(dimmest[n_dim:]))
        fit = fit_or_reason(partial(fit_from_legs, sightings, chain, setting, drop=False))
        if not isinstance(fit, NoFit):
            return revised(sightings, fit, setting)
    return None


def revised(sightings: list[Sighting], fit: JointFit, setting: Setting) -> JointFit:
    """The fit with as many legs as the data ask for: merged and split until nothing changes.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    fit : JointFit
        The joint fit.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    JointFit
        The fit itself where nothing is to change.
    """
    for _ in range(_MOST_ROUNDS):
        changed = (
            _merged_once(sightings, fit, setting)
            or _thinned_once(sightings, fit, setting)
            or _split_once(sightings, fit, setting)
        )
        if changed is None:
            return fit
        fit = changed
    return fit


def with_n_legs(
    sightings: list[Sighting], fit: JointFit, setting: Setting, n_legs: int
) -> JointFit:
    """The fit with as many legs as the user says, cut where times and light bend most.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    fit : JointFit
        The joint fit.
    setting : Setting
        Camera, source, medium and waypoints.
    n_legs : int
        As many as there must be.

    Returns
    -------
    JointFit
        With at least so many.

    Raises
    ------
    NothingFoundError
        Where no further corner can be placed.
    """
    while fit.solution.state.n_told < n_legs:
        state = fit.solution.state
        bends = [sharpest_bend(sightings, fit, k, setting) for k in range(state.n_legs)]
        trials = (
            _opened(sightings, state, int(k), bends[int(k)][1], setting)
            for k in np.argsort([-chi2 for chi2, _ in bends])
            if bends[int(k)][0] > 0.0
        )
        longer = next((trial for trial in trials if not isinstance(trial, NoFit)), None)
        if longer is None:
            raise NothingFoundError(
                f"n_legs={n_legs} was given but only {state.n_told} show: leave n_legs out, or "
                "give a starting path (start=)"
            )
        fit = longer
    return fit


def _opened(
    sightings: list[Sighting], state: PathState, leg: int, fraction: float, setting: Setting
) -> JointFit | NoFit:
    """Refit with a corner more, at a fraction of a leg, or why there is no such path."""
    if any(told.leg == state.as_told(leg) for told in setting.lengths):
        return NoFit.TOLD
    corner = state.points_mm(leg, np.array([fraction]))[0]
    longer = setting_with_corner(setting, state.as_told(leg))
    return refitted(sightings, state.with_corner(leg, corner), longer)


def refitted(sightings: list[Sighting], state: PathState, setting: Setting) -> JointFit | NoFit:
    """The joint fit from a path with other corners, or why there is none."""
    return fit_or_reason(lambda: fit_joint(sightings, state, setting, legs=None))


def _merged_once(sightings: list[Sighting], fit: JointFit, setting: Setting) -> JointFit | None:
    """The fit without the corner that matters least, where it does not matter."""
    state = fit.solution.state
    trials: list[tuple[float, int, PathState]] = []
    for corner in state.corners_seen:
        # A measured mirror is there.
        turn_deg = state.turn_deg(corner)
        if state.as_told(corner) in setting.told_vertices or turn_deg > _SURE_TURN_DEG:
            continue
        straight = _without_corner(fit, corner, setting)
        if isinstance(straight, NoFit):
            continue
        # Same data, same floor: only the corner differs.
        loss = _total_cost(straight, fit) - _total_cost(fit.solution, fit)
        if turn_deg < _CLEAR_TURN_DEG or loss < _CHANCE_CHI2:
            trials.append((loss, corner, straight.state))
    for loss, corner, straight_state in sorted(trials, key=lambda trial: trial[0]):
        needless = loss < _GAIN_CHI2 or state.turn_deg(corner) < _LEAST_TURN_DEG
        if not needless and loss > _DOUBTFUL_GAINS * _GAIN_CHI2:
            return None
        merged = refitted(sightings, straight_state, setting)
        if not isinstance(merged, NoFit) and (needless or not _gains(merged, fit)):
            return merged
    return None


def _gains(shorter: JointFit, longer: JointFit) -> bool:
    """Whether a path with a corner more explains the light far better than one without."""
    return _worth(shorter, longer) > _GAIN_CHI2 or longer.floor_ps < 0.6 * shorter.floor_ps


def _worth(shorter: JointFit, longer: JointFit) -> float:
    """Chi-square that a path with more corners wins; pulses that one alone takes, one each.

    What pulses cost that fall out of the longer path is no gain: on a recording that scatters more
    than its errors say a path with a corner anywhere would win by whatever it drops.
    """
    before, after = (one.solution.chi2 + one.kinks_chi2 for one in (shorter, longer))
    taken = set(_pulses(longer))
    lost = np.array([pulse not in taken for pulse in _pulses(shorter)])
    times = shorter.times
    cost = times.weights(shorter.floor_ps**2) * shorter.solution.residual_ps**2
    more = np.count_nonzero(longer.times.weight > 0) - np.count_nonzero(times.weight > 0)
    return float(before - cost[lost].sum() - after + more)


def _pulses(fit: JointFit) -> Iterator[tuple[int, int]]:
    """Of which recording each pulse of a path is, and which of its pulses."""
    return zip(fit.sighting_of.tolist(), fit.times.index.tolist(), strict=True)


def _thinned_once(sightings: list[Sighting], fit: JointFit, setting: Setting) -> JointFit | None:
    """The fit without legs that hardly any pulse speaks for, where the rest then fits as well."""
    state = fit.solution.state
    used = np.bincount(fit.times.leg[fit.times.weight > 0], minlength=state.n_legs)
    corners = set(state.corners_seen)
    ends_of = [{int(start), k + 1} & corners for k, start in enumerate(state.leg_starts)]
    last = state.n_legs - 1
    may_end = not state.forks and last > 0 and last - 1 not in state.unseen
    if may_end and _is_dim(sightings, fit, last):
        # Light stops at the corner, and what lies behind it are pulses of no leg. Behind a way that
        # nobody saw there is no corner where it would.
        ends_of[last] = ends_of[last] | {state.n_legs}
    weak = [int(k) for k in np.argsort(used) if used[k] <= _THINNED_UP_TO_PULSES and ends_of[k]]
    trials: list[tuple[int, ...]] = [(k,) for k in weak]
    if len(weak) > 1:
        # All of them: with one of two gone, the other may leave no path.
        trials.append(tuple(weak[:_MOST_THINNED]))
    for some in trials:
        for vertices in product(*(ends_of[k] for k in some)):
            if len(set(vertices)) < len(some):
                continue
            trial = refitted(sightings, state.without(vertices), setting)
            if not isinstance(trial, NoFit) and _fits_as_well(trial, fit):
                return trial
    return None


def _is_dim(sightings: list[Sighting], fit: JointFit, leg: int) -> bool:
    """Whether no pulse of a leg is nearly as bright as those of the others usually are."""
    used = fit.times.weight > 0
    photons = np.zeros(len(used))
    for number, sighting in enumerate(sightings):
        here = fit.sighting_of == number
        photons[here] = sighting.arrivals.photons[fit.times.index[here]]
    own = used & (fit.times.leg == leg)
    usual = float(np.median(photons[used & ~own])) if (used & ~own).any() else 0.0
    return bool(own.any() and photons[own].max() < _DIM * usual)


def _fits_as_well(trial: JointFit, fit: JointFit) -> bool:
    """Whether a path with fewer legs explains as much of the light, about as well."""
    kept, used = (int((one.times.weight > 0).sum()) for one in (trial, fit))
    # A path that explains less light fits better for nothing.
    return kept >= used - _THINNED_UP_TO_PULSES and trial.solution.chi2 / max(kept, 1) < 1.5 * max(
        1.0, fit.solution.chi2 / max(used, 1)
    )


def setting_with_corner(setting: Setting, leg: int) -> Setting:
    """The setting of a path with one more corner on a leg: what lies behind counts one more."""
    waypoints = tuple((i + (i > leg), p, s) for i, p, s in setting.waypoints)
    lengths = tuple(told._replace(leg=told.leg + (told.leg > leg)) for told in setting.lengths)
    return replace(setting, waypoints=waypoints, lengths=lengths)


def setting_without(setting: Setting, corners: Sequence[int]) -> Setting:
    """The setting of a path without some corners: what is told names vertices and legs."""
    waypoints = tuple((i - sum(k < i for k in corners), p, s) for i, p, s in setting.waypoints)
    lengths = tuple(
        told._replace(leg=told.leg - sum(k <= told.leg for k in corners))
        for told in setting.lengths
    )
    return replace(setting, waypoints=waypoints, lengths=lengths)


def _without_corner(fit: JointFit, corner: int, setting: Setting) -> Solution | NoFit:
    """Fit of the same data with two legs taken as one."""
    state = fit.solution.state
    shifted = replace(fit.times, leg=fit.times.leg - (fit.times.leg >= corner))
    lines = replace(fit.lines, leg=fit.lines.leg - (fit.lines.leg >= corner))
    merged = state.without((corner,))
    narrowed = setting_without(setting, (state.as_told(corner),))
    try:
        return fit_path(
            merged,
            shifted,
            lines,
            freedom_at(merged, narrowed),
            setting,
            floor_var=fit.floor_ps**2,
        )
    except np.linalg.LinAlgError:
        return NoFit.SINGULAR


def _total_cost(solution: Solution, fit: JointFit) -> float:
    """Chi-square of times and lines; one wild pixel counts at most as a five-sigma one."""
    std = np.sqrt(fit.times.photon_var + fit.times.pixel_var + fit.floor_ps**2)
    scaled = np.minimum((solution.residual_ps / std) ** 2, 25.0)
    return float(scaled.sum() + solution.line_chi2)


def _split_once(sightings: list[Sighting], fit: JointFit, setting: Setting) -> JointFit | None:
    """The fit with one leg cut where times and light bend most, where that explains far more."""
    state = fit.solution.state
    bends = [sharpest_bend(sightings, fit, k, setting) for k in range(state.n_legs)]
    order = np.argsort([-chi2 for chi2, _ in bends])
    for k in order:
        chi2, fraction = bends[int(k)]
        if chi2 < _BEND_CHI2:
            return None
        trial = _opened(sightings, state, int(k), fraction, setting)
        if isinstance(trial, NoFit):
            continue
        if trial.solution.state.turn_deg(int(k) + 1) < _LEAST_TURN_DEG:
            continue
        # A corner behind which no pulse is left explains nothing: they fell out, and the leg is
        # anywhere.
        if not pulses_of_legs(trial).all():
            continue
        if _worth(fit, trial) > _GAIN_CHI2 and trial.floor_ps <= fit.floor_ps + 1e-9:
            return trial
        # Scatter that a corner explains was never the clock's.
        if trial.floor_ps < 0.6 * fit.floor_ps:
            return trial
    return None


def sharpest_bend(
    sightings: list[Sighting], fit: JointFit, leg: int, setting: Setting
) -> tuple[float, float]:
    """(chi-square, fraction of the leg) of the most significant kink in times and lines.

    A score test: what cannot be seen by a kink, no further corner or shape explains. The camera
    that sees it best tells.
    """
    views = range(len(setting.cameras))
    return max(_sharpest_in_view(sightings, fit, leg, setting.at(view), view) for view in views)


def _sharpest_in_view(
    sightings: list[Sighting], fit: JointFit, leg: int, setting: Setting, view: int
) -> tuple[float, float]:
    """The same as one camera sees it."""
    times, solution = fit.times, fit.solution
    mine = (times.leg == leg) & (times.view == view)
    here = np.flatnonzero(mine & (times.weight > 0))
    if len(here) < 6:
        return 0.0, 0.5
    picture = fit.pictures[next(k for k, o in enumerate(sightings) if o.view == view)]
    line, line_fit = picture.legs[leg], picture.fits[leg]
    points = undistorted_px(setting.camera, times.row, times.col)
    along = line.along_across(points)[0]
    low, high = np.quantile(along[here], [0.05, 0.95])
    # Two halves of less than three pixels have no slope of their own.
    if high - low < 6.0:
        return 0.0, 0.5
    # Scatter as large as this is a bend not yet seen rather than a clock's: it must not hide it.
    floor_ps = fit.floor_ps if fit.floor_ps < _LARGE_FLOOR * pulse_std_ps(sightings) else 0.0
    weight = times.weights(floor_ps**2)
    precision = np.linalg.pinv(solution.covariance, hermitian=True)
    best, place = 0.0, 0.5 * (low + high)
    # A kink nearer than two pixels to the end cannot be told from one pixel's error.
    for at in np.arange(low + 2.0, high - 1.9, 1.0):
        hinge = np.where(mine, np.maximum(along - at, 0.0), 0.0)
        # What the fit's own freedom takes up of the hinge is no bend.
        response = solution.photon_gain @ hinge
        own = float(hinge @ (weight * hinge) - response @ precision @ response)
        score = float(hinge @ (weight * solution.residual_ps))
        in_time = score**2 / own if own > 1e-9 * float(hinge @ (weight * hinge)) else 0.0
        total = in_time
        if len(line_fit.bend_places_px):
            total += float(np.interp(at, line_fit.bend_places_px, line_fit.bend_chi2_at))
        if total > best:
            best, place = total, float(at)
    print_ = footprints(
        solution.state,
        camera=setting.camera,
        medium=setting.medium,
        legs=times.leg[here],
        rows=times.row[here],
        cols=times.col[here],
    )
    order = np.argsort(along[here])
    fraction = float(np.interp(place, along[here][order], print_.fraction[order]))
    return best, float(np.clip(fraction, 0.02, 0.98))
