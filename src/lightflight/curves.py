"""Curves that light is known to run along: a fibre's centre line, drawn from measured places.

A circle and a parabola are places, too, that nobody had to measure.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import POSITIVE, finite_number, finite_numbers
from lightflight.errors import LimitError

Floats = NDArray[np.float64]

FEWEST_POINTS = 4
"""That draw a curve and not a line: both ends, and two between."""
MOST_POINTS = 200
"""More places than this tell no smooth curve better, and each costs in every step of a fit."""
_MOST_TURN_DEG = 45.0
"""Std of the turn of a whole curve: who knows less of how it stands does not know it."""
_PLACES = 33
"""Of a circle or a parabola."""


@dataclass(frozen=True)
class DrawnCurve:
    """The curve that one leg runs along, by places on it in the order of flight.

    Raises ValueError for places that draw none, LimitError for too many.

    Attributes
    ----------
    points_mm : ArrayLike
        (n, 3), 4 to 200 places on the curve, world, mm. Light may enter and leave anywhere on it.
    leg : int
        Which leg, from 0.
    point_std_mm : float
        One-sigma error of each place by itself, mm: how far from the curve it was measured.
    position_std_mm : float
        Of the whole curve, all places alike, on each axis, mm. 0: it stands where it was told.
    turn_std_deg : float
        Of the whole curve about the middle of its places, about each axis, deg.
    """

    points_mm: ArrayLike

    leg: int = field(default=0, kw_only=True)

    point_std_mm: float = field(kw_only=True)

    position_std_mm: float = field(default=0.0, kw_only=True)

    turn_std_deg: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        must = f"be {FEWEST_POINTS} to {MOST_POINTS} rows (x, y, z) in mm"
        points = np.asarray(self.points_mm)
        if len(points.shape) == 2 and len(points) > MOST_POINTS:
            raise LimitError(f"points_mm must {must}, got {len(points)}: draw every second place")
        n = len(points) if points.ndim else 0
        points = finite_numbers("points_mm", self.points_mm, must, shapes=[(n, 3)])
        if n < FEWEST_POINTS:
            raise ValueError(f"points_mm must {must}, got {n}")
        if not np.linalg.norm(np.diff(points, axis=0), axis=1).all():
            raise ValueError("points_mm must differ from one to the next")
        # Tuples, as in all records that are told: they compare.
        object.__setattr__(self, "points_mm", tuple(map(tuple, points.tolist())))
        if type(self.leg) is not int or self.leg < 0:
            raise ValueError(f"leg of a curve must be a whole number from 0, got {self.leg!r}")
        finite_number("point_std_mm", self.point_std_mm, "be positive, in mm", low=POSITIVE)
        must = "be >= 0, in mm"
        finite_number("position_std_mm", self.position_std_mm, must, low=0.0)
        must = f"lie between 0 and {_MOST_TURN_DEG:g} deg"
        finite_number("turn_std_deg", self.turn_std_deg, must, low=0.0, high=_MOST_TURN_DEG)

    @property
    def places_mm(self) -> Floats:
        """(n, 3), as an array."""
        return np.array(self.points_mm, dtype=float)

    @classmethod
    def circle(
        cls,
        start_mm: ArrayLike,
        center_mm: ArrayLike,
        normal: ArrayLike,
        angle_deg: float,
        *,
        leg: int = 0,
        point_std_mm: float,
        position_std_mm: float = 0.0,
        turn_std_deg: float = 0.0,
    ) -> DrawnCurve:
        """Part of a circle, by 33 places; their errors as for `DrawnCurve`.

        Parameters
        ----------
        start_mm, center_mm : array_like, shape (3,)
            Where light enters it, and its middle, mm.
        normal : array_like, shape (3,)
            Across its plane, of any length; light turns about it by the right hand.
        angle_deg : float
            By how much, deg.
        leg, point_std_mm, position_std_mm, turn_std_deg : int, float, float, float
            As for `DrawnCurve`.

        Returns
        -------
        DrawnCurve

        Raises
        ------
        ValueError
            For a normal that is none, or a start in the middle.
        """
        must = "be three finite numbers"
        start, center, axis = (
            finite_numbers(name, told, must, shapes=[(3,)])
            for name, told in (("start_mm", start_mm), ("center_mm", center_mm), ("normal", normal))
        )
        if not axis.any():
            raise ValueError("normal must be three finite numbers, not all zero")
        unit = axis / np.linalg.norm(axis)
        middle = center + ((start - center) @ unit) * unit
        out = start - middle
        must = "lie between 0 and 360 deg"
        turned = np.deg2rad(finite_number("angle_deg", angle_deg, must, low=POSITIVE, high=360.0))
        turn = np.linspace(0.0, turned, _PLACES)[:, np.newaxis]
        return cls(
            middle + np.cos(turn) * out + np.sin(turn) * np.cross(unit, out), leg=leg,
            point_std_mm=point_std_mm, position_std_mm=position_std_mm, turn_std_deg=turn_std_deg,
        )  # fmt: skip

    @classmethod
    def parabola(
        cls,
        start_mm: ArrayLike,
        end_mm: ArrayLike,
        sagitta_mm: ArrayLike,
        *,
        leg: int = 0,
        point_std_mm: float,
        position_std_mm: float = 0.0,
        turn_std_deg: float = 0.0,
    ) -> DrawnCurve:
        """A parabola, by 33 places; their errors as for `DrawnCurve`.

        Parameters
        ----------
        start_mm, end_mm : array_like, shape (3,)
            Its ends, in the order of flight, mm.
        sagitta_mm : array_like, shape (3,)
            From the middle between them to the curve, mm.
        leg, point_std_mm, position_std_mm, turn_std_deg : int, float, float, float
            As for `DrawnCurve`.

        Returns
        -------
        DrawnCurve

        Raises
        ------
        ValueError
            For places that are none.
        """
        must = "be three finite numbers, in mm"
        start, end, sagitta = (
            finite_numbers(name, told, must, shapes=[(3,)])
            for name, told in (
                ("start_mm", start_mm), ("end_mm", end_mm), ("sagitta_mm", sagitta_mm)
            )
        )  # fmt: skip
        f = np.linspace(0.0, 1.0, _PLACES)[:, np.newaxis]
        return cls(
            start + f * (end - start) + 4.0 * f * (1.0 - f) * sagitta, leg=leg,
            point_std_mm=point_std_mm, position_std_mm=position_std_mm, turn_std_deg=turn_std_deg,
        )  # fmt: skip


def checked_curves(curves: object, n_legs: int | None, *, begun: bool) -> tuple[DrawnCurve, ...]:
    """Curves of a call, in the order of their legs.

    Parameters
    ----------
    curves : object
        As given: one DrawnCurve, or a list.
    n_legs : int or None
        How many legs there are, where that is told.
    begun : bool
        Whether a starting path says where legs without a curve are.

    Returns
    -------
    tuple of DrawnCurve
        As given.

    Raises
    ------
    ValueError
        For anything else, two of one leg, or legs without one that nothing says where to look for.
    """
    given = (curves,) if isinstance(curves, DrawnCurve) else curves
    if not isinstance(given, list | tuple) or not all(isinstance(c, DrawnCurve) for c in given):
        raise ValueError(f"curves must be a list of lightflight.DrawnCurve, got {curves!r:.60}")
    legs = sorted(curve.leg for curve in given)
    if len(set(legs)) < len(legs) or (n_legs is not None and max(legs, default=0) >= n_legs):
        there = "" if n_legs is None else f" of the {n_legs} that there are"
        raise ValueError(f"curves must each be of a leg of its own{there}, got legs {legs!r:.60}")
    whole = legs == list(range(len(legs))) and n_legs in (None, len(legs))
    if legs and not (begun or whole):
        raise ValueError(
            f"curves are told of legs {legs}, and nothing says where the others are: give a "
            "starting path (start=), or a curve for each leg from 0"
        )
    return tuple(sorted(given, key=lambda curve: curve.leg))
