"""The climb of `photon`: everything unknown at once, to the top of the likelihood of all counts.

Takes pixels, counts, a freedom and a start; gives where Fisher scoring ended and what the
likelihood knows there. Which pixels take part, and what becomes of the path, is `photon`'s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.forward import (
    CodeCounts,
    Layout,
    Light,
    Local,
    Pixels,
    layout_of,
    moved_light,
)
from lightflight.reconstruct.model.freedom import Freedom, state_vector
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.information import ascend
from lightflight.reconstruct.model.likelihood import Likelihood, likelihood
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import (
    SharedErrors,
    local_with_shared,
    moved,
    shared_errors,
)
from lightflight.reconstruct.model.strength import SPOT_PRIOR
from lightflight.units import std_from_mad

Floats = NDArray[np.float64]

_UNEVEN = 6.0
"""A pixel whose light departs from its leg's brightness by more standard deviations than this
tells times alone: it is hot, and loses light to its own noise, or it sees less than others."""
_FREE_SCATTER = 3.0
"""How far the brightness of such a pixel may depart, ln."""
_MOST_CLIMB_STEPS = 40
"""A climb that took more steps than this is said not to have converged."""
_LEVEL = 0.03
"""A step that changes the log-likelihood by less ends a climb: a quarter of an error at most. Each
pixel's own unknowns follow to first order, so that values sway by 1e-3 at the top."""
GAUGE = 1e-13
"""Share of the largest scaled information below which a direction is a gauge, fixed by nothing."""
_BEND_PRIOR = 0.3
"""How loosely neighbouring strengths are held together where no light tells (ln per knot^2)."""


@dataclass(frozen=True, eq=False)
class Climb:
    """Where a climb ended.

    Attributes
    ----------
    departure : array of float, shape (n, L)
        By how much ln(photons) of each leg in a pixel departs from the leg's.
    uneven : array of bool, shape (n, L)
        True where it may depart freely.
    prior : array of float, shape (P, P)
        Information of the shared priors (source, emission time, waypoints, modes, shared errors).
    hold : array of float, shape (P, P)
        Information of the weak holds on brightness and spot.
    setting : Setting
        As told.
    errors : SharedErrors
        Of that setting.
    shared : array of float, shape (j,)
        Those found, in standard deviations.
    """

    state: PathState
    light: Light
    modes: Floats
    freedom: Freedom
    layout: Layout
    pixels: Pixels
    local: Local
    log_background: Floats
    delay_shift_ps: Floats
    result: Likelihood
    departure: Floats
    uneven: NDArray[np.bool_]
    prior: Floats
    hold: Floats
    setting: Setting
    errors: SharedErrors
    shared: Floats
    converged: bool

    @property
    def seen(self) -> Setting:
        """The setting with its shared errors as found."""
        return moved(self.setting, self.errors, self.shared)


@dataclass(frozen=True, eq=False)
class _Point:
    """Everything that is unknown, at one place of a climb; n pixels, L legs.

    Attributes
    ----------
    state : PathState
        The path.
    light : Light
        Brightness, spot and pulse width.
    modes : array of float, shape (k,)
        Shared clock errors, in standard deviations.
    shared : array of float, shape (j,)
        Shared errors of camera and medium, in standard deviations.
    log_background : array of float, shape (n,)
        ln(background counts per ps) of each pixel.
    delay_shift_ps : array of float, shape (n,)
        Clock error of each pixel, ps.
    departure : array of float, shape (n, L)
        By how much ln(photons) of each leg in a pixel departs from the leg's.
    """

    state: PathState
    light: Light
    modes: Floats
    shared: Floats
    log_background: Floats
    delay_shift_ps: Floats
    departure: Floats

    def moved(self, step: Floats, found: Likelihood, freedom: Freedom, layout: Layout) -> _Point:
        """The point after a step (P,) of the shared parameters, pixels' own following it."""
        # Each pixel's own unknowns were eliminated: they go to their best values for the step.
        follow = found.nuisance_step + found.nuisance_gain @ step
        units = step[layout.unit_priors]
        return _Point(
            self.state.moved(freedom.basis @ step[: layout.n_free]),
            moved_light(self.light, step, layout),
            self.modes + units[: layout.n_modes],
            self.shared + units[layout.n_modes :],
            # Logarithms: a linear step of more than this is no longer to be trusted.
            self.log_background + np.clip(follow[:, 0], -1.5, 1.5),
            self.delay_shift_ps + follow[:, 1],
            self.departure + np.clip(follow[:, 2:], -1.0, 1.0),
        )


@dataclass(frozen=True, eq=False)
class _Slope:
    """The likelihood about a point: what the next step is taken from."""

    local: Local
    found: Likelihood
    value: float
    score: Floats
    information: Floats


@dataclass(frozen=True, eq=False)
class _Hill:
    """What does not change during a climb: pixels, counts, freedom and priors.

    Attributes
    ----------
    scatter : array of float, shape (n, L)
        How far ln(photons) of a pixel may depart from its leg's.
    prior : array of float, shape (P, P)
        Information of the shared priors (source, emission time, waypoints, modes).
    hold : array of float, shape (P, P)
        Information of the weak holds on brightness and spot.
    """

    pixels: Pixels
    codes: CodeCounts
    setting: Setting
    errors: SharedErrors
    freedom: Freedom
    layout: Layout
    scatter: Floats
    prior: Floats
    hold: Floats

    def slope_at(self, point: _Point) -> _Slope:
        """Log-likelihood with all priors, score and information at a point."""
        local = local_with_shared(
            point.state,
            point.light,
            self.pixels,
            self.layout,
            basis=self.freedom.basis,
            modes=point.modes,
            setting=self.setting,
            errors=self.errors,
            delta=point.shared,
        )
        found = likelihood(
            local,
            self.pixels,
            self.codes,
            log_background=point.log_background,
            delay_shift_ps=point.delay_shift_ps,
            log_photons_shift=point.departure,
            log_scatter=self.scatter,
        )
        score, value = self._prior_score(point)
        information = found.information + self.prior + self.hold
        return _Slope(local, found, found.value + value, found.score + score, information)

    def _prior_score(self, point: _Point) -> tuple[Floats, float]:
        """Score (P,) and log-density of all priors at a point."""
        freedom, layout = self.freedom, self.layout
        units = np.concatenate((point.modes, point.shared))
        misfit = freedom.prior_values - freedom.prior_rows @ state_vector(point.state)
        score = np.zeros(layout.size)
        score[: layout.n_free] = (freedom.prior_rows @ freedom.basis).T @ misfit
        score[layout.unit_priors] = -units
        held = np.zeros(layout.size)
        for start, spline in zip(layout.spline_starts, point.light.coefficients, strict=True):
            held[start : start + len(spline)] = spline
        held[-2] = point.light.log_spot_px - SPOT_PRIOR[0]
        score -= self.hold @ held
        value = -0.5 * float(misfit @ misfit + units @ units + held @ self.hold @ held)
        return score, value


def _priors(freedom: Freedom, layout: Layout, light: Light) -> tuple[Floats, Floats]:
    """Information of the shared priors, and of the weak holds on brightness and spot; (P, P)."""
    prior, hold = np.zeros((layout.size, layout.size)), np.zeros((layout.size, layout.size))
    prior[: layout.n_free, : layout.n_free] = freedom.prior_information
    units = np.arange(layout.size)[layout.unit_priors]
    prior[units, units] = 1.0
    for start, coefficients in zip(layout.spline_starts, light.coefficients, strict=True):
        n = len(coefficients)
        # Second differences: a steady slope of the brightness is free, a jagged one is held.
        bend = _BEND_PRIOR * np.diff(np.eye(n), 2, axis=0) if n > 2 else np.zeros((0, n))
        hold[start : start + n, start : start + n] = bend.T @ bend + 1e-9 * np.eye(n)
    hold[-2, -2] = 1.0 / SPOT_PRIOR[1] ** 2
    return prior, hold


def climb(
    state: PathState,
    light: Light,
    freedom: Freedom,
    pixels: Pixels,
    codes: CodeCounts,
    setting: Setting,
    uneven: NDArray[np.bool_],
    *,
    shared: Floats | None = None,
) -> Climb:
    """Fisher scoring with Levenberg damping to the top of the likelihood.

    Parameters
    ----------
    state : PathState
        Where the climb starts.
    light : Light
        Brightness, spot and pulse width.
    freedom : Freedom
        What may move, and the priors on it.
    pixels : Pixels
        The pixels that take part.
    codes : CodeCounts
        Counts and code intervals of those pixels.
    setting : Setting
        Camera, source, medium and waypoints.
    uneven : array of bool, shape (n, L)
        True where a pixel's light may depart freely from its leg's.
    shared : array of float, shape (j,), optional
        Where the shared errors of the setting start, in standard deviations; None: at zero.

    Returns
    -------
    Climb
        Where it ended, and what the likelihood knows there.

    Notes
    -----
    Maximised is ln L + ln prior over everything unknown at once; each pixel's own unknowns are
    eliminated from the system and follow its step (method.md, What the counts say).
    """
    errors = shared_errors(setting)
    layout = layout_of(freedom.basis.shape[1], pixels.modes_ps.shape[2], light, len(errors))
    scatter = np.where(uneven, _FREE_SCATTER, light.log_scatter)
    priors = _priors(freedom, layout, light)
    hill = _Hill(pixels, codes, setting, errors, freedom, layout, scatter, *priors)
    point = _Point(
        state,
        light,
        modes=np.zeros(layout.n_modes),
        shared=np.zeros(layout.n_shared) if shared is None else shared,
        log_background=np.log(_background_start(codes)),
        delay_shift_ps=np.zeros(len(pixels.rows)),
        departure=np.zeros(pixels.near.shape),
    )
    point, slope, converged = ascend(
        point,
        hill.slope_at,
        lambda at, slope, step: at.moved(step, slope.found, freedom, layout),
        most_steps=_MOST_CLIMB_STEPS,
        level=_LEVEL,
        gauge=GAUGE,
    )
    return Climb(
        point.state, point.light, point.modes, freedom, layout, pixels, slope.local,
        point.log_background, point.delay_shift_ps, slope.found, point.departure, uneven,
        hill.prior, hill.hold, setting, errors, point.shared, converged,
    )  # fmt: skip


def uneven_pixels(ended: Climb, codes: CodeCounts) -> NDArray[np.bool_]:
    """(n, L), True where a pixel's light departs from its leg's brightness beyond chance.

    Parameters
    ----------
    ended : Climb
        The climb that ended.
    codes : CodeCounts
        Counts and code intervals of those pixels.

    Returns
    -------
    array of bool, shape (n, L)
    """
    free = likelihood(
        ended.local,
        ended.pixels,
        codes,
        log_background=ended.log_background,
        delay_shift_ps=ended.delay_shift_ps,
        log_photons_shift=ended.departure,
        log_scatter=_FREE_SCATTER,
    )
    departure = ended.departure + free.nuisance_step[:, 2:]
    std = free.nuisance_std[:, 2:]
    usual = np.hypot(std, ended.light.log_scatter)
    # Where few photons fell, a departure is chance: its own error says so.
    telling = ended.pixels.near & (std < 0.3 * _FREE_SCATTER)
    scaled = np.abs(departure) / usual
    spread = max(1.0, std_from_mad(float(np.median(scaled[telling])))) if telling.any() else 1.0
    wrong: NDArray[np.bool_] = telling & (scaled > _UNEVEN * spread)
    return wrong


def _background_start(codes: CodeCounts) -> Floats:
    """Counts per ps of each pixel, in the nine of ten codes with the least; half a count more."""
    width = codes.upper_ps - codes.lower_ps
    live = width > 0
    rate = np.where(live, codes.counts / np.where(live, width, 1.0), np.nan)
    # Nine codes in ten hold no pulse: the quietest codes are background alone.
    low = np.nanquantile(rate, 0.9, axis=1)
    quiet = np.where(rate <= low[:, np.newaxis] + 1e-30, codes.counts, 0.0).sum(axis=1)
    span = np.where(rate <= low[:, np.newaxis] + 1e-30, width, 0.0).sum(axis=1)
    start: Floats = (quiet + 0.5) / np.maximum(span, 1e-9)
    return start
