"""The climb of `photon`: everything unknown at once, to the top of the likelihood of all counts.

Takes pixels and counts of every camera, a freedom and a start; gives where Fisher scoring ended and
what the likelihood knows there. Which pixels take part is for `counts` to say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.reconstruct.model.forward import CodeCounts, Local, Pixels
from lightflight.reconstruct.model.freedom import Freedom
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
from lightflight.reconstruct.model.thick_beam import BEAM_SHARE_STD, OWN_SHARE, OWN_SHARE_STD
from lightflight.reconstruct.model.unknowns import (
    Layout,
    Light,
    layout_of,
    moved_light,
    pushed_over_edges,
)
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
_MOST_DELAY_STDS = 0.5
"""Of a pulse: beyond, its counts no longer follow its delay linearly, and one pixel whose light
comes at another time than it should sends a climb down however short its step."""
GAUGE = 1e-13
"""Share of the largest scaled information below which a direction is a gauge, fixed by nothing."""
_BEND_PRIOR = 0.3
"""How loosely neighbouring strengths are held together where no light tells (ln per knot^2)."""


@dataclass(frozen=True, eq=False)
class View:
    """What one camera's counts bring to a climb.

    Attributes
    ----------
    number : int
        Which of the setting's cameras it is.
    light : Light
        Where brightness, spot and pulse width start.
    pixels : Pixels
        The n pixels that take part.
    codes : CodeCounts
        Counts and code intervals of those pixels.
    uneven : array of bool, shape (n, L)
        True where a pixel's light may depart freely from its leg's.
    dark : tuple of int
        Legs that the camera does not show, by number.
    """

    number: int
    light: Light
    pixels: Pixels
    codes: CodeCounts
    uneven: NDArray[np.bool_]
    dark: tuple[int, ...]

    @property
    def scatter(self) -> Floats:
        """(n, L), how far ln(photons) of a pixel may depart from its leg's."""
        return np.where(self.uneven, _FREE_SCATTER, self.light.log_scatter)


@dataclass(frozen=True, eq=False)
class ViewPoint:
    """What is unknown of one camera's counts, at one place of a climb; n pixels, L legs.

    Attributes
    ----------
    light : Light
        Brightness, spot and pulse width.
    modes : array of float, shape (k,)
        Shared errors of its clock and light, in standard deviations.
    log_background : array of float, shape (n,)
        ln(background counts per ps) of each pixel.
    delay_shift_ps : array of float, shape (n,)
        Clock error of each pixel, ps.
    departure : array of float, shape (n, L)
        By how much ln(photons) of each leg in a pixel departs from the leg's.
    """

    light: Light
    modes: Floats
    log_background: Floats
    delay_shift_ps: Floats
    departure: Floats

    def moved(self, step: Floats, found: Likelihood, layout: Layout) -> ViewPoint:
        """The same after a step of this view's parameters, pixels' own following it."""
        # Each pixel's own unknowns were eliminated: they go to their best values for the step.
        follow = found.nuisance_step + found.nuisance_gain @ step
        farthest = _MOST_DELAY_STDS * float(np.exp(self.light.log_std_ps))
        return ViewPoint(
            moved_light(self.light, step, layout),
            self.modes + step[layout.unit_priors][: layout.n_modes],
            # Logarithms: a linear step of more than this is no longer to be trusted.
            self.log_background + np.clip(follow[:, 0], -1.5, 1.5),
            self.delay_shift_ps + np.clip(follow[:, 1], -farthest, farthest),
            self.departure + np.clip(follow[:, 2:], -1.0, 1.0),
        )


@dataclass(frozen=True, eq=False)
class Told:
    """What the counts of one camera say at one place of a climb.

    Attributes
    ----------
    local : Local
        What each of its pixels expects.
    result : Likelihood
        Value, score and information, of this view's parameters alone.
    """

    local: Local
    result: Likelihood


@dataclass(frozen=True, eq=False)
class Order:
    """Where the parameters of each view sit among all P of a climb.

    The first view's stand as in its own layout: path, modes, shared errors, brightness, spot,
    pulse width. Of each further view modes, brightness, spot and width follow.

    Attributes
    ----------
    layouts : tuple of Layout
        Of each view by itself.
    places : tuple of array of int
        Where each of a view's parameters sits among all.
    size : int
        P.
    """

    layouts: tuple[Layout, ...]
    places: tuple[NDArray[np.intp], ...]
    size: int

    @property
    def n_free(self) -> int:
        """Freedom of the path, which comes first."""
        return self.layouts[0].n_free

    @property
    def shared(self) -> slice:
        """Shared errors of cameras and medium."""
        first = self.n_free + self.layouts[0].n_modes
        return slice(first, first + self.layouts[0].n_shared)


def order_of(layouts: Sequence[Layout]) -> Order:
    """All parameters of some views, path and shared errors once."""
    first, places = layouts[0], [np.arange(layouts[0].size)]
    size = first.size
    for own in layouts[1:]:
        at = np.empty(own.size, dtype=np.intp)
        common = own.of_path_and_shared
        at[common] = first.of_path_and_shared
        rest = np.setdiff1d(np.arange(own.size), common)
        at[rest] = size + np.arange(len(rest))
        size += len(rest)
        places.append(at)
    return Order(tuple(layouts), tuple(places), size)


@dataclass(frozen=True, eq=False)
class Climb:
    """Where a climb ended.

    Attributes
    ----------
    state : PathState
        The path.
    views : tuple of View
        The cameras' counts, as they went in.
    points : tuple of ViewPoint
        What was unknown of each, as found.
    told : tuple of Told
        What the likelihood knows there, of each.
    freedom : Freedom
        What could move.
    order : Order
        Where the parameters sit.
    information : array of float, shape (P, P)
        Of all counts.
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
    converged : bool
        Whether it is the top.
    """

    state: PathState
    views: tuple[View, ...]
    points: tuple[ViewPoint, ...]
    told: tuple[Told, ...]
    freedom: Freedom
    order: Order
    information: Floats
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
    """Everything that is unknown, at one place of a climb.

    Attributes
    ----------
    state : PathState
        The path.
    shared : array of float, shape (j,)
        Shared errors of cameras and medium, in standard deviations.
    views : tuple of ViewPoint
        The rest, of each camera.
    """

    state: PathState
    shared: Floats
    views: tuple[ViewPoint, ...]

    def moved(self, step: Floats, slope: _Slope, freedom: Freedom, order: Order) -> _Point:
        """The point after a step (P,) of the shared parameters, pixels' own following it."""
        return _Point(
            self.state.moved(freedom.basis @ step[: order.n_free]),
            self.shared + step[order.shared],
            tuple(
                view.moved(step[places], told.result, layout)
                for view, told, layout, places in zip(
                    self.views, slope.told, order.layouts, order.places, strict=True
                )
            ),
        )


@dataclass(frozen=True, eq=False)
class _Slope:
    """The likelihood about a point: what the next step is taken from."""

    told: tuple[Told, ...]
    of_counts: Floats
    value: float
    score: Floats
    information: Floats


@dataclass(frozen=True, eq=False)
class _Hill:
    """What does not change during a climb: pixels, counts, freedom and priors.

    Attributes
    ----------
    prior : array of float, shape (P, P)
        Information of the shared priors (source, emission time, waypoints, modes).
    hold : array of float, shape (P, P)
        Information of the weak holds on brightness and spot.
    """

    views: tuple[View, ...]
    setting: Setting
    errors: SharedErrors
    freedom: Freedom
    order: Order
    prior: Floats
    hold: Floats

    def slope_at(self, point: _Point) -> _Slope:
        """Log-likelihood with all priors, score and information at a point."""
        score, value = self._prior_score(point)
        information = np.zeros((self.order.size, self.order.size))
        told = []
        for view, at, layout, places in zip(
            self.views, point.views, self.order.layouts, self.order.places, strict=True
        ):
            one = self._told(view, at, layout, point)
            told.append(one)
            value += one.result.value
            score[places] += one.result.score
            information[np.ix_(places, places)] += one.result.information
        whole = information + self.prior + self.hold
        for at, layout, places in zip(
            point.views, self.order.layouts, self.order.places, strict=True
        ):
            for held in places[pushed_over_edges(at.light, layout, score[places])]:
                # At an edge it stays, and all else is asked for its top there.
                score[held], whole[held], whole[:, held], whole[held, held] = 0.0, 0.0, 0.0, 1.0
        return _Slope(tuple(told), information, value, score, whole)

    def _told(self, view: View, at: ViewPoint, layout: Layout, point: _Point) -> Told:
        """What one camera's counts say at a point."""
        state = point.state
        local = local_with_shared(
            state if state.dark == view.dark else replace(state, dark=view.dark),
            at.light,
            view.pixels,
            layout,
            basis=self.freedom.basis,
            modes=at.modes,
            setting=self.setting,
            errors=self.errors,
            delta=point.shared,
            view=view.number,
        )
        return Told(local, _likelihood_at(view, at, local, view.codes, view.scatter))

    def _prior_score(self, point: _Point) -> tuple[Floats, float]:
        """Score (P,) and log-density of all priors at a point."""
        freedom, order = self.freedom, self.order
        misfit = freedom.prior_values - freedom.prior_rows @ point.state.vector
        score = np.zeros(order.size)
        score[: order.n_free] = (freedom.prior_rows @ freedom.basis).T @ misfit
        score[order.shared] = -point.shared
        held = np.zeros(order.size)
        squared = float(misfit @ misfit + point.shared @ point.shared)
        for at, layout, places in zip(point.views, order.layouts, order.places, strict=True):
            own = np.zeros(layout.size)
            for start, spline in zip(layout.spline_starts, at.light.coefficients, strict=True):
                own[start : start + len(spline)] = spline
            for start, spot in zip(layout.spot_starts, at.light.spots, strict=True):
                own[start : start + 3] = spot.varies_ln
            own[-2] = at.light.log_spot_px - SPOT_PRIOR[0]
            if layout.beam is not None:
                own[layout.beam] = at.light.beam_share
            for start, shares in zip(layout.own_shares, at.light.own_shares, strict=True):
                own[start : start + 2] = np.array(shares) - OWN_SHARE
            held[places] += own
            score[places[layout.unit_priors][: layout.n_modes]] = -at.modes
            squared += float(at.modes @ at.modes)
        score -= self.hold @ held
        return score, -0.5 * (squared + float(held @ self.hold @ held))


def _priors(freedom: Freedom, order: Order, views: Sequence[View]) -> tuple[Floats, Floats]:
    """Information of the shared priors, and of the weak holds on brightness and spot; (P, P)."""
    prior, hold = np.zeros((order.size, order.size)), np.zeros((order.size, order.size))
    prior[: order.n_free, : order.n_free] = freedom.prior_information
    for view, layout, places in zip(views, order.layouts, order.places, strict=True):
        units = places[layout.unit_priors]
        prior[units, units] = 1.0
        for first, coefficients in zip(layout.spline_starts, view.light.coefficients, strict=True):
            n = len(coefficients)
            # Second differences: a steady slope of the brightness is free, a jagged one is held.
            bend = _BEND_PRIOR * np.diff(np.eye(n), 2, axis=0) if n > 2 else np.zeros((0, n))
            own = places[first : first + n]
            hold[np.ix_(own, own)] = bend.T @ bend + 1e-9 * np.eye(n)
        for first, spot in zip(layout.spot_starts, view.light.spots, strict=True):
            own = places[first : first + 3]
            hold[np.ix_(own, own)] = spot.precision
        hold[places[-2], places[-2]] = 1.0 / SPOT_PRIOR[1] ** 2
        if layout.beam is not None:
            hold[places[layout.beam], places[layout.beam]] = 1.0 / BEAM_SHARE_STD**2
        for first in layout.own_shares:
            own = places[first : first + 2]
            hold[own, own] = 1.0 / OWN_SHARE_STD**2
    return prior, hold


def climb(
    state: PathState,
    views: Sequence[View],
    freedom: Freedom,
    setting: Setting,
    *,
    shared: Floats | None = None,
) -> Climb:
    """Fisher scoring with Levenberg damping to the top of the likelihood.

    Parameters
    ----------
    state : PathState
        Where the climb starts.
    views : sequence of View
        The counts of each camera, one of them or more.
    freedom : Freedom
        What may move, and the priors on it.
    setting : Setting
        Cameras, source, medium and waypoints.
    shared : array of float, shape (j,), optional
        Where the shared errors of the setting start, in standard deviations; None: at zero.

    Returns
    -------
    Climb
        Where it ended, and what the likelihood knows there.

    Notes
    -----
    Maximised is ln L + ln prior over everything unknown at once, ln L the sum over cameras; each
    pixel's own unknowns are eliminated from the system and follow its step (method.md, What the
    counts say).
    """
    errors = shared_errors(setting)
    order = order_of(
        [
            layout_of(freedom.basis.shape[1], view.pixels.n_modes, view.light, len(errors))
            for view in views
        ]
    )
    hill = _Hill(tuple(views), setting, errors, freedom, order, *_priors(freedom, order, views))
    point = _Point(
        state,
        np.zeros(len(errors)) if shared is None else shared,
        tuple(
            ViewPoint(
                view.light,
                modes=np.zeros(layout.n_modes),
                log_background=np.log(_background_start(view.codes)),
                delay_shift_ps=np.zeros(len(view.pixels.rows)),
                departure=np.zeros(view.pixels.near.shape),
            )
            for view, layout in zip(views, order.layouts, strict=True)
        ),
    )
    point, slope, converged = ascend(
        point,
        hill.slope_at,
        lambda at, slope, step: at.moved(step, slope, freedom, order),
        most_steps=_MOST_CLIMB_STEPS,
        level=_LEVEL,
        gauge=GAUGE,
    )
    return Climb(
        point.state, hill.views, point.views, slope.told, freedom, order, slope.of_counts,
        hill.prior, hill.hold, setting, errors, point.shared, converged,
    )  # fmt: skip


def _likelihood_at(
    view: View, at: ViewPoint, local: Local, codes: CodeCounts, log_scatter: ArrayLike
) -> Likelihood:
    """Of `codes` of one camera where `at` is; `log_scatter`: how much its pixels may depart."""
    return likelihood(
        local,
        view.pixels,
        codes,
        log_background=at.log_background,
        delay_shift_ps=at.delay_shift_ps,
        log_photons_shift=at.departure,
        log_scatter=log_scatter,
    )


def led_by(view: View, at: ViewPoint, told: Told, codes: Sequence[CodeCounts]) -> Floats:
    """(p, k), what is added to the score of a view's p parameters by k other codes instead of its.

    Parameters
    ----------
    view : View
        Counts of one camera.
    at : ViewPoint
        Where a climb ended.
    told : Told
        What its likelihood knows there.
    codes : sequence of CodeCounts
        The same counts, more or less of them expected of light that is no leg's.

    Returns
    -------
    array of float, shape (p, k)
        Of the top of the likelihood the covariance times this is how far it lies aside.
    """
    before = told.result.score
    led = [_likelihood_at(view, at, told.local, one, view.scatter).score - before for one in codes]
    return np.reshape(led, (len(codes), len(before))).T


def uneven_pixels(view: View, at: ViewPoint, told: Told) -> NDArray[np.bool_]:
    """(n, L), True where a pixel's light departs from its leg's brightness beyond chance.

    Parameters
    ----------
    view : View
        Counts of one camera.
    at : ViewPoint
        Where a climb ended.
    told : Told
        What its likelihood knows there.

    Returns
    -------
    array of bool, shape (n, L)
    """
    free = _likelihood_at(view, at, told.local, view.codes, _FREE_SCATTER)
    departure = at.departure + free.nuisance_step[:, 2:]
    std = free.nuisance_std[:, 2:]
    usual = np.hypot(std, at.light.log_scatter)
    # Where few photons fell, a departure is chance: its own error says so.
    telling = view.pixels.near & (std < 0.3 * _FREE_SCATTER)
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
