"""The brightness along a leg that a spline leaves out, as a Gaussian process.

Light that is uneven at every scale is seen through the spot, which lets through what is longer than
itself: the process is alike over the root of two spots, and its strength is what photons and times
make the likeliest. Photons show its values, one a pixel, and would miss waves of two pixels that
pass through nothing at their centres; times show its slopes, which are the steepest there. The
spline is free: what it may take says nothing of the rest.

A grain in the beam or the edge of a shadow is more, and in one place: there the process is given a
patch in which it is stronger, where the photons are the likelier for it by more than it costs to
have looked for one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve, solve_triangular

from lightflight.reconstruct.model.strength import slopes_of_splines

Floats = NDArray[np.float64]

_ALIKE_SPOTS = float(np.sqrt(2.0))
"""Over how much of the picture the rest is alike, in standard deviations of the spot: light uneven
at every scale, seen through a Gaussian, has just this correlation."""
_STRENGTHS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)
"""Strengths of the rest that are tried, ln."""
_UNEQUAL = (0.0, 0.02, 0.06, 0.2)
"""Unequal efficiencies of the pixels that are tried, ln: these move no time."""
_LARGER = (2.0, 4.0, 8.0)
"""Times may err by so many times more than is stated, for another reason than the light: what such
errors explain as well is no rest, and stays for the verdict to see."""
_FREE_LN = 10.0
"""Standard deviation of what is free: any a photon or a time could ask for, and no more, so that
sums stay accurate; ln."""
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
    unequal : float
        Standard deviation of the pixels' efficiencies, ln, which photons are scattered by besides.
    """

    std: float
    alike_px: float
    patches: tuple[tuple[float, float], ...]
    patch_alike_px: float
    unequal: float = 0.0

    @property
    def is_none(self) -> bool:
        """Whether there is no rest."""
        return self.std == 0.0 and not self.patches

    @property
    def steepest_per_px(self) -> float:
        """Standard deviation of the slope in the strongest patch; zero without any."""
        return max((std for _, std in self.patches), default=0.0) / self.patch_alike_px

    def variance(self, places_px: Floats) -> Floats:
        """(n,), of the rest at places."""
        found = np.full(len(places_px), self.std**2)
        for place, std in self.patches:
            found += (std * _window(places_px, place)[0]) ** 2
        return found

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
class SlopesShown:
    """What the times of k pulses of a leg show of the slope of its light beyond its spline's.

    Attributes
    ----------
    places_px : array of float, shape (k,)
        On the line of the leg.
    per_px : array of float, shape (k,)
        The slope, ln per px.
    variance : array of float, shape (k,)
        Of that, by the errors of the times.
    path : array of float, shape (k, c)
        What the path may take of it, one standard deviation a column.
    """

    places_px: Floats
    per_px: Floats
    variance: Floats
    path: Floats


_NO_SLOPES = SlopesShown(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class LightShown:
    """What n pulses of a leg show of its light beyond its spline.

    Attributes
    ----------
    places_px : array of float, shape (n,)
        On the line of the leg.
    log_rest : array of float, shape (n,)
        Log of the photons of each pixel over what the spline has.
    noise : array of float, shape (n,)
        Its variance by chance.
    knots : array of float, shape (m,)
        Of the cubic spline, over all of these places.
    slopes : SlopesShown
        By times; of none, the photons speak alone.
    """

    places_px: Floats
    log_rest: Floats
    noise: Floats
    knots: Floats
    slopes: SlopesShown = _NO_SLOPES

    @property
    def values(self) -> Floats:
        """(n + k,), all that is shown."""
        return np.concatenate((self.log_rest, self.slopes.per_px))

    def errors(self, larger: float = 1.0) -> Floats:
        """(n + k, n + k), covariance of that by noise, by the path and by the spline.

        `larger`: by how much errors of times are larger than stated.
        """
        of_times = np.diag(larger**2 * self.slopes.variance)
        of_times += self.slopes.path @ self.slopes.path.T
        n = len(self.places_px)
        covariance = np.diag(np.concatenate((self.noise, np.zeros(len(of_times)))))
        covariance[n:, n:] = of_times
        free = np.vstack(
            (self.of_spline(self.places_px), self.of_spline(self.slopes.places_px, slope=True))
        )
        covariance += free @ free.T
        return covariance

    def by_rest(self, rest: Rest) -> Floats:
        """(n + k, n + k), covariance of that by a rest."""
        places, steep = self.places_px, self.slopes.places_px
        mixed = rest.of_slope(steep, places)
        both = [[rest.covariance(places, places), mixed.T], [mixed, rest.of_slopes(steep)]]
        return np.block(both)

    def of_spline(self, places_px: Floats, *, slope: bool = False) -> Floats:
        """(q, m - 4), what the spline may be at q places, one standard deviation a coefficient."""
        if slope:
            return _FREE_LN * slopes_of_splines(self.knots, places_px)
        free: Floats = _FREE_LN * BSpline.design_matrix(places_px, self.knots, 3).toarray()
        return free


@dataclass(frozen=True, eq=False)
class _Told:
    """How likely what is shown is by a rest, and what follows.

    Attributes
    ----------
    rest : Rest
    likely : float
        Log of the likelihood.
    factor : array of float, shape (n + k, n + k)
        Of the covariance of what is shown, lower.
    scaled : array of float, shape (n + k,)
        What is shown, by that factor.
    """

    rest: Rest
    likely: float
    factor: Floats
    scaled: Floats


@dataclass(frozen=True, eq=False)
class _Asked:
    """What is asked of any rest: its likelihood from these.

    Attributes
    ----------
    shown : LightShown
    errors : array of float, shape (n + k, n + k)
        Covariance without a rest.
    alike : array of float, shape (n + k, n + k)
        By a rest of unit strength, without patches.
    """

    shown: LightShown
    errors: Floats
    alike: Floats

    def told(self, rest: Rest, of_patches: Floats | float) -> _Told:
        """By a rest whose patches make up the covariance `of_patches`."""
        covariance = self.errors + rest.std**2 * self.alike + of_patches
        here = np.arange(len(self.shown.places_px))
        covariance[here, here] += rest.unequal**2
        factor: Floats = np.linalg.cholesky(covariance).astype(np.float64, copy=False)
        scaled: Floats = solve_triangular(factor, self.shown.values, lower=True, check_finite=False)
        likely = -0.5 * float(scaled @ scaled) - float(np.log(np.diag(factor)).sum())
        return _Told(rest, likely, factor, scaled)

    def strongest(
        self,
        rest: Rest,
        stds: tuple[float, ...] = _STRENGTHS,
        of_patches: Floats | float = 0.0,
    ) -> _Told:
        """The likeliest strength everywhere and inequality of pixels, patches as they are."""
        best: _Told | None = None
        for unequal in _UNEQUAL:
            last = -np.inf
            for std in stds:
                one = self.told(replace(rest, std=std, unequal=unequal), of_patches)
                if best is None or one.likely > best.likely:
                    best = one
                # One maximum: beyond it nothing is gained.
                if one.likely < last:
                    break
                last = one.likely
        assert best is not None
        return best

    def patched(self, told: _Told, tried: Floats, cost: float) -> _Told:
        """With as many patches as are worth their cost; at last as strong elsewhere as is best."""
        before = told.rest
        stds = _STRENGTHS if before.std > 0.0 else _STRENGTHS[:1]
        of_patches = np.zeros_like(self.alike)
        for _ in range(_MOST_PATCHES):
            place = _where_most_is_left(told, tried, self.shown.places_px)
            unit = self.shown.by_rest(replace(before, std=0.0, patches=((place, 1.0),)))
            more = [
                self.told(told.rest.with_patch(place, std), of_patches + std**2 * unit)
                for std in _PATCH_STDS
            ]
            best = max(more, key=lambda one: one.likely)
            if best.likely < told.likely + cost:
                break
            of_patches += best.rest.patches[-1][1] ** 2 * unit
            told = self.strongest(best.rest, stds, of_patches)
        return told if told.rest is before else self.strongest(told.rest, _STRENGTHS, of_patches)


def rest_of_light(shown: LightShown, *, spot_px: float) -> Rest:
    """The rest that photons and times make the most likely.

    Parameters
    ----------
    shown : LightShown
        What they show.
    spot_px : float
        Standard deviation of the spot.

    Returns
    -------
    Rest
        None at all (`is_none`) where that is the most likely.
    """
    none = Rest(0.0, _ALIKE_SPOTS * spot_px, (), _PATCH_ALIKE_SPOTS * spot_px)
    asked = _Asked(shown, shown.errors(), shown.by_rest(replace(none, std=1.0)))
    begun, places = asked.strongest(none), shown.places_px
    for larger in _LARGER if begun.rest.std > 0.0 and len(shown.slopes.places_px) else ():
        doubted = replace(asked, errors=shown.errors(larger))
        other = doubted.strongest(none)
        if other.likely < begun.likely:
            break
        asked, begun = doubted, other
    tried = np.arange(places.min(), places.max() + _STEP_PX, _STEP_PX)
    # So many patches are looked at that one of them is the likelier by that much by chance.
    cost = float(np.log(len(tried) * len(_PATCH_STDS)))
    # A few grains look much like light that is uneven everywhere: both are begun with.
    told = asked.patched(begun, tried, cost)
    if told.rest.std > 0.0:
        alone = asked.patched(asked.strongest(none, _STRENGTHS[:1]), tried, cost)
        told = max(told, alone, key=lambda one: one.likely - cost * len(one.rest.patches))
    return told.rest


def slopes_of_rest(rest: Rest, shown: LightShown, asked_px: Floats) -> tuple[Floats, Floats]:
    """Slopes (n,) of the light beyond its spline, per px, and one-sigma columns (n, k) of them.

    By its photons alone: the times are for whoever asks to use, once.

    Parameters
    ----------
    rest : Rest
        As `rest_of_light` returns it.
    shown : LightShown
        What the photons show.
    asked_px : array of float, shape (n,)
        Where slopes are asked for.
    """
    photons = replace(shown, slopes=_NO_SLOPES)
    covariance = photons.errors() + rest.covariance(shown.places_px, shown.places_px)
    np.fill_diagonal(covariance, covariance.diagonal() + rest.unequal**2)
    factor = np.linalg.cholesky(covariance)
    free = shown.of_spline(asked_px, slope=True)
    by_photons = (
        rest.of_slope(asked_px, shown.places_px) + free @ shown.of_spline(shown.places_px).T
    )
    left = rest.of_slopes(asked_px) + free @ free.T
    left -= by_photons @ cho_solve((factor, True), by_photons.T)
    values, vectors = np.linalg.eigh(left)
    columns: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
    return by_photons @ cho_solve((factor, True), shown.log_rest), columns


def _where_most_is_left(told: _Told, tried: Floats, places_px: Floats) -> float:
    """The place about which photons depart most from what is expected of them."""
    back = solve_triangular(told.factor, told.scaled, lower=True, trans="T", check_finite=False)
    inverse = cho_solve((told.factor, True), np.eye(len(back)))
    # How fast the likelihood grows with the variance of a patch of pixels that are each by itself.
    own, n = np.diag(inverse), len(places_px)
    gain = (back**2 - own)[:n]
    windows = np.exp(-(((tried[:, np.newaxis] - places_px) / _PATCH_PX) ** 2))
    return float(tried[np.argmax(windows @ gain / (windows @ own[:n]))])


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
