"""A first path along curves that are told: where they run in view, when light runs there, how fast.

No leg is looked for in the picture: the curves say where the light is.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from lightflight.curves import FEWEST_POINTS, DrawnCurve
from lightflight.errors import GeometryError, NothingFoundError
from lightflight.flight import Source
from lightflight.path.bends import MOST_ORDERS, Bend, shapes_at
from lightflight.reconstruct.fit.bent import axes_across
from lightflight.reconstruct.fit.membership import prints_of_leg
from lightflight.reconstruct.model.drawn import course_on, told_of_curve
from lightflight.reconstruct.model.freedom import sagitta_std_mm
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import MEDIUM, SharedErrors, shared_errors
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.units import MEDIAN_CHI2, SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_REACH_PX = 1.5
"""A pulse this near to a told curve in the picture is taken for its light, px: a curve that is off
by more lies beside it."""
_FEWEST_PULSES = 6
"""That say when light runs along a curve, and how fast."""
_FALSE_REFUSAL = 1e-6
"""Chance that places are refused which scatter about a smooth curve by their stated errors."""
_MOST_ROUNDS = 30
"""Of the robust line through times along a curve."""
_CUT = 4.0
"""Robust standard deviations from that line beyond which a pulse is another light's."""


def begun_along(sightings: list[Sighting], setting: Setting) -> tuple[PathState, Floats]:
    """A first path along the told curves, and shared errors that its times ask for.

    Parameters
    ----------
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        With a curve for every leg.

    Returns
    -------
    state : PathState
        Its start time is that of the pulses.
    shared : array of float, shape (j,)
        Of cameras and medium, in standard deviations: zero but for the index.

    Raises
    ------
    GeometryError
        Where a curve is not in view, is no smooth leg, or light runs the other way.
    NothingFoundError
        Where too few pulses lie on them.
    """
    laid = [_laid(curve, setting.camera, setting.source) for curve in setting.curves]
    ends = [0.5 * (one[1] + other[0]) for one, other in pairwise(laid)]
    vertices = np.array([laid[0][0], *ends, laid[-1][1]])
    state = PathState(vertices, 0.0, bends=tuple(bend for _, _, bend in laid))
    return _timed(state, sightings, setting)


def with_curves(state: PathState, setting: Setting) -> PathState:
    """The path with the curves that are told of its legs, between the ends that it has."""
    if any(curve.leg >= state.n_legs for curve in setting.curves):
        raise ValueError(
            f"curves are told of legs {[c.leg for c in setting.curves]}, and the starting path has "
            f"{state.n_legs}"
        )
    told = {c.leg: _laid(c, setting.camera, setting.source)[2] for c in setting.curves}
    kept = [bend for bend in state.bends if bend.leg not in told]
    bends = sorted((*kept, *told.values()), key=lambda bend: bend.leg)
    return replace(state, bends=tuple(bends))


def _laid(curve: DrawnCurve, camera: Camera, source: Source) -> tuple[Floats, Floats, Bend]:
    """Ends (3,), mm, and the bend of a leg through the places of a curve that are in view.

    With all shapes that there are: what places do not tell, a prior holds, and the times of the
    light know of shapes that no single place shows.
    """
    places = _places_in_view(curve, camera, source)
    start, end = places[0], places[-1]
    step = end - start
    fraction = (places - start) @ step / float(step @ step)
    if not (np.diff(fraction) > 0.0).all():
        raise GeometryError(
            f"the curve of leg {curve.leg + 1} turns back on itself in view: cut it into several "
            "legs, each a curve that turns by less than a right angle or so"
        )
    axes = axes_across(start, end, camera)
    off = (places - start - np.outer(fraction, step)) @ axes.T
    columns = np.column_stack((1.0 - fraction, fraction, shapes_at(fraction, MOST_ORDERS)))
    # Held as they will be in the fit, so that few places tell of them, too.
    hold = [0.0, 0.0, *(1.0 / sagitta_std_mm(k + 1) for k in range(MOST_ORDERS))]
    wide = np.vstack((columns / curve.point_std_mm, np.diag(hold)))
    aims = np.vstack((off / curve.point_std_mm, np.zeros((len(hold), 2))))
    fitted = np.linalg.lstsq(wide, aims, rcond=None)[0]
    dof = max(0, off.size - fitted.size)
    chi2 = float(np.sum((off - columns @ fitted) ** 2)) / curve.point_std_mm**2
    if dof and chdtrc(dof, chi2) < _FALSE_REFUSAL:
        raise GeometryError(
            f"the places of the curve of leg {curve.leg + 1} scatter by "
            f"{np.sqrt(chi2 / dof):.2g} times their point_std_mm about any leg of at most "
            f"{MOST_ORDERS} shapes: cut it into several legs, or state a larger error"
        )
    return start + fitted[0] @ axes, end + fitted[1] @ axes, Bend(curve.leg, axes, fitted[2:].T)


def _places_in_view(curve: DrawnCurve, camera: Camera, source: Source) -> Floats:
    """(k, 3), places of a curve in view, and one beyond on either side; from a known source on."""
    places = curve.places_mm
    seen = np.flatnonzero(camera.sees(places))
    known = curve.leg == 0 and source.position_mm is not None
    first = 0 if known or not len(seen) else max(0, int(seen[0]) - 1)
    last = int(seen[-1]) + 2 if len(seen) else 0
    if last - first < FEWEST_POINTS:
        raise GeometryError(
            f"{len(seen)} of the {len(places)} places of the curve of leg {curve.leg + 1} are in "
            f"view, and {FEWEST_POINTS} must be, or lie next to it: draw it closer there"
        )
    return places[first:last]


def _timed(
    state: PathState, sightings: list[Sighting], setting: Setting
) -> tuple[PathState, Floats]:
    """The path at the time of its light, and the shared errors of an index that is not exact."""
    errors = shared_errors(setting)
    first = sightings[0]
    rows = first.usable_pulses
    prints = [prints_of_leg(first, state, setting, rows, leg) for leg in state.seen]
    nearest = np.argmin([np.abs(print_.lateral_px) for print_ in prints], axis=0)
    late, back, out = [], [], []
    for leg, print_ in zip(state.seen, prints, strict=True):
        inside = (print_.fraction > 0.0) & (print_.fraction < 1.0)
        own = (nearest == leg) & inside & (np.abs(print_.lateral_px) < _REACH_PX)
        late.append(first.arrival_ps[rows][own] - print_.arrival_ps[own])
        back.append(print_.distance_mm[own])
        way = course_on(state, leg).ways_mm(print_.fraction[own])
        out.append(state.travelled_mm[state.leg_starts[leg]] + way)
    times, away, back_mm = (np.concatenate(parts) for parts in (late, out, back))
    if len(times) < _FEWEST_PULSES:
        raise NothingFoundError(
            f"{len(times)} pulses lie within {_REACH_PX:g} px of the told curves: check their "
            "places and the camera's"
        )
    _refuse_backwards(times, away, setting)
    held = _of_index(errors, away, back_mm)
    start_ps, shared = _robust_line(times, held)
    return replace(state, start_time_ps=start_ps), shared


def _refuse_backwards(times: Floats, away_mm: Floats, setting: Setting) -> None:
    """GeometryError where the light runs from the last place of a curve to the first."""
    ps_per_mm = _robust_line(times, away_mm[:, np.newaxis], free=True)[1][0]
    told = setting.medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS
    # Light of the told index leaves nothing; light that comes back leaves twice its time.
    if ps_per_mm < -told:
        raise GeometryError(
            "light runs along the told curves from their ends to their starts: give the places in "
            "the order of flight"
        )


def _of_index(errors: SharedErrors, away_mm: Floats, back_mm: Floats) -> Floats:
    """(n, j), by how much light is later for a standard deviation of each shared error, ps."""
    columns = np.zeros((len(away_mm), len(errors)))
    own = errors.view == MEDIUM
    ways = np.column_stack((away_mm, back_mm))
    columns[:, own] = ways @ errors.sigma[own, :2].T / SPEED_OF_LIGHT_MM_PER_PS
    return columns


def _robust_line(times: Floats, columns: Floats, *, free: bool = False) -> tuple[float, Floats]:
    """Constant and multiples of columns (n, j) nearest to times (n,); of j unit priors, or `free`.

    Other light's pulses are left out: those far from the line, by what the middle one is.
    """
    wide = np.column_stack((np.ones(len(times)), columns))
    held = np.zeros(wide.shape[1]) if free else np.append(0.0, np.ones(columns.shape[1]))
    found: Floats = np.append(np.median(times), np.zeros(columns.shape[1]))
    for _ in range(_MOST_ROUNDS):
        left = times - wide @ found
        scale = float(np.sqrt(np.median(left**2) / MEDIAN_CHI2)) + 1e-6
        use = np.abs(left) < _CUT * scale
        own, before = wide[use], found
        information = own.T @ own / scale**2 + np.diag(held)
        score = own.T @ times[use] / scale**2
        # Of errors that move nothing there is nothing to find.
        found = np.asarray(np.linalg.lstsq(information, score, rcond=None)[0], dtype=float)
        if np.allclose(found, before, rtol=1e-9, atol=1e-9):
            break
    return float(found[0]), found[1:]


def statements_of_curves(state: PathState, curves: tuple[DrawnCurve, ...]) -> tuple[str, ...]:
    """How far the light runs from the places of told curves, one sentence each."""
    said = []
    for curve in curves:
        told = told_of_curve(state, curve)
        off = told.values - told.rows @ state.vector
        share = float(np.sqrt(np.mean(off**2))) if len(off) else 0.0
        said.append(
            f"Leg {curve.leg + 1} was told to run along a curve: it lies {share:.2g} times as far "
            f"from {len(off) // 2} of its places as their errors say."
        )
    return tuple(said)
