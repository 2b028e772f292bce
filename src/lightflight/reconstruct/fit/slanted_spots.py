"""Spots that are no circles: beside a leg a pixel sees light from ahead of its foot, or behind it.

Lenses make ellipses of points, off their axis and where they stand askew. With a spot of covariance
C, along (a) and across (c) a leg, a pixel at y from the line sees the light of a place that is
y C_ac / C_cc ahead of its foot: times lean, one way on one side of the line and the other way on
the other. How much is a number of each leg in each camera's picture, which is fitted where the
pulses ask for it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.uneven import pulses_by_leg
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.unequal import price

if TYPE_CHECKING:
    from lightflight.reconstruct.fit.joint import JointFit

Floats = NDArray[np.float64]

_SLANT_STD = 0.3
"""Standard deviation of C_ac / C_cc: an ellipse at 45 degrees to a leg has 0.22 where its axes are
as 4 to 5, 0.6 where they are as 1 to 2. Pulses on both sides of a line know it ten times better."""
_ASKEW_STD_PS = 30.0
"""Of delays at the edge of the pixels: more than a clock would be off by."""
_REACH_STDS = 3.0
"""Spots from the line beyond which no pulse is believed to lean more."""


def asks_for_slanted_spots(fit: JointFit, setting: Setting) -> bool:
    """Whether the pulses of a fine fit lean to the sides of their legs, by more than chance.

    Parameters
    ----------
    fit : JointFit
        With fine pictures, and round spots.
    setting : Setting
        As told.

    Returns
    -------
    bool
        By twice what Schwarz asks for as many numbers: spots stay round where they may be. Not
        where delays that grow across the picture explain as much: these move the path, and the
        verdict is to see them.
    """
    if fit.slanted:
        return False
    leans, askew = _leans(fit, setting), _delays_askew(fit)
    n, k = leans.shape
    gained = _gained(fit, leans)
    as_delays = _gained(fit, askew) - 2.0 * price(askew.shape[1], n)
    return gained > 4.0 * price(k, n) and gained - 2.0 * price(k, n) > as_delays


def _gained(fit: JointFit, by_time: Floats) -> float:
    """By how much chi-square would fall with one-sigma columns (n, k) of the times free."""
    solution = fit.solution
    columns = np.zeros((len(solution.rows), by_time.shape[1]))
    columns[: len(by_time)] = by_time * np.sqrt(fit.times.weights(fit.floor_ps**2))[:, np.newaxis]
    shared = solution.columns.T @ columns
    information = columns.T @ columns - shared.T @ solution.covariance @ shared
    score = columns.T @ solution.rows
    return float(score @ np.linalg.solve(information + np.eye(len(score)), score))


def _delays_askew(fit: JointFit) -> Floats:
    """(n, 2 v), one-sigma columns of delays that grow down and across each camera's pixels, ps."""
    columns = []
    for view, camera in enumerate(fit.solution.cameras):
        own = np.ones(len(fit.times.leg)) if fit.times.view is None else fit.times.view == view
        for place, size in zip((fit.times.row, fit.times.col), camera.shape, strict=True):
            columns.append(own * _ASKEW_STD_PS * (2.0 * place / (size - 1.0) - 1.0))
    return np.column_stack(columns)


def with_slanted_spots(fit: JointFit, setting: Setting) -> JointFit:
    """The fit with leaning times as errors that the pulses of a leg share, where spots are slanted.

    Parameters
    ----------
    fit : JointFit
        With fine pictures.
    setting : Setting
        As told.

    Returns
    -------
    JointFit
        Whose last shared errors these are.
    """
    if not fit.slanted:
        return replace(fit, n_leaning=0)
    leans = _leans(fit, setting)
    modes = np.hstack((fit.times.modes_ps, leans))
    return replace(fit, times=replace(fit.times, modes_ps=modes), n_leaning=leans.shape[1])


def leaning_ps(fit: JointFit) -> Floats:
    """(n,), by how much each pulse of a fit leans, as it was solved, ps.

    Parameters
    ----------
    fit : JointFit
        Whose active areas, if any are fitted, are its last shared errors.

    Returns
    -------
    array of float, shape (n,)
    """
    last = fit.times.modes_ps.shape[1] - len(fit.active_px)
    own = slice(last - fit.n_leaning, last)
    found: Floats = fit.times.modes_ps[:, own] @ fit.solution.modes[own]
    return found


def _leans(fit: JointFit, setting: Setting) -> Floats:
    """(n, k), one-sigma columns of the times, ps: one of each leg in each camera's picture."""
    n_legs = fit.solution.state.n_legs
    leans = np.zeros((len(fit.times.leg), n_legs * len(fit.solution.cameras)))
    for some in pulses_by_leg(fit, setting):
        along, across = some.line.along_across(some.points_px)
        spot = some.light.spot_std_at(along)
        column = fit.sightings[some.number].view * n_legs + some.leg
        leans[some.rows, column] = one_sigma_ps(some.prints.slope_ps_per_px, across, spot)
    return leans[:, leans.any(axis=0)]


def one_sigma_ps(slope_ps_per_px: Floats, across_px: Floats, spot_px: Floats) -> Floats:
    """(n,), by how much times lean at places beside a leg where its spots are slanted, ps.

    Parameters
    ----------
    slope_ps_per_px : array of float, shape (n,)
        Of the times along the leg.
    across_px : array of float, shape (n,)
        Places, from the line.
    spot_px : array of float, shape (n,)
        Standard deviation of the spot there.

    Returns
    -------
    array of float, shape (n,)
        Of one standard deviation of the slant.
    """
    reach = _REACH_STDS * spot_px
    late: Floats = _SLANT_STD * slope_ps_per_px * np.clip(across_px, -reach, reach)
    return late
