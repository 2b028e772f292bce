"""The search behind `legs.find_legs`: plain arrays in and out.

A candidate is a line through two pulses and a parabola of the arrival time through three; the
candidate on which the most distinct pixel positions agree wins and is refined. Two legs that
meet at a small angle may come out as one: `revise` parts them once the path is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lightflight.reconstruct.model.image_plane import along_across
from lightflight.units import std_from_mad

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

_MEMBER_PX = 1.7
"""Pulses this near to a leg's line carry its place and times, px."""
_BLOCK_NUMBERS = 1_000_000
"""Numbers in one array of lines by pulses."""


@dataclass(frozen=True)
class SearchSettings:
    """Tolerances of the search.

    Attributes
    ----------
    min_pixels : int
        Distinct pixel positions a leg needs.
    time_floor : float
        Times within this of a candidate agree with it whatever their stated error, ps.
    lateral_px : float
        A ridge pulse this near to a candidate's line counts for it, px.
    ridge_ratio : float
        A pulse that a neighbour outshines this much at the same time is a wing, not the ridge.
    halo_px : float
        A pulse this near, at the right time, is the leg's light and founds no other leg, px.
    n_pairs : int
        Lines tried per leg.
    n_parabolas : int
        Parabolas tried per line.
    max_gap_px : float
        A leg may be dark for this long in the picture, px; a longer gap ends it.
    convex : bool
        Straight light in one medium bends its arrival curve upwards: refuse the opposite.
    winged : bool
        The spot of the light has wings, as in a computed cube.
    seed : int
        Of the random draws.
    """

    min_pixels: int = 4
    time_floor: float = 25.0
    lateral_px: float = 0.85
    ridge_ratio: float = 3.0
    halo_px: float = 2.6
    n_pairs: int = 400
    n_parabolas: int = 16
    max_gap_px: float = 8.0
    convex: bool = True
    winged: bool = False
    seed: int = 0


def time_tolerance(errors: Floats, settings: SearchSettings) -> Floats:
    """How far a pulse's time may be from a candidate's, (n,), ps.

    A dim pulse whose error exceeds a pulse's own width must not join whatever it likes.
    """
    return np.hypot(np.minimum(4.0 * errors, 2.0 * settings.time_floor), settings.time_floor)


def fitted_line(points: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Total least squares line: (centre (2,), unit direction (2,)), px.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Undistorted (u, v) in the picture, px.
    weights : array of float, shape (n,)
        Photons of the pulses.

    Returns
    -------
    centre : array of float, shape (2,)
        px.
    direction : array of float, shape (2,)
        Unit.
    """
    w = weights / weights.sum()
    # Photon counts span decades; their square root keeps a few bright pixels from ruling.
    centre = w @ points
    offset = points - centre
    _, _, axes = np.linalg.svd(offset * np.sqrt(w)[:, np.newaxis], full_matrices=False)
    return centre, axes[0]


def fitted_times(s: Floats, times: Floats, errors: Floats) -> Floats:
    """Polynomial of the arrival time along a leg, degree 1 to 3 by how much there is to fit.

    Parameters
    ----------
    s : array of float, shape (n,)
        Places along the leg, px.
    times : array of float, shape (n,)
        Arrival times, ps.
    errors : array of float, shape (n,)
        One-sigma errors of the times, ps.

    Returns
    -------
    array of float, shape (degree + 1,)
        Lowest power first, ps per px^k.
    """
    distinct = distinct_positions(s)
    degree = int(np.clip(distinct // 3, 1, 3))
    scale = max(float(np.abs(s).max()), 1e-9)
    design = polynomial.polyvander(s / scale, degree)
    weight = 1.0 / np.maximum(errors, np.median(errors) * 0.1 + 1e-12)
    keep = np.ones(len(s), dtype=bool)
    coefficients: Floats = np.zeros(degree + 1)
    for _ in range(4):
        rows = design[keep] * weight[keep, np.newaxis]
        coefficients = np.asarray(
            np.linalg.lstsq(rows, times[keep] * weight[keep], rcond=None)[0], dtype=np.float64
        )
        residual = np.abs(times - design @ coefficients)
        spread = std_from_mad(float(np.median(residual[keep]))) + 1e-12
        # The larger of both: neither a lucky scatter nor a small stated error throws pulses out.
        trimmed = residual < 5.0 * np.maximum(spread, errors)
        if trimmed.sum() <= degree + 1 or np.array_equal(trimmed, keep):
            break
        keep = trimmed
    return coefficients / scale ** np.arange(degree + 1)


def distinct_positions(s: Floats) -> int:
    """How many pixel positions along a line the places `s` (n,), px, make up."""
    # Counted from the first: about a centre, whole pixels lie at halves, and halves round to even.
    return int(np.count_nonzero(np.bincount(np.rint(s - s.min()).astype(np.intp)))) if len(s) else 0


def _longest_run(s: Floats, inside: NDArray[np.bool_], max_gap: float) -> NDArray[np.bool_]:
    """Keep of `inside` the run along s with the most positions that no gap interrupts."""
    order = np.flatnonzero(inside)[np.argsort(s[inside], kind="stable")]
    if len(order) < 2:
        return inside
    breaks = np.flatnonzero(np.diff(s[order]) > max_gap)
    runs = np.split(order, breaks + 1)
    best = max(runs, key=lambda run: distinct_positions(s[run]))
    kept = np.zeros(len(s), dtype=bool)
    kept[best] = True
    return kept


def _slope_keeps_sign(coefficients: Floats, low: float, high: float) -> bool:
    """True where the parabola's slope does not change sign within [low, high]."""
    first = coefficients[1] + 2 * coefficients[2] * low
    last = coefficients[1] + 2 * coefficients[2] * high
    return bool(first * last > 0)


def ridge_pulses(
    points: Floats, times: Floats, weights: Floats, settings: SearchSettings
) -> NDArray[np.bool_]:
    """True for pulses that no neighbour (1.6 px, same time) outshines: they run along the legs.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Undistorted (u, v) in the picture, px.
    times : array of float, shape (n,)
        Arrival times, ps.
    weights : array of float, shape (n,)
        Photons of the pulses.
    settings : SearchSettings
        Tolerances of the search.

    Returns
    -------
    array of bool, shape (n,)
    """
    tree = cKDTree(points)
    pairs = tree.query_pairs(1.6, output_type="ndarray")
    ridge = np.ones(len(points), dtype=bool)
    if len(pairs):
        a, b = pairs.T
        together = np.abs(times[a] - times[b]) < 4.0 * settings.time_floor
        ridge[a[together & (weights[b] > settings.ridge_ratio * weights[a])]] = False
        ridge[b[together & (weights[a] > settings.ridge_ratio * weights[b])]] = False
    return ridge


def best_line(
    points: Floats, times: Floats, errors: Floats, weights: Floats, settings: SearchSettings
) -> NDArray[np.bool_] | None:
    """Members (n,) of the candidate with the most distinct pixel positions; None: none is enough.

    Only ridge pulses vote: the wings of a bright spot are as wide as a small bend.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Undistorted (u, v) in the picture, px.
    times : array of float, shape (n,)
        Arrival times, ps.
    errors : array of float, shape (n,)
        One-sigma errors of the times, ps.
    weights : array of float, shape (n,)
        Photons of the pulses.
    settings : SearchSettings
        Tolerances of the search.

    Returns
    -------
    array of bool, shape (n,) or None
        None where no candidate is enough.
    """
    ridge = np.flatnonzero(ridge_pulses(points, times, weights, settings))
    if len(ridge) < settings.min_pixels:
        return None
    found = _best_line_of_ridge(points[ridge], times[ridge], errors[ridge], settings)
    if found is None:
        return None
    members = np.zeros(len(points), dtype=bool)
    members[ridge[found]] = True
    return members


def _best_line_of_ridge(
    points: Floats, times: Floats, errors: Floats, settings: SearchSettings
) -> NDArray[np.bool_] | None:
    rng = np.random.default_rng(settings.seed)
    tolerance = time_tolerance(errors, settings)
    pairs = _pairs(points, settings, rng)
    # What lies on a line bounds from above what lies on line and parabola together.
    most = _positions_on_lines(points, pairs, settings.lateral_px)
    best_score, best_members = settings.min_pixels - 0.5, None
    # Lines with the most positions first: times can only take some away.
    for k in np.argsort(-most, kind="stable"):
        if most[k] <= best_score:
            break
        i, j = pairs[k]
        s, near = _along_line(points, i, j, settings.lateral_px)
        score, members = _best_parabola(
            s, times, tolerance, near, (i, j), settings, rng, best_score
        )
        if members is not None and score > best_score:
            best_score, best_members = score, members
    return best_members


def _pairs(points: Floats, settings: SearchSettings, rng: np.random.Generator) -> Indices:
    """Pairs (k, 2) of pulses 2 to 16 px apart, drawn evenly over the pulses."""
    first = rng.integers(len(points), size=settings.n_pairs)
    # Near pairs find short legs, far ones fix the direction of long ones.
    reach = np.array([5.0, 9.0, 16.0])[np.arange(settings.n_pairs) % 3]
    second = np.full(settings.n_pairs, -1)
    for some in _blocks(settings.n_pairs, len(points)):
        offset = points[np.newaxis] - points[first[some], np.newaxis]
        distance = np.hypot(offset[..., 0], offset[..., 1])
        ring = (distance > 1.9) & (distance < reach[some, np.newaxis])
        count = np.cumsum(ring, axis=1)
        wanted = 1 + (rng.random(len(count)) * count[:, -1]).astype(np.intp)
        # The first place where so many have been passed; a ring without any has none.
        found = np.argmax(count >= wanted[:, np.newaxis], axis=1)
        second[some] = np.where(count[:, -1] > 0, found, -1)
    drawn = second >= 0
    return np.column_stack((first[drawn], second[drawn]))


def _blocks(n_rows: int, row_length: int) -> list[slice]:
    """Rows in pieces whose (rows, row_length) arrays stay small."""
    step = max(1, _BLOCK_NUMBERS // max(row_length, 1))
    return [slice(k, min(k + step, n_rows)) for k in range(0, n_rows, step)]


def _positions_on_lines(points: Floats, pairs: Indices, lateral_px: float) -> Indices:
    """How many distinct positions lie on the line through each pair; (k,)."""
    most = np.zeros(len(pairs), dtype=np.intp)
    for some in _blocks(len(pairs), len(points)):
        start, end = points[pairs[some, 0]], points[pairs[some, 1]]
        direction = (end - start) / np.linalg.norm(end - start, axis=1)[:, np.newaxis]
        normal = np.column_stack((direction[:, 1], -direction[:, 0]))
        near = np.abs(normal @ points.T - np.sum(normal * start, axis=1)[:, np.newaxis])
        line, point = np.nonzero(near < lateral_px)
        s = np.sum(points[point] * direction[line], axis=1)
        lowest = np.full(len(start), np.inf)
        np.minimum.at(lowest, line, s)
        place = np.rint(s - lowest[line]).astype(np.intp)
        seen = np.zeros((len(start), place.max(initial=0) + 1), dtype=bool)
        seen[line, place] = True
        most[some] = seen.sum(axis=1)
    return most


def _along_line(points: Floats, i: int, j: int, lateral_px: float) -> tuple[Floats, Indices]:
    """Position of all points along the line from i to j, and which lie on it."""
    direction = (points[j] - points[i]) / float(np.hypot(*(points[j] - points[i])))
    s, across = along_across(points, points[i], direction)
    return s, np.flatnonzero(np.abs(across) < lateral_px)


def _best_parabola(
    s: Floats,
    times: Floats,
    tolerance: Floats,
    near: NDArray[np.intp],
    pair: tuple[int, int],
    settings: SearchSettings,
    rng: np.random.Generator,
    best_score: float,
) -> tuple[float, NDArray[np.bool_] | None]:
    """Best parabola of the time through the pair and a third pulse on their line."""
    i, j = pair
    # A third place of its own: three pulses of two places do not fix a parabola.
    third = near[(np.abs(s[near] - s[i]) > 1.0) & (np.abs(s[near] - s[j]) > 1.0)]
    if not len(third):
        return 0.0, None
    chosen = rng.choice(third, size=min(settings.n_parabolas, len(third)), replace=False)
    sn, tn, tol = s[near], times[near], tolerance[near]
    slope_ij = (times[j] - times[i]) / (s[j] - s[i])
    members_best, score_best = None, best_score
    for k in chosen:
        # Newton's divided differences through i, j, k.
        slope_jk = (times[k] - times[j]) / (s[k] - s[j])
        bend = (slope_jk - slope_ij) / (s[k] - s[i])
        model = times[i] + (sn - s[i]) * (slope_ij + bend * (sn - s[j]))
        inside = np.abs(tn - model) < tol
        # Distinct positions are no more than pulses: most parabolas end here, cheaply.
        if inside.sum() <= score_best:
            continue
        kept = _longest_run(sn, inside, settings.max_gap_px)
        score = distinct_positions(sn[kept])
        if score <= score_best:
            continue
        slope = np.array([0.0, slope_ij - bend * (s[i] + s[j]), bend])
        if not _slope_keeps_sign(slope, float(sn[kept].min()), float(sn[kept].max())):
            continue
        if settings.convex and bends_down(sn[kept], tn[kept], tol[kept]):
            continue
        members = np.zeros(len(s), dtype=bool)
        members[near[kept]] = True
        members_best, score_best = members, score
    return (float(score_best), members_best) if members_best is not None else (0.0, None)


def bends_down(s: Floats, times: Floats, tolerance: Floats) -> bool:
    """True where the times bend the way no straight light does, beyond chance.

    Two legs that lie in one line of the picture and meet at a kink look like this. In the plane
    of the picture (rather than by viewing angle) even straight light may bend down by one or
    two percent of its slope per pixel.
    """
    if distinct_positions(s) < 8:
        return False
    middle = s.mean()
    design = polynomial.polyvander(s - middle, 2)
    weight = 1.0 / tolerance
    rows = design * weight[:, np.newaxis]
    normal = rows.T @ rows
    coefficients = np.linalg.solve(normal, rows.T @ (times * weight))
    residual = (times - design @ coefficients) * weight
    scatter = float(residual @ residual) / max(1, len(s) - 3)
    error = np.sqrt(np.linalg.inv(normal)[2, 2] * scatter)
    return bool(coefficients[2] < -0.01 * abs(coefficients[1]) - 4.0 * error)


def refine_members(
    points: Floats,
    times: Floats,
    errors: Floats,
    weights: Floats,
    members: NDArray[np.bool_],
    settings: SearchSettings,
) -> tuple[Indices, NDArray[np.bool_]]:
    """Refit line and times to the members, collect again; (member indices, halo mask (n,)).

    The halo is every pulse that is this leg's light, faint wings of the spot included.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        Undistorted (u, v) in the picture, px.
    times : array of float, shape (n,)
        Arrival times, ps.
    errors : array of float, shape (n,)
        One-sigma errors of the times, ps.
    weights : array of float, shape (n,)
        Photons of the pulses.
    members : array of bool, shape (n,)
        True for the pulses of a candidate.
    settings : SearchSettings
        Tolerances of the search.

    Returns
    -------
    members : array of int, shape (k,)
        Rows that carry the leg's line and times; empty: too few are left.
    halo : array of bool, shape (n,)
        True for all of its light, which founds no other leg.
    """
    tolerance = time_tolerance(errors, settings)
    ridge = ridge_pulses(points, times, weights, settings)
    current = members
    halo = members
    for _ in range(4):
        if current.sum() < 3:
            break
        origin, direction = fitted_line(points[current], weights[current])
        s, across = along_across(points, origin, direction)
        lateral = np.abs(across)
        coefficients = fitted_times(s[current], times[current], errors[current])
        low, high = s[current].min(), s[current].max()
        # A computed cube's spot is several pixels wide: its gates widen with it.
        spot = _spot_width(
            s, lateral, times, coefficients, tolerance, weights, (low, high), settings
        )
        member_px = max(_MEMBER_PX, 2.5 * spot)
        timely = np.abs(times - polynomial.polyval(s, coefficients)) < tolerance
        in_reach = (s > low - settings.max_gap_px) & (s < high + settings.max_gap_px)
        within = (s > low - 1.5) & (s < high + 1.5)
        # Beyond its ends a leg claims only what runs on along its line: a corner may be there.
        own = timely & in_reach & (lateral < np.where(within, member_px, settings.lateral_px))
        own &= ridge | within
        halo_px = max(settings.halo_px, 3.5 * spot)
        halo = own | (timely & within & ~ridge & (lateral < halo_px))
        updated = _longest_run(s, own, settings.max_gap_px)
        if np.array_equal(updated, current):
            break
        current = updated
    if distinct_positions(s[current]) < settings.min_pixels:
        return np.empty(0, dtype=np.int64), halo | members
    return np.flatnonzero(current), halo | members


def _spot_width(
    s: Floats,
    lateral: Floats,
    times: Floats,
    coefficients: Floats,
    tolerance: Floats,
    weights: Floats,
    span: tuple[float, float],
    settings: SearchSettings,
) -> float:
    """Light-weighted distance from a leg's line of what arrives with it, one sigma, px.

    A real camera's spot is narrower than a pixel; that of a computed cube is several wide and has
    wings. By the median where there are none: a leg that comes in at a corner must not make the
    spot of this one wider.
    """
    about = (lateral < 6.0) & (s > span[0]) & (s < span[1])
    about &= np.abs(times - polynomial.polyval(s, coefficients)) < 2.0 * tolerance
    if not about.any():
        return 0.0
    if settings.winged:
        return float(np.sqrt(np.average(lateral[about] ** 2, weights=weights[about])))
    order = np.argsort(lateral[about])
    light = np.cumsum(weights[about][order])
    middle = int(np.searchsorted(light, 0.5 * light[-1]))
    return std_from_mad(float(lateral[about][order][middle]))
