"""What a fit may move: the freedom of a path's vertices and start time, and the priors on it.

A known source does not move; one measured with an error moves against a prior; an unknown one
moves within the plane where the flight enters the view, because nothing can be known of what
lies before. The last vertex likewise moves within the plane where the flight leaves the view.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from lightflight.curves import DrawnCurve
from lightflight.errors import GeometryError
from lightflight.flight import Source
from lightflight.path.bends import Bend
from lightflight.reconstruct.model.drawn import told_of_curve
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import inside_edges_px
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.model.told import (
    ToldLength,
    ToldRow,
    Waypoint,
    pieces_of,
    refuse_unmeasured,
    way_along,
)

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_AT_EDGE_PX = 0.3
"""A path that ends this near to the picture's edge was cut there; its light goes on, px."""
_END_MOVES = ("depth", "height", "along the leg")
"""What the columns of an end's basis move."""

_BEND_AXES = ("in the picture", "in depth")
"""What the two axes of a bend are, in the words of its columns."""
_BEND_FALL = 2.0
"""Power by which the plausible size of a bend's shapes falls off with their order: curvature, which
grows by the square of the order, is as plausible in each."""


def sagitta_std_mm(order: int, size_mm: float = PLAUSIBLE["curved_leg"].size) -> float:
    """Prior standard deviation of a bend's coefficient of an order, counted from 1; mm.

    `size_mm` is that of the first, the sagitta.
    """
    return float(size_mm / order**_BEND_FALL)


def _told_sagitta_mm(bend: Bend) -> float:
    """Plausible sagitta of a leg whose curve is told: the usual one, or that of its own curvature.

    In no shape is there more than in all others: what no place tells of a curve is as smooth as it.
    """
    falls = np.arange(1, bend.orders + 1) ** _BEND_FALL
    own = float(np.max(np.linalg.norm(bend.coefficients_mm, axis=0) * falls))
    return max(PLAUSIBLE["curved_leg"].size, own)


@dataclass(frozen=True, eq=False)
class Freedom:
    """Directions in which a state may move, and Gaussian priors on the state.

    Attributes
    ----------
    basis : array of float, shape (size, p)
        Columns are unit moves of (vertices in mm, start time in ps).
    prior_rows : array of float, shape (q, size)
        Prior i says prior_rows[i] . state = prior_values[i] +- 1.
    prior_values : array of float, shape (q,)
        In units of the prior's standard deviation.
    labels : tuple of str
        (p,), what each column moves, in words.
    curve_moves : array of float, shape (q, 6 k)
        By how much the values of the priors change where each of k drawn curves stands elsewhere;
        (q, 0): none is told.
    told : tuple of ToldRow
        Which of the priors are waypoints and lengths.
    """

    basis: Floats
    prior_rows: Floats
    prior_values: Floats
    labels: tuple[str, ...]
    curve_moves: Floats = field(default_factory=lambda: np.empty((0, 0)))
    told: tuple[ToldRow, ...] = ()

    @property
    def n_unknown(self) -> int:
        """Columns that pulses must tell; where light stops lit pixels say, to a pixel."""
        return sum(not label.endswith(_END_MOVES[2]) for label in self.labels)

    @property
    def prior_information(self) -> Floats:
        """(p, p), what the priors alone know of the columns of `basis`."""
        rows = self.prior_rows @ self.basis
        information: Floats = rows.T @ rows
        return information


@dataclass(frozen=True, eq=False)
class ViewEnd:
    """Where a leg leaves (or enters) the view: a plane through the camera.

    Attributes
    ----------
    position_mm : array of float, shape (3,)
        World, mm.
    basis : array of float, shape (3, 2)
        The ray, and the direction along the edge of the picture; unit, orthogonal.
    """

    position_mm: Floats
    basis: Floats


def view_end(camera: Camera, inside_mm: Floats, direction: Floats) -> ViewEnd | None:
    """Where the line from a point in view leaves the picture; None where it never does.

    `direction` (3,) is unit, along the line, outwards.

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    inside_mm : array of float, shape (3,)
        A point in view, world, mm.
    direction : array of float, shape (3,)
        Unit, along the line, outwards.

    Returns
    -------
    ViewEnd or None
        The last point in view, found to a billionth of the way.
    """
    reach = 4.0 * float(np.linalg.norm(inside_mm - camera.center_mm)) + 2000.0
    # From half a mm to beyond any scene: fine near, coarse far.
    lengths = np.concatenate(([0.0], np.geomspace(0.5, reach, 400)))

    def place(length: Floats | float) -> Floats:
        return np.asarray(inside_mm + np.multiply.outer(length, direction))

    last = last_in_view(camera, place, lengths)
    return None if last is None else view_end_at(camera, place(last))


def last_in_view(
    camera: Camera, place: Callable[[Floats | float], Floats], at: Floats
) -> float | None:
    """How far along a line or curve its points are in view.

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    place : callable
        Points (..., 3), world, mm, of numbers (...) along it.
    at : array of float, shape (n,)
        Numbers that are tried, outwards.

    Returns
    -------
    float or None
        To the last bit; None where the first is not in view, or the last still is, or none is
        tried.
    """
    seen = camera.sees(place(at)) if len(at) else np.empty(0, dtype=bool)
    if not seen.any() or not seen[0] or seen.all():
        return None
    first_out = int(np.argmin(seen))
    low, high = float(at[first_out - 1]), float(at[first_out])
    # Bisection to the last bit of the length.
    for _ in range(60):
        middle = 0.5 * (low + high)
        if camera.sees(place(middle)):
            low = middle
        else:
            high = middle
    return low


def view_end_at(camera: Camera, position: Floats) -> ViewEnd:
    """An end at the last point in view (3,), world, mm, which slides along the picture's edge."""
    # The nearest edge says which way the end may slide: along that edge.
    to_edge = inside_edges_px(*camera.pixels_from_points(position), camera.shape)
    along_edge = (0.0, 1.0) if np.argmin(np.abs(to_edge)) < 2 else (1.0, 0.0)
    return end_in_picture(camera, position, along_edge)


def ends_in_view(camera: Camera, position_mm: Floats) -> bool:
    """True where a path that ends here ends within the picture, not at its edge.

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    position_mm : array of float, shape (3,)
        World, mm.
    """
    inside = inside_edges_px(*camera.pixels_from_points(position_mm), camera.shape).min()
    return bool(inside > _AT_EDGE_PX)


def end_in_picture(camera: Camera, position_mm: Floats, across: tuple[float, float]) -> ViewEnd:
    """An end at a point in the picture; `across` (d row, d col) is the free direction there.

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    position_mm : array of float, shape (3,)
        World, mm.
    across : (float, float)
        (d row, d col), the free direction in the picture.

    Returns
    -------
    ViewEnd
        The point, its ray, and that direction in space.
    """
    row, col = (float(x) for x in camera.pixels_from_points(position_mm))
    # A quarter of a pixel inside, where the lens model still holds on both sides.
    inwards = 0.25
    center_row, center_col = (camera.shape[0] - 1) / 2, (camera.shape[1] - 1) / 2
    row += inwards * np.sign(center_row - row) * abs(across[1])
    col += inwards * np.sign(center_col - col) * abs(across[0])
    step = 0.25
    origins, rays, _ = camera.lines_of_sight(
        np.array([row - step * across[0], row + step * across[0]]),
        np.array([col - step * across[1], col + step * across[1]]),
    )
    ray = camera.sight_directions(position_mm)
    depth = np.linalg.norm(position_mm - origins.mean(axis=0))
    edge = (origins[1] - origins[0]) / depth + rays[1] - rays[0]
    # Depth and slide are to be independent: the slide is made normal to the ray.
    edge = edge - (edge @ ray) * ray
    return ViewEnd(position_mm, np.column_stack((ray, edge / np.linalg.norm(edge))))


def view_plane(camera: Camera, end_mm: Floats, towards_mm: Floats) -> Floats:
    """(3, 2): the plane in which an end moves, its ray and the direction across its leg.

    Parameters
    ----------
    camera : Camera
        The camera that sees it.
    end_mm : array of float, shape (3,)
        World, mm.
    towards_mm : array of float, shape (3,)
        The other end of the leg, world, mm.

    Returns
    -------
    array of float, shape (3, 2)
        Unit columns.

    Raises
    ------
    GeometryError
        Where the leg, on its way to `towards_mm`, runs along the ray.
    """
    ray = camera.sight_directions(end_mm)
    across = np.cross(ray, towards_mm - end_mm)
    size = float(np.linalg.norm(across))
    if size < 1e-9:
        raise GeometryError("a leg points straight at the camera: its picture is a point")
    return np.column_stack((ray, across / size))


def with_tip(basis: Floats, end_mm: Floats, leg_mm: Floats, camera: Camera) -> Floats:
    """(3, 3): the plane (3, 2) in which an end moves, and a pixel's step along its leg (3,).

    Parameters
    ----------
    basis : array of float, shape (3, 2)
        By `view_plane`.
    end_mm : array of float, shape (3,)
        World, mm.
    leg_mm : array of float, shape (3,)
        From the leg's start to its end, mm.
    camera : Camera
        The camera that sees it.

    Returns
    -------
    array of float, shape (3, 3)
        The last column in mm per px.
    """
    px_per_leg = float(np.linalg.norm(camera.pixel_jacobian(end_mm) @ leg_mm))
    return np.column_stack((basis, leg_mm / max(px_per_leg, 1e-12)))


@dataclass(eq=False)
class _Gathered:
    """Columns and priors of a `Freedom` while they are gathered; state (size,)."""

    state: Floats
    columns: list[Floats] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    rows: list[Floats] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    told: list[ToldRow] = field(default_factory=list)

    def _at_vertex(self, vertex: int, xyz: Floats) -> Floats:
        """(size,), zero but for a vertex."""
        whole = np.zeros(len(self.state))
        whole[3 * vertex : 3 * vertex + 3] = xyz
        return whole

    def add_column(self, vertex: int, direction: Floats, label: str) -> None:
        """Let a vertex move along `direction` (3,)."""
        self.columns.append(self._at_vertex(vertex, direction))
        self.labels.append(label)

    def add_prior(self, index: int, value: float, std: float) -> None:
        """Say that one number of the state is value +- std."""
        row = np.zeros(len(self.state))
        row[index] = 1.0 / std
        self.rows.append(row)
        self.values.append(value / std)

    def hold_tip(self, vertex: int, basis: Floats) -> None:
        """Which pixels are lit says to a pixel where the light ends, even where counts cannot."""
        if basis.shape[1] < 3:
            return
        row = self._at_vertex(vertex, np.linalg.inv(basis)[2])
        self.rows.append(row)
        self.values.append(float(row @ self.state))

    def add_waypoint(self, vertex: int, told: Waypoint) -> None:
        """Say where a vertex is."""
        number, position_mm, std_mm = told
        for axis, value in enumerate(np.asarray(position_mm, dtype=float)):
            words = f"place of vertex {number} in {'xyz'[axis]}"
            self.told.append(ToldRow(words, len(self.rows), std_mm))
            self.add_prior(3 * vertex + axis, float(value), float(std_mm))

    def add_length(self, state: PathState, told: ToldLength) -> None:
        """Say how far light runs along a leg; linear about the path as it is."""
        way_mm, by_state = way_along(state, pieces_of(state, told))
        self.told.append(ToldRow(f"length of leg {told.leg + 1}", len(self.rows), told.std_mm))
        self.rows.append(by_state / told.std_mm)
        self.values.append(float(by_state @ self.state + told.length_mm - way_mm) / told.std_mm)


def freedom_of_path(
    state: PathState,
    *,
    source: Source,
    waypoints: tuple[Waypoint, ...],
    start_basis: Floats | None,
    end_bases: tuple[Floats, ...],
    lengths: tuple[ToldLength, ...] = (),
    curves: tuple[DrawnCurve, ...] = (),
) -> Freedom:
    """Freedom of a whole path.

    Parameters
    ----------
    start_basis : array of float, shape (3, 2) or None
        Plane in which an unknown source's entry point moves; (3, 3), by `with_tip`, where the light
        begins in view.
    end_bases : tuple of array of float, shape (3, 2)
        Plane in which the exit moves; (3, 3) where the light stops in view. Of a path with arms
        one for each, in the order of `PathState.last_legs`.
    lengths : tuple of ToldLength
        Of legs whose ends the picture or the source shows.
    curves : tuple of DrawnCurve
        That legs are told to run along.
    """
    m = len(state.vertices_mm)
    found = _Gathered(state.vector)
    if source.position_mm is None:
        assert start_basis is not None
        for direction, name in zip(start_basis.T, _END_MOVES, strict=False):
            found.add_column(0, direction, f"entry {name}")
        found.hold_tip(0, start_basis)
    else:
        position = np.asarray(source.position_mm, dtype=float)
        for axis, std in enumerate(source.position_std_xyz_mm):
            if std > 0:
                found.add_column(0, np.eye(3)[axis], f"source {'xyz'[axis]}")
                found.add_prior(axis, float(position[axis]), float(std))
    # Only place and time together are exact: a known time at an unknown place fixes nothing.
    exact_time = source.emission_time_ps is not None and source.emission_time_std_ps == 0
    if not (exact_time and source.position_mm is not None):
        found.columns.append(np.eye(state.size)[3 * m])
        found.labels.append("emission time" if source.position_mm is not None else "entry time")
        if source.emission_time_ps is not None and source.position_mm is not None:
            found.add_prior(3 * m, source.emission_time_ps, source.emission_time_std_ps)
    # Corners are free in all directions: mirrors stand anywhere, in view or not.
    ends = state.ends[1:]
    for vertex in sorted({*range(1, m)} - {*ends, *state.on_faces}):
        for axis in range(3):
            found.add_column(vertex, np.eye(3)[axis], f"corner {vertex} {'xyz'[axis]}")
    for vertex, basis in zip(ends, end_bases, strict=True):
        which = "exit" if len(ends) == 1 else f"exit {vertex}"
        for direction, name in zip(basis.T, _END_MOVES, strict=False):
            found.add_column(vertex, direction, f"{which} {name}")
        found.hold_tip(vertex, basis)
    for bend, (_, own) in zip(state.bends, state.courses, strict=True):
        told = bend.leg in {curve.leg for curve in curves}
        size = _told_sagitta_mm(bend) if told else PLAUSIBLE["curved_leg"].size
        for number in bend.fitted:
            axis, order = divmod(number, bend.orders)
            found.columns.append(np.eye(state.size)[own.start + number])
            found.labels.append(f"bend of leg {bend.leg + 1} {_BEND_AXES[axis]}, {order + 1}")
            found.add_prior(own.start + number, 0.0, sagitta_std_mm(order + 1, size))
    bases = zip(state.ends, (start_basis, *end_bases), strict=True)
    loose = {vertex for vertex, plane in bases if plane is not None and plane.shape[1] < 3}
    if source.position_mm is not None:
        loose.discard(0)
    _hold_told(found, state, waypoints, lengths, loose)
    basis = np.column_stack(found.columns)
    moves = np.zeros((len(found.rows), 0))
    for curve in curves:
        of_curve = told_of_curve(state, curve)
        found.rows.extend(of_curve.rows)
        found.values.extend(of_curve.values)
        moves = block_diag(moves, of_curve.moves)
    return Freedom(
        basis=state.free_moves @ basis if state.glass else basis,
        prior_rows=np.array(found.rows).reshape(-1, state.size),
        prior_values=np.array(found.values),
        labels=tuple(found.labels),
        curve_moves=moves,
        told=tuple(found.told),
    )


def _hold_told(
    found: _Gathered,
    state: PathState,
    waypoints: tuple[Waypoint, ...],
    lengths: tuple[ToldLength, ...],
    loose: set[int],
) -> None:
    """Say what is told of vertices and legs; `loose` vertices lie at the picture's edge."""
    # Who knows a mirror does not count faces of glass.
    counted = [vertex for vertex in range(len(state.vertices_mm)) if vertex not in state.on_faces]
    for waypoint in waypoints:
        if waypoint[0] >= len(counted):
            raise ValueError(
                f"waypoint of vertex {waypoint[0]}, but the path found has vertices 0 to "
                f"{len(counted) - 1}: give n_legs, or leave the waypoint out"
            )
        found.add_waypoint(counted[waypoint[0]], waypoint)
    for length in lengths:
        refuse_unmeasured(state, length, loose)
        found.add_length(state, length)
