"""Spots that are no circles: beside a leg a pixel sees light from ahead of its foot, or behind it.

Lenses make ellipses of points, off their axis and where they stand askew. With a spot of covariance
C, along (a) and across (c) a leg, a pixel at y from the line sees the light of a place that is
y C_ac / C_cc behind its foot: times lean, one way on one side of the line and the other way on
the other. How much is a number of each leg in each camera's picture, which is fitted where the
pulses ask for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.joint import JointFit, score_of_unfitted
from lightflight.reconstruct.fit.uneven import pulses_by_leg, stacked_by_leg
from lightflight.reconstruct.model.forward import Pixels
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.unequal import price
from lightflight.reconstruct.model.unknowns import Light

Floats = NDArray[np.float64]

_SLANT_STD = 0.3
"""Standard deviation of -C_ac / C_cc: an ellipse at 45 degrees to a leg has 0.22 where its axes are
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
        By twice what Schwarz asks for as many numbers: spots stay round where they may be. Always
        free, leaning times would cost round spots a hundredth of the error, and hide delays that
        grow across the picture: 10 ps at its edge are a slant of 0.04, and move corners by 1 mm.
        Where these explain as much it is no, therefore: the verdict is to see them.
    """
    if fit.slanted:
        return False
    leans, askew = stacked_by_leg(_leans(fit, setting), fit), _delays_askew(fit)
    n, k = leans.shape
    gained = _gained(fit, leans)
    as_delays = _gained(fit, askew) - 2.0 * price(askew.shape[1], n)
    return gained > 4.0 * price(k, n) and gained - 2.0 * price(k, n) > as_delays


def _gained(fit: JointFit, by_time: Floats) -> float:
    """By how much chi-square would fall with one-sigma columns (n, k) of the times free."""
    score, information = score_of_unfitted(fit, by_time)
    return float(score @ np.linalg.solve(information, score))


def _delays_askew(fit: JointFit) -> Floats:
    """(n, 2 v), one-sigma columns of delays that grow down and across each camera's pixels, ps."""
    columns = []
    for view, camera in enumerate(fit.solution.cameras):
        own = fit.times.view == view
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
        return replace(fit, leaning=())
    leans = _leans(fit, setting)
    modes = np.hstack((fit.times.modes_ps, stacked_by_leg(leans, fit)))
    return replace(fit, times=replace(fit.times, modes_ps=modes), leaning=tuple(leans))


def slants_found(fit: JointFit) -> dict[tuple[int, int], tuple[float, float]]:
    """How far ahead of its foot a pixel sees, for each pixel to the right of a leg, and its error.

    Parameters
    ----------
    fit : JointFit
        As solved.

    Returns
    -------
    dict of (int, int) to (float, float)
        By camera and leg; empty where spots are round.
    """
    own = fit.leaning_modes
    variance = np.diag(fit.solution.covariance)[fit.freedom.basis.shape[1] :][own]
    slants = _SLANT_STD * fit.solution.modes[own]
    stds = _SLANT_STD * np.sqrt(variance)
    return dict(zip(fit.leaning, zip(slants.tolist(), stds.tolist(), strict=True), strict=True))


def statements_of_slanted_spots(fit: JointFit) -> tuple[str, ...]:
    """That the spots are no circles, one sentence for each leg.

    Parameters
    ----------
    fit : JointFit
        As solved.
    """
    several = len(fit.solution.cameras) > 1
    return tuple(
        f"Spots are no circles: beside leg {leg + 1}{f' of camera {view + 1}' if several else ''} "
        f"pixels see light from {at:+.3f} ± {std:.3f} px ahead of their foot for each pixel to its "
        "right."
        for (view, leg), (at, std) in slants_found(fit).items()
    )


def _leans(fit: JointFit, setting: Setting) -> dict[tuple[int, int], Floats]:
    """(n,), one-sigma columns of the times, ps, by camera and leg."""
    leans: dict[tuple[int, int], Floats] = {}
    for some in pulses_by_leg(fit, setting):
        along, across = some.line.along_across(some.points_px)
        spot = some.light.spot_std_at(along)
        own = fit.sightings[some.number].view, some.leg
        column = leans.setdefault(own, np.zeros(len(fit.times.leg)))
        column[some.rows] = _one_sigma_ps(some.prints.slope_ps_per_px, across, spot)
    return leans


def with_leaning_times(pixels: Pixels, light: Light, state: PathState, setting: Setting) -> Pixels:
    """The pixels of all counts with leaning times as errors that those of a leg share.

    Parameters
    ----------
    pixels : Pixels
        Of one camera.
    light : Light
        Where its legs run.
    state : PathState
        The path as it is now.
    setting : Setting
        With that camera as it was found.

    Returns
    -------
    Pixels
        With a column a leg more.
    """
    leans = np.zeros((*pixels.near.shape, pixels.near.shape[1]))
    for leg in state.seen:
        here = np.flatnonzero(pixels.near[:, leg])
        prints = footprints(
            state, camera=setting.camera, medium=setting.medium, legs=leg,
            rows=pixels.rows[here], cols=pixels.cols[here],
        )  # fmt: skip
        _, across = light.lines[leg].along_across(pixels.points_px[here])
        spot = np.full(len(here), np.exp(light.log_spot_px))
        leans[here, leg, leg] = np.nan_to_num(_one_sigma_ps(prints.slope_ps_per_px, across, spot))
    return replace(pixels, modes_ps=np.concatenate((pixels.modes_ps, leans), axis=2))


def _one_sigma_ps(slope_ps_per_px: Floats, across_px: Floats, spot_px: Floats) -> Floats:
    """(n,), by how much times lean beside a leg for one standard deviation of its slant, ps."""
    reach = _REACH_STDS * spot_px
    late: Floats = _SLANT_STD * slope_ps_per_px * np.clip(across_px, -reach, reach)
    return late
