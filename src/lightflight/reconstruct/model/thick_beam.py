"""A beam that is thick: how mirrors and apertures cut it, and what a pixel then sees of a leg.

The spot of a leg is made by the lens and by the beam's own thickness. Away from corners the two
look alike. At a corner they do not: the lens blurs the end of a thin beam alike in all directions,
and a mirror cuts a thick one along its own plane, aslant, the more so the more grazing it is. One
owner for that cut.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.footing import Corners, Footing, Moment, footing
from lightflight.reconstruct.model.geometry import PathState
from lightflight.vectors import unit

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

BEAM_SHARE_STD = 0.5
"""Of the spot's variance, what of it is the beam's; about none: a usual beam is a millimetre thick,
a usual pixel sees several, but nobody is surprised by a beam that makes all of the spot."""
BEAM_SHARES = (-0.3, 0.95)
"""Shares of the spot's variance that a fit may try. Where there is no such beam half of all
recordings ask for less than none; some of the spot is always the lens'. At -1 a curve that ends in
the picture was sent far off: what goes on in straight lines is no beam there."""

USUAL_SPOT_PX = 0.4
"""Standard deviation of the spot of a usual lens, px."""
CLEAR_OF_CORNER_PX = 1.5
"""Pixels this near to a corner in the picture belong to no one leg, px: both legs light them."""
_CLEAR_STDS = 3.0
"""The same in standard deviations of the place where a mirror cuts a thick beam: there 0.4 % of one
are left of the shift of the mean time."""

OWN_SHARE, OWN_SHARE_STD = 0.5, 0.5
"""Of what a leg's spot is wider than that of the narrowest, what of it is the beam's, and how well
that is known: none where the lens is out of focus, all where the beam fans out. And how much the
beam is wider in depth, over that width: as much where it is round, none behind a mirror that shakes
about one axis."""
OWN_SHARES = (-0.5, 1.5)
"""Of either, what a fit may try: of none half of all recordings ask for less."""
_LEAST_IN_TIME = 0.1
"""Of the spot's variance, at least, what spreads light over time."""
_MOST_SHARE = 0.95
"""Of the spot's variance, the beam's at most."""

_GRAZING = 0.25
"""Sine of the least angle between beam and mirror: labs turn light by 30 degrees and more, and what
turns by less is taken for a curve, or no corner, and for cut square to the flight."""
_LEAST_CUT = 0.1
"""Of the spot's variance, that of a cut at least: one that is sharper cannot be told."""
_STEP = 1e-6
"""Of the derivatives by the beam's shares."""


@dataclass(frozen=True, eq=False)
class Slant:
    """How the ends of a leg cut a thick beam; `before` and `after` it.

    Attributes
    ----------
    leans : (float, float)
        By how much light goes on longer, px along the leg's image per px to its right.
    deepens : (float, float)
        The same per px away from the flight in depth, towards the camera; 1 is as the lens blurs.
    towards : (float, float)
        Cosine of the angle between the flight and the way to the camera.
    """

    leans: tuple[float, float]
    deepens: tuple[float, float]
    towards: tuple[float, float]


def slant_of_leg(state: PathState, leg: int, camera: Camera) -> Slant:
    r"""How mirrors at both ends of a leg cut it, as a camera sees it.

    Light at the place a right of the flight and c before it, across it in the plane of flight and
    camera, meets a mirror of normal m after :math:`-(a\,m e_a + c\,m e_c) / m d` more of its way.
    Where a path begins or ends the cut is square to the flight.

    Parameters
    ----------
    state : PathState
        The path.
    leg : int
        One that a picture shows.
    camera : Camera
        The camera that sees it.
    """
    found = []
    for vertex, place in ((int(state.leg_starts[leg]), 0.0), (leg + 1, 1.0)):
        flight = unit(state.tangents_mm(leg, np.array([place]))[0])
        corner = state.vertices_mm[vertex]
        back = camera.way_back(corner[np.newaxis], return_group_index=1.0)
        to_camera = unit(-back.optical_by_point[0])
        cos = float(flight @ to_camera)
        sin = max(float(np.sqrt(max(1.0 - cos**2, 0.0))), 1e-6)
        right = np.cross(flight, to_camera) / sin
        # A picture that is shown mirrored has its right on the other side.
        shown = np.nan_to_num(camera.pixel_jacobian(corner))
        (row_ahead, col_ahead), (row_right, col_right) = shown @ flight, shown @ right
        side = 1.0 if row_right * col_ahead - col_right * row_ahead >= 0.0 else -1.0
        before_it = (to_camera - cos * flight) / sin
        normal = _mirror(state, vertex)
        ahead = float(normal @ flight)
        lean, deep = 0.0, 0.0
        if abs(ahead) > _GRAZING:
            lean, deep = -side * float(normal @ right) / ahead, -float(normal @ before_it) / ahead
        found.append((sin * lean, sin * deep - cos, cos))
    (lean, deep, cos), (lean_after, deep_after, cos_after) = found
    return Slant((lean, lean_after), (deep, deep_after), (cos, cos_after))


def _mirror(state: PathState, vertex: int) -> Floats:
    """(3,), unit normal of the mirror at a vertex; zeros where a path begins or ends, and on faces
    of glass.
    """
    leaving = [k for k in range(state.n_legs) if state.leg_starts[k] == vertex]
    if vertex == 0 or not leaving or vertex in state.on_faces:
        return np.zeros(3)
    into = unit(state.tangents_mm(vertex - 1, np.ones(1))[0])
    turns = [unit(state.tangents_mm(k, np.zeros(1))[0]) - into for k in leaving]
    # Of the arms of a splitter one goes straight on: the other shows the plane.
    turn = max(turns, key=lambda each: float(each @ each))
    return unit(turn)


def share_beyond_lens(spot_px: float) -> float:
    """What of a spot's variance is more than a usual lens makes."""
    return max(0.0, 1.0 - (USUAL_SPOT_PX / spot_px) ** 2)


def clear_of_corners_px(
    state: PathState, leg: int, camera: Camera, spot_px: float, *, share: float
) -> tuple[float, float]:
    """How near to the corners at its start and at its end a leg's light may be cut, px.

    Parameters
    ----------
    state : PathState
        The path.
    leg : int
        One that a picture shows.
    camera : Camera
        The camera that sees it.
    spot_px : float
        Standard deviation of the spot, px.
    share : float
        Of its variance, what may be the beam's.
    """
    if state.n_legs == 1:
        return CLEAR_OF_CORNER_PX, CLEAR_OF_CORNER_PX
    slant = slant_of_leg(state, leg, camera)
    ends = np.array(camera.pixels_from_points(state.points_mm(leg, np.array([0.0, 1.0]))))
    long_px = float(np.nan_to_num(np.linalg.norm(ends[:, 1] - ends[:, 0])))
    # A short leg is left half of its light.
    most = max(CLEAR_OF_CORNER_PX, 0.25 * long_px)
    stds = np.sqrt(_cut_variance(np.array(slant.leans), np.array(slant.deepens), share, share))
    # No farther than ever where no mirror cuts the beam longer than a lens blurs it.
    reach = np.where(stds > 1.0, _CLEAR_STDS * spot_px * stds, CLEAR_OF_CORNER_PX)
    first, last = np.clip(reach, CLEAR_OF_CORNER_PX, most)
    return float(first), float(last)


def _cut_variance(
    lean: Floats, deep: Floats, share: Floats | float, deep_share: Floats | float
) -> Floats:
    """Of the place along the leg at which light is cut, over the spot's variance."""
    variance: Floats = 1.0 - share + share * (1.0 - share) * lean**2 + deep_share * deep**2
    return variance


@dataclass(frozen=True, eq=False)
class BeamShares:
    """What of the spot's variance is the beam's in n pixels of a leg, and how it follows.

    Attributes
    ----------
    common : float
        Share that is the beam's in all legs.
    own : (float, float)
        Share that is this leg's beam's of what its spot is wider than the narrowest, and how wide
        that beam is in depth, over the same.
    across : array of float, shape (n,)
        The beam's share of the variance.
    deep : array of float, shape (n,)
        Its variance in depth, over that of the spot.
    across_by, deep_by : array of float, shape (3, n)
        Their derivatives by common and own shares.
    across_by_log_spot, deep_by_log_spot : array of float, shape (n,)
    lens_px2 : array of float, shape (n,)
        Variance of the narrowest spot; 0 where this one is no wider.
    """

    common: float
    own: tuple[float, float]
    across: Floats
    deep: Floats
    across_by: Floats
    deep_by: Floats
    across_by_log_spot: Floats
    deep_by_log_spot: Floats
    lens_px2: Floats

    def fanned_px2(self, towards: Floats) -> tuple[Floats, Floats]:
        """How much less than a lens' the light's variance grows that comes late, and derivatives.

        Parameters
        ----------
        towards : array of float, shape (n,)
            Cosine of the angle between the flight and the way to the camera.

        Returns
        -------
        fanned : array of float, shape (n,)
            Over twice the growth of the log of the spot; so much times that nearer is the light.
        by : array of float, shape (3, n)
            By common and own shares.
        """
        (own, deep), common = self.own, self.common
        fanned = (1.0 - common) * own + towards * (deep - common * own)
        by = (-own - towards * own, 1.0 - common - towards * common, towards)
        return self.lens_px2 * fanned, self.lens_px2 * np.array(by)


def beam_shares(
    common: float, own: tuple[float, float], spot_px: Floats, lens_var_px2: float
) -> BeamShares:
    r"""What of the spot's variance is the beam's along a leg.

    Parameters
    ----------
    common : float
        Share of the spot's variance that is the beam's in all legs.
    own : (float, float)
        Share that is this leg's beam's of what its spot is wider than the narrowest, and how wide
        that beam is in depth, over the same.
    spot_px : array of float, shape (n,)
        Standard deviation of the spot, px.
    lens_var_px2 : float
        Variance of the narrowest spot.

    Returns
    -------
    BeamShares

    Notes
    -----
    Of the variance v the lens makes :math:`v_l = (1 - \beta) ((1 - \theta) v + \theta v_0)`,
    :math:`\beta` and :math:`\theta` the two shares and :math:`v_0` that of the narrowest spot. In
    depth the beam has :math:`\beta ((1 - \theta) v + \theta v_0) + \theta_d (v - v_0)`.
    """
    theta, deep = own
    wider = np.maximum(1.0 - lens_var_px2 / spot_px**2, 0.0)
    # What of it grows with the log of the spot.
    grows = 2.0 * np.where(wider > 0.0, 1.0 - wider, 0.0)
    left, none = 1.0 - theta * wider, np.zeros_like(spot_px)
    return BeamShares(
        common, own,
        across=np.minimum(1.0 - (1.0 - common) * left, _MOST_SHARE),
        deep=common * left + deep * wider,
        across_by=np.array((left, (1.0 - common) * wider, none)),
        deep_by=np.array((left, -common * wider, wider)),
        across_by_log_spot=(1.0 - common) * theta * grows,
        deep_by_log_spot=(deep - common * theta) * grows,
        lens_px2=np.where(wider > 0.0, lens_var_px2, 0.0),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ThickFooting:
    """Moments of the footprints on a leg of a thick beam; each of (n,).

    Attributes
    ----------
    feet : Footing
        The moments, as of a thin beam.
    by_across : tuple of array of float
        Of log share, time and variance, by the distance of a pixel from the leg, per px.
    by_share : tuple of array of float
        Of the same three, by the beam's share of the spot's variance.
    by_deep : tuple of array of float
        And by its variance in depth.
    towards : array of float, shape (n,)
        Cosine of the angle between the flight and the way to the camera.
    """

    feet: Footing
    by_across: tuple[Floats, ...]
    by_share: tuple[Floats, ...]
    by_deep: tuple[Floats, ...]
    towards: Floats


def thick_footing(
    log_slope: Floats,
    time_slope: Floats,
    time_curvature: Floats,
    corners: Corners,
    slant: Slant,
    *,
    spot_px: Floats,
    across_px: Floats,
    share: Floats | float,
    deep: Floats | float | None = None,
) -> ThickFooting:
    r"""`footing` under a spot of which the beam's own thickness makes a share of the variance.

    Parameters
    ----------
    log_slope, time_slope, time_curvature, corners
        As for `footing`.
    slant : Slant
        How the leg's ends cut it.
    spot_px : array of float, shape (n,)
        Standard deviation of the spot, px.
    across_px : array of float, shape (n,)
        Distance of the pixels from the leg, to its right, px.
    share : array of float, shape (n,) or float
        Of the spot's variance.
    deep : array of float, shape (n,) or float, optional
        Variance of the beam in depth, over the spot's; None: that share, since the beam is round.

    Returns
    -------
    ThickFooting

    Notes
    -----
    Of spot variance v the share :math:`\beta` is the beam's. The light of a pixel y right of the
    leg comes from :math:`\xi` ahead of its foot by the lens, of variance :math:`(1 - \beta) v`,
    from a to the right, about :math:`\beta y` by :math:`\beta (1 - \beta) v`, and from c towards
    the camera by :math:`\beta_d v`. It is late by :math:`t'(\xi - c)`, and is there where
    :math:`q = \xi - A a - K c` is short of the corner. What hangs on q is a footprint of its spread
    cut at the corner; the rest is not cut.
    """
    nearest = _at_nearest(corners, slant)
    told = log_slope, time_slope, time_curvature, corners, nearest, spot_px, across_px
    deep = share if deep is None else deep
    # There is no beam of less than no thickness: below, all goes on as at none, in straight lines.
    real, there = np.maximum(share, 0.0), np.maximum(deep, 0.0)
    feet = _moments(*told, real, there)
    by_share = _risen(feet, _moments(*told, real + _STEP, there))
    by_deep = _risen(feet, _moments(*told, real, there + _STEP))
    less = np.minimum(share, 0.0), np.minimum(deep, 0.0)
    if np.any(less):
        log_share, offset, width = (
            replace(one, value=one.value + less[0] * across + less[1] * by)
            for one, across, by in zip(_three(feet), by_share, by_deep, strict=True)
        )
        feet = Footing(log_share, offset, width, feet.third_ps3)
    # To the right the corner lies farther.
    lean = nearest[0]
    by_across = [share * lean * (each.by_before + each.by_after) for each in _three(feet)]
    return ThickFooting(feet, tuple(by_across), by_share, by_deep, nearest[2])


def _three(feet: Footing) -> tuple[Moment, Moment, Moment]:
    return feet.log_share, feet.offset_ps, feet.variance_ps2


def _risen(here: Footing, there: Footing) -> tuple[Floats, ...]:
    """Derivatives of the three moments over a step."""
    pairs = zip(_three(here), _three(there), strict=True)
    return tuple((after.value - before.value) / _STEP for before, after in pairs)


def _at_nearest(corners: Corners, slant: Slant) -> tuple[Floats, Floats, Floats]:
    """Lean, depth and cosine (n,) of the corner that is nearer to each pixel."""
    first = np.abs(corners.before) <= np.abs(corners.after)
    lean, deep, cos = (
        np.where(first, *each) for each in (slant.leans, slant.deepens, slant.towards)
    )
    return lean, deep, cos


def _moments(
    log_slope: Floats,
    time_slope: Floats,
    time_curvature: Floats,
    corners: Corners,
    nearest: tuple[Floats, Floats, Floats],
    spot_px: Floats,
    across_px: Floats,
    share: Floats,
    deep_share: Floats,
) -> Footing:
    """The moments for one share across and one in depth; their derivatives at fixed ones."""
    lean, deep, cos = nearest
    # Variances and covariances of cut q, time in px and place along the leg, over the spot's.
    cut = np.maximum(_cut_variance(lean, deep, share, deep_share), _LEAST_CUT)
    in_time = np.maximum(1.0 - share + deep_share, _LEAST_IN_TIME)
    time_cut, time_place = 1.0 - share + deep_share * deep, 1.0 - share - deep_share * cos
    place_cut = 1.0 - share - deep_share * deep * cos
    moved = share * lean * across_px
    shifted = Corners(
        corners.before + moved, corners.after + moved,
        corners.before_by_state, corners.after_by_state,
    )  # fmt: skip
    variance = spot_px**2
    feet = footing(
        log_slope * place_cut / cut, time_slope * time_cut / cut, time_curvature, shifted,
        spot_px=np.sqrt(cut) * spot_px,
    )  # fmt: skip
    # What of time and place does not hang on the cut.
    uneven = variance * time_slope * (time_place - time_cut * place_cut / cut)
    bowed = 0.5 * time_curvature * variance * (1.0 - cut)
    spread = variance * time_slope**2 * np.maximum(in_time - time_cut**2 / cut, 0.0)
    by_slope = place_cut / cut
    share_, offset, width = feet.log_share, feet.offset_ps, feet.variance_ps2
    none = np.zeros_like(spot_px)
    return Footing(
        _more(share_, none, none, by_slope),
        _more(offset, log_slope * uneven + bowed, uneven, by_slope),
        _more(width, spread, none, by_slope),
        feet.third_ps3,
    )


def _more(moment: Moment, value: Floats, by_slope: Floats, factor: Floats) -> Moment:
    """A moment and what is not cut, which grows with the spot's variance."""
    return Moment(
        moment.value + value,
        factor * moment.by_slope + by_slope,
        moment.by_log_spot + 2.0 * value,
        moment.by_before,
        moment.by_after,
    )
