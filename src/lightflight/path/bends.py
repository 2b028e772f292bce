"""Legs that are smooth curves: where they run, which way, and how long they are.

A bent leg leaves the straight line between its ends by a few coefficients times shapes that vanish
at both ends. Without coefficients it is that line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from lightflight.errors import LimitError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_ORDERS = 8
"""Shapes of a bend: a curve that needs more is no smooth leg, and ten places fix no more."""
_FARTHEST_MM = 1e6
"""Of a coefficient, mm: a kilometre of sagitta is on no bench."""
_NODES = 24
"""Of Gauss and Legendre's rule along a leg: 1e-13 of the length where it turns by 60 deg."""
_FRACTION_STEPS = 30
"""Most of Newton's steps from a length to a place; a curve within the limits takes four."""


@lru_cache(maxsize=64)
def _polynomials(orders: int) -> tuple[Floats, Floats]:
    """Coefficients (powers, orders) of the shapes, and of their derivatives by f, in g = 2 f - 1.

    The shapes are (1 - g^2) P_(j-1)(g): 4 f (1 - f) times Legendre's polynomials.
    """
    dome = np.array([1.0, 0.0, -1.0])
    shapes = np.zeros((orders + 2, orders))
    for j in range(orders):
        powers = np.polynomial.polynomial.polymul(dome, legendre.leg2poly([0.0] * j + [1.0]))
        shapes[: len(powers), j] = powers
    slopes: Floats = 2.0 * np.asarray(np.polynomial.polynomial.polyder(shapes), dtype=float)
    return shapes, slopes


def _at(powers: Floats, fraction: Floats) -> Floats:
    """(n, orders), polynomials of g = 2 f - 1 at fractions (n,)."""
    g = 2.0 * fraction - 1.0
    # Powers one by one, as `np.vander` makes them, in a third of its time.
    of_g = np.empty((len(g), len(powers)))
    of_g[:, 0] = 1.0
    for k in range(1, len(powers)):
        np.multiply(of_g[:, k - 1], g, out=of_g[:, k])
    shapes: Floats = of_g @ powers
    return shapes


def shapes_at(fraction: Floats, orders: int) -> Floats:
    """Shapes phi_j of a bend at fractions of its leg.

    Parameters
    ----------
    fraction : array of float, shape (n,)
        0 at the leg's start, 1 at its end. Beyond both a leg runs on straight.
    orders : int
        How many shapes.

    Returns
    -------
    array of float, shape (n, orders)
        Zero at both ends; the first is 4 f (1 - f), whose coefficient is the sagitta.
    """
    inside = np.clip(fraction, 0.0, 1.0)
    shapes, first = _polynomials(orders)
    beyond, at = (fraction - inside)[:, np.newaxis], _at(shapes, inside)
    return at + beyond * _at(first, inside) if beyond.any() else at


def shape_slopes_at(fraction: Floats, orders: int) -> Floats:
    """d(phi_j) / d(fraction), (n, orders); parameters as `shapes_at`."""
    return _at(_polynomials(orders)[1], np.clip(fraction, 0.0, 1.0))


@dataclass(frozen=True, eq=False)
class Bend:
    """How one leg leaves the straight line between its ends.

    X(f) = S + f (E - S) + sum_j phi_j(f) (a_j u + b_j w), f from 0 to 1.

    Attributes
    ----------
    leg : int
        Which leg, by number.
    axes : array of float, shape (2, 3)
        u and w: unit, world, across the leg as it was when the bend was first looked for: u in the
        picture, w in depth.
    coefficients_mm : array of float, shape (2, J)
        a_j, then b_j. Those of the first shape are the sagitta, mm.
    more_in_picture : int, optional
        How many of the last shapes are of the picture alone: their b_j are zero, and not fitted.
    """

    leg: int
    axes: Floats
    coefficients_mm: Floats
    more_in_picture: int = 0

    @property
    def orders(self) -> int:
        """J, shapes of each axis."""
        return int(self.coefficients_mm.shape[1])

    @property
    def size(self) -> int:
        """Numbers of the bend."""
        return int(self.coefficients_mm.size)

    @property
    def fitted(self) -> Indices:
        """Which of the numbers are fitted: all but those of the shapes of the picture alone."""
        return np.arange(self.size - self.more_in_picture)

    @cached_property
    def vectors_mm(self) -> Floats:
        """(J, 3), a_j u + b_j w."""
        vectors: Floats = self.coefficients_mm.T @ self.axes
        return vectors

    def away_mm(self, fraction: Floats) -> Floats:
        """(n, 3), from the straight line to the curve, world, mm."""
        away: Floats = shapes_at(fraction, self.orders) @ self.vectors_mm
        return away

    def away_slopes_mm(self, fraction: Floats) -> Floats:
        """(n, 3), d(`away_mm`) / d(fraction)."""
        slopes: Floats = shape_slopes_at(fraction, self.orders) @ self.vectors_mm
        return slopes

    def by_coefficients(self, of_shapes: Floats, vectors: Floats) -> Floats:
        """(n, 2 J), vectors (n, 3) times the derivative by each coefficient of a sum of shapes.

        `of_shapes` (n, J) are the shapes, or their slopes; columns are a_1 ... a_J, b_1 ... b_J.
        """
        along_axes = vectors @ self.axes.T
        return np.hstack([along_axes[:, [axis]] * of_shapes for axis in range(2)])

    def moved(self, step: Floats) -> Bend:
        """The bend after adding (2 J,) to its coefficients, mm."""
        by = step.reshape(self.coefficients_mm.shape)
        return replace(self, coefficients_mm=self.coefficients_mm + by)

    def with_orders(self, orders: int, more_in_picture: int = 0) -> Bend:
        """The same curve with as many shapes, further ones at zero; some of the picture alone."""
        grown = np.zeros((2, orders))
        kept = np.minimum(self.orders, (orders, orders - more_in_picture))
        for axis, n in enumerate(kept):
            grown[axis, :n] = self.coefficients_mm[axis, :n]
        return replace(self, coefficients_mm=grown, more_in_picture=more_in_picture)


@dataclass(frozen=True, eq=False)
class BentCourse:
    """The curve of one bent leg: its points, its directions and its length.

    Attributes
    ----------
    start_mm, end_mm : array of float, shape (3,)
        World, mm.
    bend : Bend
        How it leaves the straight line between them.
    """

    start_mm: Floats
    end_mm: Floats
    bend: Bend

    @property
    def leg(self) -> int:
        """Which leg, by number."""
        return self.bend.leg

    def points_mm(self, fraction: Floats) -> Floats:
        """(n, 3), places at fractions (n,), world, mm."""
        points: Floats = self.start_mm + fraction[:, np.newaxis] * (self.end_mm - self.start_mm)
        return points + self.bend.away_mm(fraction)

    def tangents_mm(self, fraction: Floats) -> Floats:
        """(n, 3), d(place) / d(fraction), world, mm."""
        tangents: Floats = self.end_mm - self.start_mm + self.bend.away_slopes_mm(fraction)
        return tangents

    def by_bend(self, fraction: Floats, by_point: Floats) -> Floats:
        """(n, 2 J), d / d(coefficients) of what follows the points at fixed fractions.

        `by_point` (n, 3) is its derivative by them.
        """
        return self.bend.by_coefficients(shapes_at(fraction, self.bend.orders), by_point)

    def slopes_by_bend(self, fraction: Floats, by_tangent: Floats) -> Floats:
        """(n, 2 J), d / d(coefficients) of what follows the tangents; `by_tangent` (n, 3)."""
        slopes = shape_slopes_at(fraction, self.bend.orders)
        return self.bend.by_coefficients(slopes, by_tangent)

    def ways_mm(self, fraction: Floats) -> Floats:
        """(n,), length of the curve from its start, mm; below zero before it."""
        places, share = _quadrature(fraction)
        speed = np.linalg.norm(self.tangents_mm(places.ravel()), axis=1)
        ways: Floats = np.sum(share * speed.reshape(share.shape), axis=1)
        return ways

    def ways_and_slopes(self, fraction: Floats) -> tuple[Floats, Floats, Floats]:
        """Lengths from the start, and how they follow the ends and the bend at fixed fractions.

        Parameters
        ----------
        fraction : array of float, shape (n,)
            Of the leg.

        Returns
        -------
        way_mm : array of float, shape (n,)
            mm.
        by_step : array of float, shape (n, 3)
            d(way) / d(end - start).
        by_bend : array of float, shape (n, 2 J)
            d(way) / d(coefficients).

        Notes
        -----
        s(f) = int_0^f |X'| df, ds / d(E - S) = int X' / |X'| df, and ds / da_j the same with
        phi_j' u under the integral (method.md, Bent legs).
        """
        places, share = _quadrature(fraction)
        tangents = self.tangents_mm(places.ravel())
        speed = np.linalg.norm(tangents, axis=1)
        unit = tangents / speed[:, np.newaxis]
        slopes = shape_slopes_at(places.ravel(), self.bend.orders)
        by_bend = self.bend.by_coefficients(slopes, unit)

        def summed(values: Floats) -> Floats:
            """(n, k), the integral of values (all places, k)."""
            by_place = values.reshape(*share.shape, values.shape[1])
            total: Floats = np.einsum("ij,ijk->ik", share, by_place)
            return total

        return summed(speed[:, np.newaxis])[:, 0], summed(unit), summed(by_bend)

    def fractions_at(self, ways_mm: Floats) -> Floats:
        """Fractions (n,) of the leg at lengths (n,) from its start, mm."""
        length = float(self.ways_mm(np.ones(1))[0])
        fraction: Floats = ways_mm / length
        for _ in range(_FRACTION_STEPS):
            speed = np.linalg.norm(self.tangents_mm(fraction), axis=1)
            change = (ways_mm - self.ways_mm(fraction)) / np.maximum(speed, 1e-3 * length)
            fraction = fraction + change
            if np.abs(change).max(initial=0.0) < 1e-14:
                break
        return fraction

    def part(self, first: float, last: float) -> BentCourse:
        """The same curve from one fraction to another, which may lie a little beyond its ends.

        A polynomial stays one: the part has as many shapes, and differs nowhere.
        """
        orders = self.bend.orders
        shapes = _polynomials(orders)[0]
        inside = np.linspace(0.0, 1.0, orders + 4)
        places = first + inside * (last - first)
        step = self.end_mm - self.start_mm
        curve = self.start_mm + np.outer(places, step) + _at(shapes, places) @ self.bend.vectors_mm
        away = curve - (curve[0] + np.outer(inside, curve[-1] - curve[0]))
        vectors = np.linalg.lstsq(_at(shapes, inside), away, rcond=None)[0]
        coefficients = (vectors @ self.bend.axes.T).T
        # Shapes of the picture alone stay so to the last bit.
        coefficients[1, orders - self.bend.more_in_picture :] = 0.0
        bend = replace(self.bend, coefficients_mm=coefficients)
        return BentCourse(curve[0], curve[-1], bend)


def _quadrature(fraction: Floats) -> tuple[Floats, Floats]:
    """Places on a leg, (n, nodes + 1), and their shares in an integral from its start; the same.

    The last node stands for what lies beyond an end, where the leg runs on straight.
    """
    nodes, weights = _gauss()
    inside = np.clip(fraction, 0.0, 1.0)
    places = np.column_stack((np.outer(inside, 0.5 * (nodes + 1.0)), inside))
    share = np.column_stack((np.outer(inside, 0.5 * weights), fraction - inside))
    return places, share


@lru_cache(maxsize=1)
def _gauss() -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss and Legendre's rule on [-1, 1]."""
    return legendre.leggauss(_NODES)


def checked_bends(bends: object, n_legs: int, unseen: tuple[int, ...]) -> tuple[Bend, ...]:
    """Bends of a path, in the order of its legs.

    Parameters
    ----------
    bends : object
        As given.
    n_legs : int
        Of the path.
    unseen : tuple of int
        Legs that no picture showed.

    Returns
    -------
    tuple of Bend
        With arrays of their own, read-only.

    Raises
    ------
    ValueError
        Unless each is of a seen leg of its own, with finite coefficients and axes of unit length
        across each other.
    LimitError
        For more shapes, or longer ones, than a bench has.
    """
    if not isinstance(bends, tuple | list) or not all(isinstance(one, Bend) for one in bends):
        raise ValueError(f"bends must be a tuple of Bend, got {bends!r:.60}")
    legs = [one.leg for one in bends]
    known = all(type(k) is int and 0 <= k < n_legs and k not in unseen for k in legs)
    if not known or len(set(legs)) < len(legs):
        raise ValueError(
            f"bends must each be of a leg of its own, of the {n_legs} that there are, and seen; "
            f"got legs {legs!r:.60}"
        )
    return tuple(_checked(one) for one in sorted(bends, key=lambda one: one.leg))


def arrays_of_bends(bends: tuple[Bend, ...]) -> dict[str, NDArray[np.generic]]:
    """Bends as plain arrays, for files.

    Parameters
    ----------
    bends : tuple of Bend
        In the order of their legs.

    Returns
    -------
    dict of str to array
        `bends_leg` (k,), `bends_axes` (k, 2, 3), `bends_orders` (k,), and `bends_coefficients_mm`,
        all coefficients of one bend after those of another; `bends_more_in_picture` (k,) where a
        bend has shapes of the picture alone.
    """
    more = np.array([bend.more_in_picture for bend in bends], dtype=np.int64)
    return {
        **({"bends_more_in_picture": more} if more.any() else {}),
        "bends_leg": np.array([bend.leg for bend in bends], dtype=np.int64),
        "bends_axes": np.array([bend.axes for bend in bends]),
        "bends_orders": np.array([bend.orders for bend in bends], dtype=np.int64),
        "bends_coefficients_mm": np.concatenate([b.coefficients_mm.ravel() for b in bends]),
    }


def bends_from_arrays(arrays: Mapping[str, NDArray[np.generic]]) -> tuple[Bend, ...]:
    """Bends of the arrays of a file, by `arrays_of_bends`; () where it holds none.

    Parameters
    ----------
    arrays : mapping of str to array
        Of the file.

    Returns
    -------
    tuple of Bend
        As they were written; whether they are bends of the path, `checked_bends` says.

    Raises
    ------
    ValueError
        Where the arrays do not belong together.
    KeyError
        Where one lacks.
    """
    if "bends_leg" not in arrays:
        return ()
    legs, orders = (np.asarray(arrays[f"bends_{name}"]) for name in ("leg", "orders"))
    axes = np.asarray(arrays["bends_axes"], dtype=float)
    flat = np.asarray(arrays["bends_coefficients_mm"], dtype=float)
    n = len(legs) if legs.ndim == 1 else -1
    whole = legs.dtype.kind == "i" and orders.dtype.kind == "i"
    known = whole and orders.shape == (n,) and bool(((orders > 0) & (orders <= MOST_ORDERS)).all())
    if not known or axes.shape != (n, 2, 3) or flat.shape != (2 * int(orders.sum()),):
        raise ValueError("its bends are damaged: their arrays do not belong together")
    parts = np.split(flat, np.cumsum(2 * orders)[:-1])
    # Files of earlier versions have none.
    more = np.asarray(arrays.get("bends_more_in_picture", np.zeros(n, dtype=np.int64)))
    if more.shape != (n,) or more.dtype.kind != "i":
        raise ValueError("its bends are damaged: their arrays do not belong together")
    return tuple(
        Bend(int(leg), own, part.reshape(2, -1), int(alone))
        for leg, own, part, alone in zip(legs, axes, parts, more, strict=True)
    )


def checked_bend_covariance(covariance: object, bends: tuple[Bend, ...], n: int) -> Floats:
    """Covariance (n + b, b) of the b coefficients of bends with n numbers of vertices; read-only.

    Parameters
    ----------
    covariance : object
        As given; None: nothing is known, all NaN.
    bends : tuple of Bend
        Whose coefficients they are.
    n : int
        Numbers of the vertices.

    Returns
    -------
    array of float, shape (n + b, b)
        mm^2, and mm ps.

    Raises
    ------
    ValueError
        For another shape.
    """
    b = sum(bend.size for bend in bends)
    # A path that is told anew with more vertices brings the empty table of the old one.
    covariance = None if not b and np.size(covariance) == 0 else covariance  # type: ignore[arg-type]
    found = np.full((n + b, b), np.nan) if covariance is None else np.array(covariance, dtype=float)
    if found.shape != (n + b, b):
        raise ValueError(f"bend_covariance must be ({n + b}, {b}), got {found.shape}")
    found.setflags(write=False)
    return found


def _checked(bend: Bend) -> Bend:
    axes = np.array(bend.axes, dtype=float)
    coefficients = np.array(bend.coefficients_mm, dtype=float)
    if coefficients.ndim != 2 or len(coefficients) != 2 or not coefficients.shape[1]:
        raise ValueError(f"coefficients_mm of a bend must be (2, J), got {coefficients.shape}")
    if coefficients.shape[1] > MOST_ORDERS:
        raise LimitError(f"a bend has at most {MOST_ORDERS} shapes, got {coefficients.shape[1]}")
    if not np.isfinite(coefficients).all():
        raise ValueError(f"coefficients_mm of a bend must be finite, got {coefficients}")
    alone = bend.more_in_picture
    if not 0 <= alone < len(coefficients.T) or coefficients[1, len(coefficients.T) - alone :].any():
        raise ValueError(
            "more_in_picture of a bend must be 0 or less than its shapes, whose coefficients in "
            f"depth are zero; got {alone} of {coefficients.shape[1]}"
        )
    if np.abs(coefficients).max() > _FARTHEST_MM:
        raise LimitError(f"coefficients_mm of a bend must lie within {_FARTHEST_MM:g} mm")
    # NaN is near to nothing.
    if axes.shape != (2, 3) or not np.abs(axes @ axes.T - np.eye(2)).max() < 1e-6:
        raise ValueError(f"axes of a bend must be two unit vectors across each other, got {axes}")
    axes.setflags(write=False)
    coefficients.setflags(write=False)
    return Bend(bend.leg, axes, coefficients, bend.more_in_picture)
