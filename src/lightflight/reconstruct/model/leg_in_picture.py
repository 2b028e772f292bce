"""The images of legs: where they run in the picture, and which pixels their light reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from lightflight.errors import GeometryError
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import along_across, undistorted_px

if TYPE_CHECKING:
    from lightflight.camera.model import Camera


Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_BOW_DEGREE = 6
"""Of the polynomial that bows a leg's image: 1e-6 px from the image through a tank at 30 deg."""
_BENT_DEGREE = 12
"""The same of a leg that is a curve: 1e-4 px where it turns by 60 deg over the picture."""
_FOOT_STEPS = 6
"""Of Newton's method from a pixel to the nearest place of a bowed image."""
_BOW_PLACES = 33
"""That it is fitted to, evenly along the leg."""
_LEAST_BOWED_PX = 2.0
"""A shorter image is straight to 1e-3 px."""
_BEYOND_PX = 1.5
"""Of the ends of a leg, px: there the spot of a lens still spreads its light."""
_LIT_PX = 2.5
"""Pixels this near to the line of a piece may hold its light, px: six stds of a usual spot."""


@dataclass(frozen=True, eq=False)
class LegInPicture:
    """Image of one leg, in undistorted pixels.

    Attributes
    ----------
    origin_px : array of float, shape (2,)
        (u, v).
    direction_px : array of float, shape (2,)
        Unit, in the direction of flight.
    span_px : (float, float)
        First and last position along the line that can show the leg, px.
    bow : Polynomial or None
        Distance of the image to the right of the line, px, by the position along it: a straight
        leg is bowed where the camera looks through an interface. None: it is straight.
    bent : bool
        Whether the leg itself is a curve, whose image may run steeply to the line: places are then
        told by their nearest point of it.
    """

    origin_px: Floats
    direction_px: Floats
    span_px: tuple[float, float]
    bow: Polynomial | None = None
    bent: bool = False

    @property
    def dark(self) -> bool:
        """Whether no picture shows the leg: its span is empty."""
        return self.span_px[0] > self.span_px[1]

    def along_across(self, points: Floats) -> tuple[Floats, Floats]:
        """Position along the line and distance to the image's right, of (n, 2) points; px."""
        along, across = along_across(points, self.origin_px, self.direction_px)
        if self.bow is None:
            return along, across
        if not self.bent:
            return along, across - self.bow(along)
        foot, slope = along, self.bow.deriv()
        for _ in range(_FOOT_STEPS):
            steep, aside = slope(foot), across - self.bow(foot)
            foot = foot + ((along - foot) + aside * steep) / (1.0 + steep**2)
        return foot, np.sign(aside) * np.hypot(along - foot, across - self.bow(foot))

    def heading_rad(self, along: Floats) -> Floats:
        """Direction of flight in the picture at places along the line, from u to v, rad."""
        heading = np.full(np.shape(along), np.arctan2(self.direction_px[1], self.direction_px[0]))
        return heading if self.bow is None else heading + np.arctan(self.bow.deriv()(along))

    def curvature(self, along: Floats) -> Floats:
        """1 / radius of a bent leg's image at places along it, per px, positive to the right.

        Light of a curve gathers on its inner side: beside it a spot of variance v is exp(k y / 2)
        times what it is beside a line, and its ridge lies v k / 2 inside of it.
        """
        if self.bow is None or not self.bent:
            return np.zeros(np.shape(along))
        steep = self.bow.deriv()(along)
        curvature: Floats = self.bow.deriv(2)(along) / (1.0 + steep**2) ** 1.5
        return curvature

    def points_px(self, along: ArrayLike, across: ArrayLike = 0.0) -> Floats:
        """Points (n, 2) at positions along the line and distances to the image's right, px."""
        along_ = np.asarray(along, dtype=float)
        aside = np.broadcast_to(across, along_.shape)
        if self.bow is not None and self.bent:
            # Square to the image, not to the line.
            steep, bowed = self.bow.deriv()(along_), self.bow(along_)
            along_ = along_ - aside * steep / np.hypot(1.0, steep)
            aside = aside / np.hypot(1.0, steep) + bowed
        elif self.bow is not None:
            aside = aside + self.bow(along_)
        right = np.array([-self.direction_px[1], self.direction_px[0]])
        points: Floats = (
            self.origin_px
            + along_[..., np.newaxis] * self.direction_px
            + aside[..., np.newaxis] * right
        )
        return points


DARK_LEG = LegInPicture(np.zeros(2), np.array([1.0, 0.0]), (np.inf, -np.inf))
"""Stands for a leg that runs outside of the picture: no pixel lies within its span."""


def leg_in_picture(state: PathState, leg: int, camera: Camera) -> LegInPicture:
    """Image of one leg, clipped to the picture with a margin of two pixels.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    leg : int
        Index of the leg.
    camera : Camera
        The camera that sees it.

    Returns
    -------
    LegInPicture
        Line and span, px.

    Raises
    ------
    GeometryError
        Where the leg does not cross the picture.
    """
    fraction, (row, col), inside = _places_in_picture(state, leg, camera)
    if inside.sum() < 2:
        raise GeometryError(
            f"leg {leg + 1} of the path does not cross the picture: check start, source and camera "
            "(lightflight check), or whether a leg runs outside of what the camera sees"
        )
    ends = np.flatnonzero(inside)[[0, -1]]
    uv = undistorted_px(camera, row[ends], col[ends])
    length = float(np.hypot(*(uv[1] - uv[0])))
    direction = (uv[1] - uv[0]) / max(length, 1e-12)
    line = LegInPicture(0.5 * (uv[0] + uv[1]), direction, (-0.5 * length, 0.5 * length))
    bent = bool(state.is_bent(np.array([leg]))[0])
    if not (camera.interfaces or bent) or length < _LEAST_BOWED_PX:
        return line
    between = np.linspace(fraction[ends[0]], fraction[ends[1]], _BOW_PLACES)
    places = camera.pixels_from_points(_along_chord(state, leg, between))
    along, across = line.along_across(undistorted_px(camera, *places))
    if bent and not (np.diff(along) > 0.0).all():
        raise GeometryError(
            f"leg {leg + 1} of the path turns by more than a right angle in the picture: make it "
            "two legs"
        )
    degree = _BENT_DEGREE if bent else _BOW_DEGREE
    bow, (_, rank, _, _) = Polynomial.fit(along, across, degree, full=True)
    # A trial that looks along the glass has places upon each other: no bow is known of its image.
    return replace(line, bow=bow, bent=bent) if rank > degree else line


def pixels_lit_from(places_mm: Floats, camera: Camera) -> NDArray[np.bool_]:
    """Pixels (rows, cols) that light of places (n, 3), world, mm, may reach in a picture."""
    lit = np.zeros(camera.shape, dtype=bool)
    places = places_mm[camera.sees(places_mm)]
    if len(places):
        pixels = np.moveaxis(np.indices(camera.shape, dtype=float), 0, -1)
        image = np.column_stack(camera.pixels_from_points(places))
        away = np.linalg.norm(pixels[..., np.newaxis, :] - image, axis=-1)
        lit = away.min(axis=-1) < _LIT_PX
    return lit


def crosses_picture(state: PathState, leg: int, camera: Camera) -> bool:
    """Whether a camera's picture, with a margin of two pixels, shows any of a leg."""
    return bool(_places_in_picture(state, leg, camera)[2].sum() >= 2)


def _places_in_picture(
    state: PathState, leg: int, camera: Camera
) -> tuple[Floats, tuple[Floats, Floats], Bools]:
    """Fractions (n,) of a leg, (row, col) of these, and which lie in the picture or just beside."""
    # A leg may enter and leave the view anywhere: steps, not a formula, see every lens.
    fraction = np.linspace(0, 1, 801)
    row, col = camera.pixels_from_points(_along_chord(state, leg, fraction))
    rows, cols = camera.shape
    with np.errstate(invalid="ignore"):
        inside = (row > -2.5) & (row < rows + 1.5) & (col > -2.5) & (col < cols + 1.5)
    return fraction, (row, col), inside


def _along_chord(state: PathState, leg: int, fraction: Floats) -> Floats:
    """Places (n, 3) on a leg, world, mm."""
    start, end, f = state.starts_mm[leg], state.vertices_mm[leg + 1], fraction[:, np.newaxis]
    points: Floats = (1 - f) * start + f * end
    for bend in (one for one in state.bends if one.leg == leg):
        points += bend.away_mm(fraction)
    return points


def lit_by_legs(
    legs: Sequence[LegInPicture],
    points_px: Floats,
    *,
    spot_px: float,
    beyond_px: Sequence[tuple[float, float]] | None = None,
) -> Bools:
    """(n, L), True where a leg's light reaches a pixel: four stds of the spot, or 2.5 px.

    Parameters
    ----------
    legs : tuple of LegInPicture
        Lines of the legs.
    points_px : array of float, shape (n, 2)
        Undistorted (u, v), px.
    spot_px : float
        Standard deviation of the spot, px.
    beyond_px : sequence of (float, float), optional
        How far light reaches beyond the start and the end of each leg, px; None: 1.5 px.

    Returns
    -------
    array of bool, shape (n, L)
    """
    reach = max(2.5, 4.0 * spot_px)
    near = np.zeros((len(points_px), len(legs)), dtype=bool)
    for k, leg in enumerate(legs):
        along, across = leg.along_across(points_px)
        low, high = leg.span_px
        before, after = (_BEYOND_PX, _BEYOND_PX) if beyond_px is None else beyond_px[k]
        near[:, k] = (along > low - before) & (along < high + after) & (np.abs(across) < reach)
    return near
