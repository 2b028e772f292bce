"""What a climb may move besides the path: the light of its legs, and where each number sits.

One vector holds the path's freedom, shared errors of clock and light, those of camera and medium,
and the light itself: its strength along each leg, its spot and the width of its pulse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.geometry import Indices
from lightflight.reconstruct.model.leg_in_picture import LegInPicture
from lightflight.reconstruct.model.strength import LOG_SPOT_RANGE, SpotAlong
from lightflight.reconstruct.model.thick_beam import BEAM_SHARES, OWN_SHARES

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Light:
    """Everything about the light that is not the path.

    Attributes
    ----------
    lines : tuple of LegInPicture
        Where along each leg's image the strength is measured.
    knots : tuple of arrays
        Knots of the cubic log-strength of each leg, px along its line.
    coefficients : tuple of arrays
        Spline coefficients of the log of photons per pixel on the line.
    log_spot_px : float
        Log of the spot's standard deviation, px.
    log_std_ps : float
        Log of the standard deviation of laser pulse and response, ps.
    log_scatter : tuple of float
        Per leg, scatter of ln(photons) from pixel to pixel that the model does not explain.
    cut_ends : tuple of bool
        Whether the light begins at the path's first vertex, and stops at its last.
    spots : tuple of SpotAlong
        How the spot of each leg differs from that of all; (): it does not.
    active_px : float
        Side of the pixels' active area, which makes that spot with the lens; 0: it is a Gaussian.
    beam_share : float or None
        Share of the spot's variance that is the beam's own thickness, which corners cut otherwise;
        None: no corner is seen that would tell.
    own_shares : tuple of (float, float)
        Of each leg, share of what its spot is wider than the narrowest that is the beam's, and how
        wide that beam is in depth, over the same; (): all spots are alike.
    lens_var_px2 : float
        Variance of that narrowest spot, px^2.
    """

    lines: tuple[LegInPicture, ...]
    knots: tuple[Floats, ...]
    coefficients: tuple[Floats, ...]
    log_spot_px: float
    log_std_ps: float
    log_scatter: tuple[float, ...]
    cut_ends: tuple[bool, ...] = (False, False)
    spots: tuple[SpotAlong, ...] = ()
    active_px: float = 0.0
    beam_share: float | None = None
    own_shares: tuple[tuple[float, float], ...] = ()
    lens_var_px2: float = 0.0


@dataclass(frozen=True, eq=False)
class Layout:
    """Where each kind of parameter sits in the vector of P.

    Attributes
    ----------
    n_free : int
        Freedom of the path.
    n_modes : int
        Shared errors of clock and light.
    spline_starts : tuple of int
        First coefficient of each leg's log-strength.
    size : int
        P; the last two are log spot and log std.
    n_shared : int
        Shared errors of camera and medium.
    spot_starts : tuple of int
        First number of each leg's own spot; (): all legs have one.
    beam : int or None
        Place of the beam's share of the spot; None: it is not asked for.
    own_shares : tuple of int
        First place of each leg's own two; (): they are not asked for.
    """

    n_free: int
    n_modes: int
    spline_starts: tuple[int, ...]
    size: int
    n_shared: int = 0
    spot_starts: tuple[int, ...] = ()
    beam: int | None = None
    own_shares: tuple[int, ...] = ()

    @property
    def unit_priors(self) -> slice:
        """Parameters counted in their own standard deviations: modes, then shared errors."""
        return slice(self.n_free, self.n_free + self.n_modes + self.n_shared)

    @property
    def of_path_and_shared(self) -> Indices:
        """Places of the path's freedom and of the shared errors of camera and medium."""
        first = self.n_free + self.n_modes
        places: Indices = np.r_[0 : self.n_free, first : first + self.n_shared]
        return places


def layout_of(n_free: int, n_modes: int, light: Light, n_shared: int = 0) -> Layout:
    """Order of the parameters: path, modes, shared errors, splines and then spots leg by leg, the
    beam's shares of the spots where they are asked for, and last the log of the spot of all and of
    the pulse's std.

    Parameters
    ----------
    n_free : int
        Columns of the path's freedom.
    n_modes : int
        Shared clock errors.
    light : Light
        Brightness, spot and pulse width.
    n_shared : int, optional
        Shared errors of camera and medium.

    Returns
    -------
    Layout
        And the number of parameters.
    """
    starts, at = [], n_free + n_modes + n_shared
    for coefficients in light.coefficients:
        starts.append(at)
        at += len(coefficients)
    spots = tuple(at + 3 * k for k in range(len(light.spots)))
    at += 3 * len(spots)
    beam = None if light.beam_share is None else at
    at += beam is not None
    own = tuple(at + 2 * k for k in range(len(light.own_shares)))
    size = at + 2 * len(own) + 2
    return Layout(n_free, n_modes, tuple(starts), size, n_shared, spots, beam, own)


def moved_light(light: Light, step: Floats, layout: Layout) -> Light:
    """The light after a step of the parameters; widths keep within sane bounds.

    Parameters
    ----------
    light : Light
        Brightness, spot and pulse width.
    step : array of float, shape (P,)
    layout : Layout
        Where each kind of parameter sits.

    Returns
    -------
    Light
        Lines and knots stay.
    """
    coefficients = tuple(
        c + step[start : start + len(c)]
        for c, start in zip(light.coefficients, layout.spline_starts, strict=True)
    )
    spots = tuple(
        replace(spot, varies_ln=spot.varies_ln + np.clip(step[start : start + 3], -0.5, 0.5))
        for spot, start in zip(light.spots, layout.spot_starts, strict=True)
    )
    share = light.beam_share
    if share is not None and layout.beam is not None:
        share = float(np.clip(share + step[layout.beam], *BEAM_SHARES))
    return replace(
        light,
        coefficients=coefficients,
        spots=spots,
        beam_share=share,
        own_shares=tuple(
            (float(across), float(deep))
            for across, deep in (
                np.clip(own + step[start : start + 2], *OWN_SHARES)
                for own, start in zip(np.array(light.own_shares), layout.own_shares, strict=True)
            )
        ),
        log_spot_px=float(np.clip(light.log_spot_px + step[-2], *LOG_SPOT_RANGE)),
        log_std_ps=float(light.log_std_ps + np.clip(step[-1], -0.5, 0.5)),
    )


def pushed_over_edges(light: Light, layout: Layout, score: Floats) -> list[int]:
    """Places of shares that stand at an edge of what a fit may try, and would go on over it.

    Parameters
    ----------
    light : Light
        Brightness, spot and pulse width.
    layout : Layout
        Where each kind of parameter sits.
    score : array of float, shape (P,)
        Slope of the likelihood.

    Returns
    -------
    list of int
        The other parameters are then where they should be without these.
    """
    shares = [] if layout.beam is None else [(layout.beam, light.beam_share, BEAM_SHARES)]
    for first, own in zip(layout.own_shares, light.own_shares, strict=True):
        shares += [(first + k, share, OWN_SHARES) for k, share in enumerate(own)]
    return [
        place
        for place, share, (least, most) in shares
        if (share == least and score[place] < 0.0) or (share == most and score[place] > 0.0)
    ]
