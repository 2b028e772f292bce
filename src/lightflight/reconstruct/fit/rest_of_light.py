"""The brightness along a leg that a spline leaves out, as a Gaussian process.

Most of it is alike everywhere: waves that are shorter than the spline's knots lie apart. A grain in
the beam or the edge of a shadow is more, and in one place: there the process is given a patch in
which it is stronger, where the photons are the likelier for it by more than it costs to have looked
for one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

Floats = NDArray[np.float64]

_STRENGTHS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Strengths of the rest that are tried, ln."""
_UNEQUAL = (0.0, 0.02, 0.06, 0.2)
"""Unequal efficiencies of the pixels that are tried, ln: these move no time."""
_PATCH_STDS = (0.3, 0.6, 1.2)
"""Strengths of a patch that are tried, ln: from what the rest may be everywhere to ten times as
bright."""
_PATCH_PX = 1.0
"""Standard deviation of the window of a patch: a grain and the spline's swing beside it, px."""
_PATCH_ALIKE_SPOTS = 1.5
"""Over how much of the picture light is alike there, in standard deviations of the spot: the log of
a point ten times as bright as the light about it is as wide."""
_STEP_PX = 0.5
"""Between the places where a patch is tried."""
_MOST_PATCHES = 12
"""Of one leg: one with more has no smooth light."""


@dataclass(frozen=True)
class Rest:
    """Covariance of the rest along a leg, ln, as a function of places on its line, px.

    Attributes
    ----------
    std : float
        Of the rest everywhere, ln.
    alike_px : float
        Over how much of the line it is alike.
    patches : tuple of (float, float)
        Place, px, and standard deviation, ln, of each patch.
    patch_alike_px : float
        Over how much of the line it is alike in a patch.
    """

    std: float
    alike_px: float
    patches: tuple[tuple[float, float], ...]
    patch_alike_px: float

    @property
    def is_none(self) -> bool:
        """Whether there is no rest."""
        return self.std == 0.0 and not self.patches

    @property
    def steepest_per_px(self) -> float:
        """Standard deviation of the slope in the strongest patch; zero without any."""
        return max((std for _, std in self.patches), default=0.0) / self.patch_alike_px

    def covariance(self, one: Floats, other: Floats) -> Floats:
        """(n, m), of the rest at n places with that at m others."""
        found: Floats = self.std**2 * _alike(one, other, self.alike_px)[0]
        for place, std in self.patches:
            windows = np.outer(_window(one, place)[0], _window(other, place)[0])
            found = found + std**2 * windows * _alike(one, other, self.patch_alike_px)[0]
        return found

    def of_slope(self, one: Floats, other: Floats) -> Floats:
        """(n, m), of its slope at n places with the rest at m others, per px."""
        found: Floats = self.std**2 * _alike(one, other, self.alike_px)[1]
        for place, std in self.patches:
            alike, slope, _ = _alike(one, other, self.patch_alike_px)
            (here, steep), (there, _) = _window(one, place), _window(other, place)
            found = found + std**2 * (
                np.outer(steep, there) * alike + np.outer(here, there) * slope
            )
        return found

    def of_slopes(self, one: Floats) -> Floats:
        """(n, n), of its slopes at n places, per px²."""
        found: Floats = self.std**2 * _alike(one, one, self.alike_px)[2]
        for place, std in self.patches:
            alike, slope, slopes = _alike(one, one, self.patch_alike_px)
            here, steep = _window(one, place)
            mixed = np.outer(here, steep) * slope
            found = found + std**2 * (
                np.outer(steep, steep) * alike + mixed + mixed.T + np.outer(here, here) * slopes
            )
        return found

    def with_patch(self, place: float, std: float) -> Rest:
        """The same with a patch more."""
        return replace(self, patches=(*self.patches, (place, std)))


@dataclass(frozen=True, eq=False)
class _Photons:
    """Places, px, log of the rest and variance of that by chance, (n,) each.

    And how alike the rest is at two of them, (n, n), where no patch is.
    """

    places_px: Floats
    log_rest: Floats
    noise: Floats
    alike: Floats


@dataclass(frozen=True, eq=False)
class _Told:
    """How likely photons are by a rest, and what follows; n places.

    Attributes
    ----------
    rest : Rest
    unequal : float
        Of the pixels, ln.
    likely : float
        Log of the likelihood.
    factor : array of float, shape (n, n)
        Of the covariance of the photons, lower.
    scaled : array of float, shape (n,)
        What they show, by that factor.
    """

    rest: Rest
    unequal: float
    likely: float
    factor: Floats
    scaled: Floats


def rest_of_light(
    places_px: Floats, log_rest: Floats, noise: Floats, *, alike_px: float, spot_px: float
) -> tuple[Rest, Floats] | None:
    """The rest that the photons make the most likely, and the factor of their covariance.

    Parameters
    ----------
    places_px : array of float, shape (n,)
        On the line of the leg.
    log_rest : array of float, shape (n,)
        Log of the photons of each pixel over what the spline has.
    noise : array of float, shape (n,)
        Its variance by chance.
    alike_px : float
        Over how much of the line the rest is alike.
    spot_px : float
        Standard deviation of the spot.

    Returns
    -------
    rest : Rest
    factor : array of float, shape (n, n)
        Lower. None instead of both where no rest is the most likely.
    """
    none = Rest(0.0, alike_px, (), _PATCH_ALIKE_SPOTS * spot_px)
    alike = replace(none, std=1.0).covariance(places_px, places_px)
    photons = _Photons(places_px, log_rest, noise, alike)
    tried = np.arange(places_px.min(), places_px.max() + _STEP_PX, _STEP_PX)
    # So many patches are looked at that one of them is the likelier by that much by chance.
    cost = float(np.log(len(tried) * len(_PATCH_STDS)))
    # A few grains look much like light that is uneven everywhere: both are begun with.
    told = _patched(_strongest(none, photons), photons, tried, cost)
    if told.rest.std > 0.0:
        alone = _patched(_strongest(none, photons, _STRENGTHS[:1]), photons, tried, cost)
        told = max(told, alone, key=lambda one: one.likely - cost * len(one.rest.patches))
    return None if told.rest.is_none else (told.rest, told.factor)


def _patched(told: _Told, photons: _Photons, tried: Floats, cost: float) -> _Told:
    """With as many patches as are worth their cost; at last as strong elsewhere as is likeliest."""
    before, places = told.rest, photons.places_px
    stds = _STRENGTHS if before.std > 0.0 else _STRENGTHS[:1]
    of_patches = np.zeros_like(photons.alike)
    for _ in range(_MOST_PATCHES):
        place = _where_most_is_left(told, tried, places)
        unit = replace(before, std=0.0, patches=((place, 1.0),)).covariance(places, places)
        more = [
            _told(
                told.rest.with_patch(place, std), told.unequal, photons, of_patches + std**2 * unit
            )
            for std in _PATCH_STDS
        ]
        best = max(more, key=lambda one: one.likely)
        if best.likely < told.likely + cost:
            break
        of_patches += best.rest.patches[-1][1] ** 2 * unit
        told = _strongest(best.rest, photons, stds, of_patches)
    return told if told.rest is before else _strongest(told.rest, photons, _STRENGTHS, of_patches)


def slopes_of_rest(
    rest: Rest, factor: Floats, log_rest: Floats, seen_px: Floats, asked_px: Floats
) -> tuple[Floats, Floats]:
    """Slopes (n,) of the rest at places, per px, and one-sigma columns (n, k) of them.

    Parameters
    ----------
    rest : Rest
    factor : array of float, shape (m, m)
        As `rest_of_light` returns it.
    log_rest : array of float, shape (m,)
        What the photons show, ln.
    seen_px : array of float, shape (m,)
        Where.
    asked_px : array of float, shape (n,)
        Where slopes are asked for.
    """
    by_rest = rest.of_slope(asked_px, seen_px)
    left = rest.of_slopes(asked_px) - by_rest @ cho_solve((factor, True), by_rest.T)
    values, vectors = np.linalg.eigh(left)
    columns: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
    return by_rest @ cho_solve((factor, True), log_rest), columns


def _where_most_is_left(told: _Told, tried: Floats, places_px: Floats) -> float:
    """The place about which photons depart most from what is expected of them."""
    back = solve_triangular(told.factor, told.scaled, lower=True, trans="T", check_finite=False)
    inverse = cho_solve((told.factor, True), np.eye(len(back)))
    # How fast the likelihood grows with the variance of a patch of pixels that are each by itself.
    gain = back**2 - np.diag(inverse)
    windows = np.exp(-(((tried[:, np.newaxis] - places_px) / _PATCH_PX) ** 2))
    return float(tried[np.argmax(windows @ gain / (windows @ np.diag(inverse)))])


def _strongest(
    rest: Rest,
    photons: _Photons,
    stds: tuple[float, ...] = _STRENGTHS,
    of_patches: Floats | float = 0.0,
) -> _Told:
    """The likeliest strength everywhere and inequality of pixels, with the patches as they are."""
    best: _Told | None = None
    for unequal in _UNEQUAL:
        last = -np.inf
        for std in stds:
            one = _told(replace(rest, std=std), unequal, photons, of_patches)
            if best is None or one.likely > best.likely:
                best = one
            # One maximum: beyond it nothing is gained.
            if one.likely < last:
                break
            last = one.likely
    assert best is not None
    return best


def _told(rest: Rest, unequal: float, photons: _Photons, of_patches: Floats | float) -> _Told:
    covariance = rest.std**2 * photons.alike + of_patches
    np.fill_diagonal(covariance, covariance.diagonal() + photons.noise + unequal**2)
    factor: Floats = np.linalg.cholesky(covariance).astype(np.float64, copy=False)
    scaled: Floats = solve_triangular(factor, photons.log_rest, lower=True, check_finite=False)
    likely = -0.5 * float(scaled @ scaled) - float(np.log(np.diag(factor)).sum())
    return _Told(rest, unequal, likely, factor, scaled)


def _alike(one: Floats, other: Floats, alike_px: float) -> tuple[Floats, Floats, Floats]:
    """Correlation (n, m) of places, its slope by the first, and that slope's by the second."""
    gap = np.subtract.outer(one, other) / alike_px
    alike = np.exp(-0.5 * gap**2)
    return alike, -gap / alike_px * alike, (1.0 - gap**2) / alike_px**2 * alike


def _window(places_px: Floats, middle_px: float) -> tuple[Floats, Floats]:
    """Of a patch, (n,), and its slope, per px."""
    off = (places_px - middle_px) / _PATCH_PX
    here = np.exp(-0.5 * off**2)
    return here, -off / _PATCH_PX * here
