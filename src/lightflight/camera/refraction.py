"""A camera's view through plane interfaces: a window, the wall of a tank.

Between camera and scene stand k planes, ordered from the camera on; light from a point X takes the
way that is stationary in optical length (Fermat), bent by the *phase* indices, and needs the time
that the *group* indices say. With P_0 = A, P_(k+1) = X and P_i on plane i,

    S = sum_i n_i |P_(i+1) - P_i|  is least,   c t = sum_i g_i |P_(i+1) - P_i|.

S is convex in the P_i, so Newton's method finds the one way there is (`way_through`), and the
implicit function theorem its derivative. `rays_through` goes the other way, by Snell's law.

Everything above `camera` sees rays with an origin each, and optical lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import finite_number, finite_numbers
from lightflight.camera.parallel_planes import way_through_parallel
from lightflight.camera.way import Way
from lightflight.errors import GeometryError
from lightflight.flight import INDEX_SLACK_STDS, Medium, Source
from lightflight.materials import AIR, Material

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_MOST_STEPS, _MOST_HALVINGS = 60, 60
_PARALLEL = 1e-14
"""Normals whose angle's cosine is nearer to one than this are of parallel planes: 1e-7 rad."""
_STILL = 1e-14
"""Newton's step, as a share of the way, that changes nothing any more."""


@dataclass(frozen=True)
class Interface:
    """A plane at which one medium ends and the next begins, seen from the camera.

    Raises ValueError for numbers that are none, GeometryError for a normal without length.

    Attributes
    ----------
    point_mm : ArrayLike
        (3,) any point of the plane, world, mm; stored as a tuple.
    normal : ArrayLike
        (3,) across the plane, either way, any length; stored as a unit tuple.
    beyond : Material
        What fills the space behind it.
    distance_std_mm : float
        One-sigma error of where it stands along its normal, mm; all behind it goes along. 0: exact.
    phase_index_std : float
        One-sigma error of the phase index beyond it, beside what an error of the medium's group
        index moves: both by the same share. 0: exact.
    """

    point_mm: ArrayLike

    normal: ArrayLike

    beyond: Material

    distance_std_mm: float = field(default=0.0, kw_only=True)

    phase_index_std: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        must = "be three finite numbers (x, y, z)"
        point = finite_numbers("point_mm of an interface", self.point_mm, must, shapes=[(3,)])
        normal = finite_numbers("normal of an interface", self.normal, must, shapes=[(3,)])
        size = float(np.linalg.norm(normal))
        if not size > 0.0:
            raise GeometryError("normal of an interface is zero: give the direction across it")
        if not isinstance(self.beyond, Material):
            raise ValueError(
                "beyond of an interface must be a Material: "
                'Material.named("water", wavelength_nm=532), or Material(phase_index, group_index)'
            )
        must = "be finite and >= 0"
        for name in ("distance_std_mm", "phase_index_std"):
            std = finite_number(name, getattr(self, name), must, low=0.0)
            object.__setattr__(self, name, std)
        object.__setattr__(self, "point_mm", tuple(point.tolist()))
        # A unit normal stays to the last bit, through files and `replace`.
        unit = normal if abs(size - 1.0) < 1e-15 else normal / size
        object.__setattr__(self, "normal", tuple(unit.tolist()))


def window(
    point_mm: ArrayLike,
    normal: ArrayLike,
    *,
    thickness_mm: float,
    glass: Material,
    beyond: Material = AIR,
    distance_std_mm: float = 0.0,
) -> tuple[Interface, Interface]:
    """Both faces of a flat window, from the camera on.

    Parameters
    ----------
    point_mm : array of float, shape (3,)
        A point of the face that the camera sees first, world, mm.
    normal : array of float, shape (3,)
        Across the window, from the scene towards the camera, any length.
    thickness_mm : float
        Of the glass, mm.
    glass : Material
        Of the window.
    beyond : Material, optional
        What fills the scene behind it: water of a tank; default air.
    distance_std_mm : float, optional
        One-sigma error of where the window stands along its normal, mm; both faces go along.

    Returns
    -------
    (Interface, Interface)
        For `Camera(interfaces=...)`; only the first states the error, which moves both.
    """
    must = "be positive and finite"
    thickness = finite_number("thickness_mm", thickness_mm, must, low=np.finfo(float).tiny)
    near = Interface(point_mm, normal, glass, distance_std_mm=distance_std_mm)
    across = np.asarray(near.normal, dtype=float)
    far = np.asarray(near.point_mm, dtype=float) - thickness * across
    return near, Interface(far, near.normal, beyond)


def moved_rigidly(
    interfaces: Sequence[Interface], rotation: Floats, about_mm: Floats, shift_mm: Floats
) -> tuple[Interface, ...]:
    """Interfaces turned by a matrix (3, 3) about a point (3,), then shifted (3,), mm.

    Raises GeometryError for a move that is not finite, as a step of a fit may be.
    """
    if not (np.isfinite(rotation).all() and np.isfinite(shift_mm).all()):
        raise GeometryError("interfaces cannot be moved by NaN or inf")
    return tuple(
        replace(
            face,
            point_mm=about_mm + rotation @ (np.asarray(face.point_mm) - about_mm) + shift_mm,
            normal=rotation @ np.asarray(face.normal),
        )
        for face in interfaces
    )


_SAME_INDEX = 1e-3
"""Two statements of one group index that differ by less are of one medium: 1.8 ps over half a m."""


def scene_medium(camera: Camera) -> Medium:
    """What fills the scene behind all that a camera looks through, out and back; else air."""
    if not camera.interfaces:
        return Medium()
    index = camera.interfaces[-1].beyond.group_index
    return Medium(index, index)


def refuse_other_medium(camera: Camera, medium: Medium) -> None:
    """Refuse a medium that is not the one behind a camera's last interface.

    Parameters
    ----------
    camera : Camera
        Without interfaces, any medium will do.
    medium : Medium
        Of the scene.

    Raises
    ------
    ValueError
        Where its return index is another, by more than its stated errors and a thousandth.
    """
    if not camera.interfaces:
        return
    behind = camera.interfaces[-1].beyond.group_index
    slack = _SAME_INDEX + INDEX_SLACK_STDS * medium.return_group_index_std
    if abs(behind - medium.return_group_index) > slack:
        raise ValueError(
            f"behind the last interface light flies at a group index of {behind:g}, and "
            f"return_group_index of the medium is {medium.return_group_index:g}: give one medium, "
            "as Medium(path_group_index, return_group_index) of what fills the scene"
        )


def refuse_way_through(camera: Camera, source: Source) -> None:
    """Refuse a source on the camera's side of an interface behind which light flies otherwise.

    Parameters
    ----------
    camera : Camera
        Only its last interface is asked; a window with air behind may end beside the beam.
    source : Source
        Known or not.

    Raises
    ------
    GeometryError
        Where the source lies before it by more than its stated errors: the beam would be bent at an
        interface that bends the view alone.
    """
    if not camera.interfaces or source.position_mm is None:
        return
    last = camera.interfaces[-1]
    if abs(last.beyond.group_index - camera.stands_in.group_index) <= _SAME_INDEX:
        return
    points, normals = planes_of(camera.interfaces, camera.center_mm)
    height = float((np.asarray(source.position_mm) - points[-1]) @ normals[-1])
    std = np.hypot(
        np.linalg.norm(normals[-1] * source.position_std_xyz_mm),
        max(face.distance_std_mm for face in camera.interfaces),
    )
    if height < -INDEX_SLACK_STDS * std:
        raise GeometryError(
            f"the source lies {-height:.3g} mm before the last interface, on the camera's side, "
            "and a beam that crosses an interface is not modelled: give the place where light "
            "enters the medium behind it, or check point_mm of the interface"
        )


def interface_moved(camera: Camera, number: int, by_mm: float) -> Camera:
    """Camera whose interface `number`, and all behind it, stand farther away along its normal."""
    faces = camera.interfaces
    first = faces[number]
    normal, point = np.asarray(first.normal, float), np.asarray(first.point_mm, float)
    step = by_mm * normal * (1.0 if (point - camera.center_mm) @ normal > 0.0 else -1.0)
    moved = (replace(face, point_mm=np.asarray(face.point_mm) + step) for face in faces[number:])
    return replace(camera, interfaces=(*faces[:number], *moved))


def phase_index_moved(camera: Camera, number: int, by: float) -> Camera:
    """Camera with another phase index beyond its interface `number`; not below one."""
    face = camera.interfaces[number]
    beyond = replace(face.beyond, phase_index=max(1.0, face.beyond.phase_index + by))
    faces = list(camera.interfaces)
    faces[number] = replace(face, beyond=beyond)
    return replace(camera, interfaces=tuple(faces))


def scene_denser(camera: Camera, share: float) -> Camera:
    """Camera that sees a scene whose phase index is `share` times as high, behind its window."""
    if not camera.interfaces or share == 1.0:
        return camera
    last = len(camera.interfaces) - 1
    index = camera.interfaces[last].beyond.phase_index
    return phase_index_moved(camera, last, (share - 1.0) * index)


def planes_of(interfaces: Sequence[Interface], center_mm: Floats) -> tuple[Floats, Floats]:
    """A point of each plane (k, 3), mm, and its unit normal away from the camera (k, 3)."""
    points = np.array([face.point_mm for face in interfaces], dtype=float)
    normals = np.array([face.normal for face in interfaces], dtype=float)
    away = np.sum((points - center_mm) * normals, axis=1)
    return points, np.where(away[:, np.newaxis] < 0.0, -normals, normals)


def axes_in(normals: Floats) -> Floats:
    """Two unit axes (k, 3, 2) in planes of these normals (k, 3)."""
    axes = np.empty((len(normals), 3, 2))
    for k, normal in enumerate(normals):
        # The world axis least along the normal makes the best conditioned pair.
        one = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        one /= np.linalg.norm(one)
        axes[k] = np.column_stack((one, np.cross(normal, one)))
    return axes


def checked_interfaces(
    interfaces: Sequence[Interface], center_mm: Floats, forward: Floats
) -> tuple[Interface, ...]:
    """Interfaces as a tuple, in an order and at places that a camera can look through.

    Parameters
    ----------
    interfaces : sequence of Interface
        From the camera to the scene.
    center_mm : array of float, shape (3,)
        The camera's, world, mm.
    forward : array of float, shape (3,)
        Along its optical axis, unit.

    Raises
    ------
    ValueError
        For what is no sequence of `Interface`.
    GeometryError
        For one behind the camera or out of order.
    """
    flat: list[object] = []
    for one in interfaces if isinstance(interfaces, (list, tuple)) else [interfaces]:
        # A `window` among them is a pair of its own.
        flat.extend(one if isinstance(one, tuple) else (one,))
    faces = tuple(one for one in flat if isinstance(one, Interface))
    if len(faces) < len(flat):
        raise ValueError(
            "interfaces must be a list of Interface, from the camera to the scene (window() makes "
            "the two of a pane)"
        )
    before = 0.0
    for number, one in enumerate(faces, start=1):
        normal = np.asarray(one.normal)
        towards = float(forward @ normal)
        gap = float((np.asarray(one.point_mm) - center_mm) @ normal)
        distance = gap / towards if towards else np.inf
        if not (np.isfinite(distance) and distance > 0.0):
            raise GeometryError(
                f"interface {number} does not stand before the camera: its plane must cross the "
                "optical axis in front of the pupil; check its point_mm and normal"
            )
        if distance <= before:
            raise GeometryError(
                f"interface {number} stands {distance:.6g} mm before the camera, the one before it "
                f"{before:.6g} mm: list them in order, from the camera to the scene"
            )
        before = distance
    return faces


def way_through(
    points_mm: Floats,
    *,
    center_mm: Floats,
    front: Material,
    interfaces: Sequence[Interface],
    return_group_index: float,
) -> Way:
    """The way light takes from points to the camera.

    Parameters
    ----------
    points_mm : array of float, shape (n, 3)
        World, mm.
    center_mm : array of float, shape (3,)
        The camera's entrance pupil, world, mm.
    front : Material
        What the camera stands in.
    interfaces : sequence of Interface
        From the camera to the scene.
    return_group_index : float
        Group index of the scene's own medium.

    Returns
    -------
    Way
        NaN for points that are not behind the last interface.

    Notes
    -----
    Implements Fermat's principle as in the module's docstring (method.md, Refraction).
    """
    points, normals = planes_of(interfaces, center_mm)
    phase = np.array([front.phase_index, *(face.beyond.phase_index for face in interfaces)])
    group = np.array([front.group_index, *(face.beyond.group_index for face in interfaces)])
    group[-1] = return_group_index
    depth = np.einsum("nki,ki->nk", points_mm[:, np.newaxis] - points, normals)
    behind = (depth > 0.0).all(axis=1)
    target = np.where(behind[:, np.newaxis], points_mm, np.nan)
    if (normals @ normals[0] > 1.0 - _PARALLEL).all():
        return way_through_parallel(
            target, center_mm=center_mm, normal=normals[0],
            distances_mm=(points - center_mm) @ normals[0], phase=phase, group=group,
        )  # fmt: skip
    return way_through_any(target, center_mm, (points, normals), phase, group)


def way_through_any(
    target: Floats,
    center_mm: Floats,
    planes: tuple[Floats, Floats],
    phase: Floats,
    group: Floats,
) -> Way:
    """The way from points (n, 3) through k planes at any angle; the reference of the fast one.

    Parameters
    ----------
    target : array of float, shape (n, 3)
        Points behind all planes, world, mm.
    center_mm : array of float, shape (3,)
        The camera's entrance pupil, world, mm.
    planes : (array of float, shape (k, 3), array of float, shape (k, 3))
        By `planes_of`.
    phase, group : array of float, shape (k + 1,)
        Indices of the layers, from the camera's on.

    Returns
    -------
    Way
        As `way_through`.
    """
    points, normals = planes
    axes = axes_in(normals)
    n, k = len(target), len(points)
    depth = np.einsum("nki,ki->nk", target[:, np.newaxis] - points, normals)
    # Where the straight line meets the planes: S is convex, any start would do.
    to_plane = np.sum((points - center_mm) * normals, axis=1)
    share = to_plane / (to_plane + depth)
    straight = center_mm + share[..., np.newaxis] * (target - center_mm)[:, np.newaxis]
    places = np.einsum("nki,kia->nka", straight - points, axes)
    for _ in range(_MOST_STEPS):
        lengths, units = _stretches(places, points, axes, center_mm, target)
        gradient, hessian = _fermat(lengths, units, phase, axes)
        step = np.linalg.solve(
            np.where(np.isfinite(hessian), hessian, np.eye(2 * k)), -gradient[..., np.newaxis]
        ).reshape(n, k, 2)
        size, before = np.linalg.norm(step, axis=(1, 2)), lengths @ phase
        # Newton overshoots where a ray grazes; S is convex, so half a step that is too long is not.
        for _ in range(_MOST_HALVINGS):
            there = _stretches(places + step, points, axes, center_mm, target)[0] @ phase
            longer = there > before * (1.0 + 1e-14)
            if not longer.any():
                break
            step[longer] *= 0.5
        places = places + step
        if not (size > _STILL * before).any():
            break
    return _told(places, points, axes, center_mm, target, phase, group)


def _stretches(
    places: Floats, points: Floats, axes: Floats, center: Floats, target: Floats
) -> tuple[Floats, Floats]:
    """Lengths (n, k + 1) and unit vectors (n, k + 1, 3) of the straight pieces of a way."""
    on = points + np.einsum("nka,kia->nki", places, axes)
    n = len(target)
    corners = np.concatenate(
        (np.broadcast_to(center, (n, 1, 3)), on, target[:, np.newaxis]), axis=1
    )
    steps = np.diff(corners, axis=1)
    lengths = np.linalg.norm(steps, axis=2)
    return lengths, steps / np.maximum(lengths, 1e-300)[..., np.newaxis]


def _bends(lengths: Floats, units: Floats, index: Floats) -> Floats:
    """(n, k + 1, 3, 3): second derivative of index times length by the end of each stretch."""
    across = np.eye(3) - units[..., :, np.newaxis] * units[..., np.newaxis, :]
    bends: Floats = (index / np.maximum(lengths, 1e-300))[..., np.newaxis, np.newaxis] * across
    return bends


def _in_planes(units: Floats, index: Floats, axes: Floats) -> Floats:
    """(n, 2k): derivative of sum index_i length_i by the places in the planes."""
    pull = index[:, np.newaxis] * units
    gradient: Floats = np.einsum("kia,nki->nka", axes, pull[:, :-1] - pull[:, 1:])
    return gradient.reshape(len(units), -1)


def _fermat(lengths: Floats, units: Floats, phase: Floats, axes: Floats) -> tuple[Floats, Floats]:
    """Gradient (n, 2k) and Hessian (n, 2k, 2k) of the optical length by the places."""
    n, k = len(lengths), len(axes)
    bends = _bends(lengths, units, phase)
    hessian = np.zeros((n, k, 2, k, 2))
    for i in range(k):
        both = bends[:, i] + bends[:, i + 1]
        hessian[:, i, :, i, :] = np.einsum("ia,nij,jb->nab", axes[i], both, axes[i])
        if i + 1 < k:
            side = -np.einsum("ia,nij,jb->nab", axes[i], bends[:, i + 1], axes[i + 1])
            hessian[:, i, :, i + 1, :] = side
            hessian[:, i + 1, :, i, :] = np.swapaxes(side, 1, 2)
    return _in_planes(units, phase, axes), hessian.reshape(n, 2 * k, 2 * k)


def _told(
    places: Floats,
    points: Floats,
    axes: Floats,
    center: Floats,
    target: Floats,
    phase: Floats,
    group: Floats,
) -> Way:
    """The way and how it follows its point, once its places are found."""
    n, k = len(target), len(axes)
    lengths, units = _stretches(places, points, axes, center, target)
    _, hessian = _fermat(lengths, units, phase, axes)
    by_target = np.zeros((n, k, 2, 3))
    by_target[:, -1] = np.einsum("ia,nij->naj", axes[-1], _bends(lengths, units, phase)[:, -1])
    # dS/dq = 0 for every X, so H dq/dX = -d2S/dq dX.
    places_by_point = np.linalg.solve(
        np.where(np.isfinite(hessian), hessian, np.eye(2 * k)), by_target.reshape(n, 2 * k, 3)
    )
    optical_by_point = group[-1] * units[:, -1] + np.einsum(
        "nq,nqj->nj", _in_planes(units, group, axes), places_by_point
    )
    on = points + np.einsum("nka,kia->nki", places, axes)
    return Way(
        first_mm=on[:, 0],
        last_mm=on[:, -1],
        optical_mm=lengths @ group,
        first_by_point=np.einsum("ia,naj->nij", axes[0], places_by_point[:, :2]),
        optical_by_point=optical_by_point,
    )


def rays_through(
    rays: Floats, *, center_mm: Floats, front: Material, interfaces: Sequence[Interface]
) -> tuple[Floats, Floats, Floats]:
    """Rays behind all interfaces, by Snell's law at each.

    Parameters
    ----------
    rays : array of float, shape (..., 3)
        Unit, world, from the camera outwards.
    center_mm : array of float, shape (3,)
        Where they start, world, mm.
    front : Material
        What the camera stands in.
    interfaces : sequence of Interface
        From the camera to the scene.

    Returns
    -------
    origins_mm : array of float, shape (..., 3)
        On the last interface, world; NaN where the ray never gets behind it: it runs along a
        plane, or is totally reflected.
    directions : array of float, shape (..., 3)
        Unit, world.
    optical_mm : array of float, shape (...)
        Group index times length from the camera to the origin.
    """
    points, normals = planes_of(interfaces, center_mm)
    direction = np.asarray(rays, dtype=float)
    origin = np.broadcast_to(center_mm, direction.shape)
    optical, here = np.zeros(direction.shape[:-1]), front
    for point, normal, face in zip(points, normals, interfaces, strict=True):
        along = direction @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            way = ((point - origin) @ normal) / along
        # A tilted plane may be met from behind: that ray has left the window's side.
        way = np.where((along > 0.0) & (way >= 0.0), way, np.nan)
        origin = origin + way[..., np.newaxis] * direction
        optical = optical + here.group_index * way
        ratio = here.phase_index / face.beyond.phase_index
        with np.errstate(invalid="ignore"):
            cosine = np.sqrt(1.0 - ratio**2 * (1.0 - along**2))
        direction = ratio * direction + (cosine - ratio * along)[..., np.newaxis] * normal
        here = face.beyond
    lost = np.isnan(direction).any(axis=-1)
    return (
        np.where(lost[..., np.newaxis], np.nan, origin),
        direction,
        np.where(lost, np.nan, optical),
    )
