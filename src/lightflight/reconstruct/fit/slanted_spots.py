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
        By twice what Schwarz asks for as many numbers: spots stay round where they may be.
    """
    if fit.slanted:
        return False
    solution, leans = fit.solution, _leans(fit, setting)
    columns = np.zeros((len(solution.rows), leans.shape[1]))
    columns[: len(leans)] = leans * np.sqrt(fit.times.weights(fit.floor_ps**2))[:, np.newaxis]
    shared = solution.columns.T @ columns
    information = columns.T @ columns - shared.T @ solution.covariance @ shared
    score = columns.T @ solution.rows
    gained = float(score @ np.linalg.solve(information + np.eye(len(score)), score))
    return gained > 4.0 * price(len(score), len(leans))


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
