"""Score tests on times and lines: would chi-square fall if something held fixed were freed?

At the joint solution with the stated errors, let r be the whitened residuals, J the derivatives of
the model by all that is free (priors are rows) and C those by a cause's parameters. What the fit
cannot take up of C is C' = C - J J^+ C; freeing the cause lowers chi-square by |U^T r|^2, U an
orthonormal basis of C'. No second fit is needed, and since U is known, so is the correlation of all
tests.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightflight.path.verdict import BlindSpot, FindingName
from lightflight.reconstruct.fit.joint import JointFit, pulse_std_in_view
from lightflight.reconstruct.fit.least_squares import Solution, TimeData, fit_path
from lightflight.reconstruct.fit.membership import mode_columns
from lightflight.reconstruct.model.geometry import (
    Indices,
    footprints,
)
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.verdict.blind import Vertices, farthest
from lightflight.reconstruct.verdict.candidates import (
    LEAST_SIGNAL,
    Candidate,
    Rows,
    drawn_curve_candidate,
    geometry_candidates,
    told_candidate,
)
from lightflight.reconstruct.verdict.evidence import SEEN_AT, Evidence
from lightflight.reconstruct.verdict.freed import STRAIGHT, fit_freed
from lightflight.reconstruct.verdict.glass import block_candidate
from lightflight.reconstruct.verdict.jumps import jump_candidate
from lightflight.reconstruct.verdict.places import seldom

Floats = NDArray[np.float64]

_MATTERS = 1.0
"""Gains need not be known better, in chi-square: causes are named within 9 of the best."""
_RIDGE_PX = 0.7
"""Pulses this near to their leg's line are told of by it; beyond, by the wings of the spot, px.
With 0.9 delays that are 5 ps off are taken for a bent leg, gains of another day as with 0.7."""
_NEIGHBOURS_PX = 5.0
"""Three pulses that span less than this are neighbours, px: what bends a leg is straight there."""
_CLOCKS = 1.0
"""Beyond their errors, neighbours disagree by this share of those, in chi-square, before a clock is
named: nothing wrong gives 0.6 to 1.5 in all, a bent or slowed leg too, 5 ps of delay above 100."""


@dataclass(frozen=True, eq=False)
class Examined:
    """A joint fit with the stated errors, as the tests need it.

    Attributes
    ----------
    residual : array of float
        (N,), whitened.
    span : array of float
        (N, p), orthonormal basis of what the fit can take up.
    gain : array of float
        (p, N): d(free parameters) / d(whitened rows), of those that move the path.
    vertices : Vertices
        What these do to the vertices.
    """

    residual: Floats
    span: Floats
    gain: Floats
    vertices: Vertices

    def left_of(self, columns: Floats) -> Floats:
        """What the fit cannot take up of columns (N, k)."""
        left: Floats = columns - self.span @ (self.span.T @ columns)
        return left


def evidence_from_geometry(
    fit: JointFit, sightings: list[Sighting], setting: Setting
) -> tuple[Evidence, ...]:
    """All that times and lines of a joint fit say of what was held fixed."""
    times, solution = fit.times, stated_solution(fit, setting)
    examined = examined_fit(fit, solution, setting)
    rows = Rows(
        solution.state,
        solution.cameras,
        setting.medium,
        times,
        fit.lines,
        np.sqrt(times.weights(0.0)),
        len(solution.rows),
    )
    counted = _of_pulses(fit, sightings, counted_ps) - solution.residual_ps
    candidates = geometry_candidates(
        rows,
        counted_ps=counted,
        repeat=_repeats(fit, sightings),
        photons=_of_pulses(fit, sightings, lambda one: one.arrivals.photons),
    )
    found = [(candidate, _score_test(candidate, examined)) for candidate in candidates]
    tested = [(candidate, one) for candidate, one in found if one is not None]
    searched = (
        block_candidate(rows, examined.residual, examined.left_of),
        jump_candidate(
            rows,
            examined.residual,
            examined.left_of,
            counted_ps=counted,
            stds_ps=[pulse_std_in_view(sightings, view) for view in range(len(rows.cameras))],
        ),
    )
    places = [(one, _score_test(one, examined)) for one in searched if one is not None]
    tested += [(candidate, seldom(one)) for candidate, one in places if one is not None]
    best = max((one.gain for _, one in tested if not one.symptom), default=0.0)
    weighed = [
        _freed(candidate, one, fit, times, solution, setting)
        if STRAIGHT * best > _MATTERS and one.gain > (1.0 - STRAIGHT) * best and not one.symptom
        else one
        for candidate, one in tested
    ]
    if sum(one is not None for _, one in places) == len(searched):
        weighed[-2:] = _as_good(*weighed[-2:])
    clock = _of_single_pixels(fit, times, solution, sightings)
    # Of priors alone, which a fit with a cause freed in times and lines knows nothing of.
    drawn = drawn_curve_candidate(rows, fit.freedom.curve_moves)
    told = told_candidate(rows, fit.freedom.told)
    asked = (_score_test(one, examined) for one in (drawn, told) if one is not None)
    priors = tuple(one for one in asked if one is not None)
    return (*weighed, *priors, _scatter(fit, times, solution), *clock)


def _as_good(block: Evidence, jump: Evidence) -> tuple[Evidence, Evidence]:
    """Glass in the beam and a clock that jumps there, alike where gains are no better known.

    Along one leg each place has a column, a row and a count of its own: both explain the same.
    """
    best = max(block.gain, jump.gain)
    if min(block.gain, jump.gain) < (1.0 - STRAIGHT) * best:
        return block, jump
    return replace(block, gain=best), replace(jump, gain=best)


def stated_solution(fit: JointFit, setting: Setting) -> Solution:
    """The fit's solution with all errors that are known of, and these alone.

    Not with the error floor, which takes up any misfit.
    """
    if fit.floor_ps == 0.0:
        return fit.solution
    own = fit.solution
    return fit_path(own.state, fit.times, fit.lines, fit.freedom, setting, shared=own.shared)


def examined_fit(fit: JointFit, solution: Solution, setting: Setting) -> Examined:
    """A solution taken apart for the tests."""
    columns = _with_clock_of_model(fit, solution)
    scale = np.sqrt(np.sum(columns**2, axis=0)) + 1e-300
    left, values, right = np.linalg.svd(columns / scale, full_matrices=False)
    kept = values > 1e-9 * values[0]
    n_free = fit.freedom.basis.shape[1]
    gain = ((right[kept].T / values[kept]) @ left[:, kept].T) / scale[:, np.newaxis]
    return Examined(
        residual=solution.rows,
        span=left[:, kept],
        gain=gain[:n_free],
        vertices=Vertices.of(fit, solution, setting.medium),
    )


def _with_clock_of_model(fit: JointFit, solution: Solution) -> Floats:
    """(N, p), the solution's columns, errors of clocks as they are at the times of the model.

    At those that were measured a scale's column holds their noise. Where all else of it is taken up
    (a clock known to 0.7 %, a camera that fixes its scale) that is left, and explains itself.
    """
    columns, first = solution.columns.copy(), fit.freedom.basis.shape[1]
    sqrt_weight, own = np.sqrt(fit.times.weights(0.0)), mode_columns(list(fit.sightings))
    for number, sighting in enumerate(fit.sightings):
        here = np.flatnonzero(fit.sighting_of == number)
        rows, cols = (each[here].astype(np.int64) for each in (fit.times.row, fit.times.col))
        expected = fit.times.arrival_ps[here] - solution.residual_ps[here]
        delay = expected + sighting.timing.skew_ps[rows, cols]
        of_clock = sighting.timing.shared_errors_ps(rows, cols, delay)[0]
        at = first + own[sighting.view].start + np.arange(of_clock.shape[1])
        columns[here[:, np.newaxis], at] = sqrt_weight[here, np.newaxis] * of_clock
    return columns


def _score_test(candidate: Candidate, examined: Examined) -> Evidence | None:
    """The test of one cause; None where its plausible size would leave no trace."""
    left = examined.left_of(candidate.columns)
    basis, signal, mixing = np.linalg.svd(left, full_matrices=False)
    kept = signal > LEAST_SIGNAL
    if not kept.any():
        return None
    basis, signal, mixing = basis[:, kept], signal[kept], mixing[kept]
    z = basis.T @ examined.residual
    # With the plausible size as a prior: what an implausible size costs is no gain.
    shrunk = signal**2 / (1.0 + signal**2)
    sizes = mixing.T @ (z * shrunk / signal)
    chi2, dof = float(z @ z), len(z)
    return Evidence(
        candidate.name,
        chi2,
        dof,
        float(z @ (shrunk * z)) - candidate.columns.shape[1] - candidate.looked_for,
        _sentence(candidate, sizes),
        REMEDIES.get(candidate.name, "look at the residuals along the legs"),
        basis,
        z,
        candidate.symptom,
        () if candidate.symptom else _blind(candidate, signal, mixing, examined),
        frees=candidate.frees,
        need=_need(sizes, dof),
    )


def _freed(
    candidate: Candidate,
    tested: Evidence,
    fit: JointFit,
    times: TimeData,
    solution: Solution,
    setting: Setting,
) -> Evidence:
    """The evidence with gain and size from a fit in which the cause is free."""
    freed = fit_freed(candidate, times, fit.lines, solution, fit.freedom, setting)
    if freed is None:
        return tested
    gain, sizes = freed[0] - candidate.looked_for, freed[1]
    return replace(
        tested, gain=gain, sentence=_sentence(candidate, sizes), need=_need(sizes, tested.dof)
    )


def _need(sizes: Floats, shown: int) -> float:
    """How many plausible sizes a cause of k numbers needs: of each, as the `shown` ones of them."""
    return float(np.linalg.norm(sizes) / np.sqrt(shown))


def _sentence(candidate: Candidate, sizes: Floats) -> str:
    """What the cause would have to be, by the parameter that is farthest off."""
    if candidate.says is not None:
        return candidate.says(sizes)
    if candidate.symptom:
        return "times bend away from the path along the legs"
    largest = int(np.argmax(np.abs(sizes)))
    plausible = candidate.plausible[largest]
    what = candidate.name.replace("_", " ")
    return f"{what} off by {sizes[largest] * plausible.size:.2g} {plausible.unit}".rstrip()


def _blind(
    candidate: Candidate, signal: Floats, mixing: Floats, examined: Examined
) -> tuple[BlindSpot, ...]:
    """The largest error of each parameter that stays unseen, where it moves the path."""
    spots = []
    for k, plausible in enumerate(candidate.plausible):
        seen = float(np.linalg.norm(signal * mixing[:, k]))
        hidden = min(1.0, SEEN_AT / max(seen, 1e-12))
        moved_mm = examined.vertices.moved_mm(examined.gain @ (hidden * candidate.columns[:, k]))
        size, unit = hidden * plausible.size, plausible.unit
        spots.append(examined.vertices.spot(candidate.name, size, unit, moved_mm))
    return farthest(spots)


def _scatter(fit: JointFit, times: TimeData, solution: Solution) -> Evidence:
    """Whether times, lines and priors agree with the path as well as stated, whatever the cause."""
    n_shared = solution.columns.shape[1] - fit.freedom.basis.shape[1]
    n_others = len(fit.lines.leg) + len(fit.freedom.prior_values) + n_shared
    squared = solution.rows[: len(times.leg) + n_others] ** 2
    free = int(np.linalg.matrix_rank(solution.columns))
    dof = max(1, int(np.count_nonzero(times.weight)) + n_others - free)
    chi2 = float(squared.sum())
    return Evidence(
        FindingName.SCATTER,
        chi2,
        dof,
        chi2 - dof,
        f"times scatter about the path by {np.sqrt(chi2 / dof):.2g} times their stated errors",
        "calibrate the delays of the pixels anew",
        symptom=True,
    )


def _of_single_pixels(
    fit: JointFit, times: TimeData, solution: Solution, sightings: list[Sighting]
) -> tuple[Evidence, ...]:
    """Whether pixels err each by themselves: a pulse against the line through its two neighbours.

    Whatever bends, shifts or slows a whole leg leaves these differences alone; delays and gains of
    another day, or of another camera, do not.
    """
    # Repeats see the same pixels err alike: one of each camera is asked.
    first = _repeats(fit, sightings) == 0
    differences = [
        _against_neighbours(np.flatnonzero(first & of_view & (times.leg == leg)), times, solution)
        for of_view in (fit.sighting_of == number for number in np.unique(fit.sighting_of))
        for leg in range(solution.state.n_legs)
    ]
    squared = np.concatenate(differences) ** 2
    chi2, dof = float(squared.sum()), len(squared)
    # Uneven light is worth a tenth: no test of its own for less than a clock's.
    if chi2 <= (1.0 + _CLOCKS) * dof:
        return ()
    return (
        Evidence(
            FindingName.CALIBRATION,
            chi2,
            dof,
            # A delay for each pixel would take up what all pulses scatter by.
            (chi2 / dof - 1.0) * int(np.count_nonzero(times.weight)),
            f"neighbouring pixels disagree by {np.sqrt(chi2 / dof):.2g} times their stated errors",
            REMEDIES[FindingName.CALIBRATION],
        ),
    )


def _against_neighbours(pulses: Indices, times: TimeData, solution: Solution) -> Floats:
    """(k,), pulses of one leg in one recording against the line through their neighbours, sigma.

    No pulse stands in two of the differences, so they are independent.
    """
    own = pulses[times.weight[pulses] > 0]
    if not len(own):
        return np.empty(0)
    view = int(times.view[own[0]])
    print_ = footprints(
        solution.state,
        camera=solution.cameras[view],
        medium=solution.medium,
        legs=times.leg[own],
        rows=times.row[own],
        cols=times.col[own],
    )
    place = print_.fraction * print_.px_per_leg
    ridge = np.flatnonzero(np.abs(print_.lateral_px) < _RIDGE_PX)
    ridge = ridge[np.argsort(place[ridge])]
    threes = ridge[: len(ridge) // 3 * 3].reshape(-1, 3)
    threes = threes[np.ptp(place[threes], axis=1) < _NEIGHBOURS_PX]
    at, which = place[threes], own[threes]
    share = (at[:, 1] - at[:, 0]) / np.maximum(at[:, 2] - at[:, 0], 1e-9)
    weights = np.column_stack((share - 1.0, np.ones(len(share)), -share))
    variance = (times.photon_var + times.pixel_var)[which]
    off = np.sum(weights * solution.residual_ps[which], axis=1)
    sigmas: Floats = off / np.sqrt(np.sum(weights**2 * variance, axis=1))
    return sigmas


def _of_pulses(
    fit: JointFit, sightings: list[Sighting], told_by: Callable[[Sighting], Floats]
) -> Floats:
    """(n,) what recordings tell of each of their arrivals, for the pulses of the fit."""
    out = np.zeros(len(fit.times.leg))
    for number, sighting in enumerate(sightings):
        here = fit.sighting_of == number
        out[here] = told_by(sighting)[fit.times.index[here]]
    return out


def counted_ps(sighting: Sighting) -> Floats:
    """(n,) delay that the clock counted for each pulse, signed as arrival times are, ps.

    As measured: a column made of it must be that of the model, or noise explains itself.
    """
    arrivals = sighting.arrivals
    delay: Floats = arrivals.arrival_ps + sighting.timing.skew_ps[arrivals.row, arrivals.col]
    period = arrivals.laser_period_ps
    if sighting.histograms.reversed_codes and period is not None:
        delay = delay - period
    return delay


def _repeats(fit: JointFit, sightings: list[Sighting]) -> Floats:
    """(n,) which of its camera's recordings each pulse is of, from zero."""
    number_in_view = np.zeros(len(sightings))
    for view in {o.view for o in sightings}:
        own = [k for k, o in enumerate(sightings) if o.view == view]
        number_in_view[own] = np.arange(len(own))
    return number_in_view[fit.sighting_of]


REMEDIES: dict[FindingName, str] = {
    FindingName.SOURCE: "measure the source's place and time, or state their errors",
    FindingName.CLOCK_OFFSET: "calibrate the trigger's zero, or let the emission time be fitted",
    FindingName.CLOCK_SCALE: "calibrate the clock at the temperature of the recording",
    FindingName.CLOCK_DRIFT: "record shorter, and calibrate before and after",
    FindingName.WALK: "record dimmer, or calibrate the delay against brightness",
    FindingName.INDEX: "state the medium's group index, out and back",
    FindingName.FOCAL_LENGTH: "calibrate the camera, or measure its field of view",
    FindingName.DISTORTION: "calibrate the camera's lens",
    FindingName.POSE: "measure where the camera stands and looks, or state its errors",
    FindingName.WINDOW: "measure how far the window stands from the camera, or state its error",
    FindingName.BLOCK: "tell where it stands and what it is of ([block]), or take it out of the "
    "beam",
    FindingName.CALIBRATION: "calibrate the delays and codes of the pixels anew",
    FindingName.CURVED_LEG: "look for what bends the beam",
    FindingName.DRAWN_CURVE: "measure the told curve anew, or state larger errors of its place",
    FindingName.PRIOR: "measure it anew, or state a larger error",
    FindingName.UNSEEN_LEG: "look for a mirror outside the picture, and say where it is",
    FindingName.TREND: "look at the residuals along the legs",
}
"""What cures each cause."""
