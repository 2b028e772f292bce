"""Errors that all pixels share: pose and lens of the cameras, group indices of the medium.

Each is one number in its own standard deviations, zero where the user's record is right.
`shared_errors` reads them off the records, `moved` is the setting with some of them. Errors of the
clock are columns of its calibration (`timing`), but for what its zero is off against another
camera's, which is told of the camera; those of source and emission time are priors on
the path (`freedom`). `freed` widens what a check names to its plausible size.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.arguments import shown
from lightflight.camera.refraction import interface_moved, phase_index_moved, scene_denser
from lightflight.flight import INDEX_SLACK_STDS, Medium
from lightflight.reconstruct import FREE_NAMES
from lightflight.reconstruct.model.forward import Local, Pixels, local_variables
from lightflight.reconstruct.model.geometry import PathState, vertex_time_jacobian
from lightflight.reconstruct.model.image_plane import (
    decentering_of_corner,
    pixels_of_undistorted,
    radial_of_corner,
    undistorted_px,
)
from lightflight.reconstruct.model.nudges import NUDGE, Nudges, nudge_between
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.model.unknowns import Layout, Light
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.shared_modes import with_shared_errors
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.code_clock import CodeClock

Floats = NDArray[np.float64]
Cameras = dict[int, "Camera"]


MEDIUM = -1
"""Stands for the medium where a camera is counted."""

_WHOLE: Mapping[str, float] = {}
"""No share is told: plausible sizes are taken whole."""

POSE, FOCAL, ASPECT, AXIS, RADIAL, DECENTERING = (
    slice(0, 6), 6, 7, slice(8, 10), 10, slice(11, 13)
)  # fmt: skip
"""Where each error of a camera stands among its numbers."""
CLOCK = 13
"""Where that of its clock's zero stands."""
INTERFACES = 14
"""Where those of its interfaces begin, two of each."""
_UNKNOWN_PS = 1e6
"""Stands for the error of a zero of which nothing is known: twenty periods of a usual laser."""


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """Directions in which a setting may be off, one standard deviation each.

    Attributes
    ----------
    names : tuple of str
        (k,), the cause that each belongs to ("pose", "focal_length", "aspect", "axis",
        "distortion", "decentering", "clock_offset", "window", "index").
    view : array of int, shape (k,)
        The camera it moves; -1: the medium.
    sigma : array of float, shape (k, 14 + 2 f)
        What one standard deviation moves: pose (rad, rad, rad, mm, mm, mm), focal length (share),
        fy / fx (share), cx, cy (px), k1, p1, p2, zero of the clock (ps), distance (mm) and phase
        index of each of the camera's f interfaces; of the medium index out and back, then zeros.
    """

    names: tuple[str, ...]
    view: NDArray[np.int64]
    sigma: Floats

    def __len__(self) -> int:
        return len(self.names)

    def nudged(self, setting: Setting, delta: Floats) -> Iterator[tuple[int, Medium, Cameras]]:
        """(k, medium, cameras moved by `delta` and by `NUDGE` more of error k), one by one.

        Of the cameras those that error k moves: one, or of the medium those behind a window.
        """
        for k, view in enumerate(self.view):
            more = delta.copy()
            more[k] += NUDGE
            medium = _medium_moved_by(setting, self, more)
            yield (
                k,
                medium,
                {
                    number: _camera_moved_by(setting, self, more, number, medium)
                    for number, camera in enumerate(setting.cameras)
                    if number == view or (view == MEDIUM and camera.interfaces)
                },
            )


def shared_errors(setting: Setting) -> SharedErrors:
    """The errors that the records of a setting state; none where all is exact."""
    names: list[str] = []
    rows: list[tuple[int, Floats]] = []
    width = width_of_errors(setting)

    def add(name: str, view: int, first: int, sigma: Floats | list[float]) -> None:
        row = np.zeros(width)
        row[first : first + len(sigma)] = sigma
        names.append(name)
        rows.append((view, row))

    for view, camera in enumerate(setting.cameras):
        for column in _pose_scale(camera).T:
            add("pose", view, 0, column)
        for name, places, std in _lens_errors(camera):
            if std > 0:
                for place in places:
                    add(name, view, place, [std])
        if camera.clock_offset_std_ps > 0:
            add("clock_offset", view, CLOCK, [min(camera.clock_offset_std_ps, _UNKNOWN_PS)])
        for number, face in enumerate(camera.interfaces):
            if face.distance_std_mm > 0:
                add("window", view, INTERFACES + 2 * number, [face.distance_std_mm])
            if face.phase_index_std > 0:
                add("index", view, INTERFACES + 1 + 2 * number, [face.phase_index_std])
    for pair in _index_scale(setting.medium):
        add("index", MEDIUM, 0, pair)
    return SharedErrors(
        tuple(names),
        np.array([view for view, _ in rows], dtype=np.int64),
        np.array([row for _, row in rows]).reshape(-1, width),
    )


def width_of_errors(setting: Setting) -> int:
    """Numbers that one shared error may move: a camera's own, and two of each interface."""
    return INTERFACES + 2 * max(len(camera.interfaces) for camera in setting.cameras)


def _lens_errors(camera: Camera) -> tuple[tuple[str, tuple[int, ...], float], ...]:
    """Cause, places among a camera's numbers and stated error of each error of its lens."""
    return (
        ("focal_length", (FOCAL,), camera.focal_std_fraction),
        ("aspect", (ASPECT,), camera.aspect_std),
        ("axis", (AXIS.start, AXIS.start + 1), camera.axis_std_px),
        ("distortion", (RADIAL,), camera.distortion_std),
        ("decentering", (DECENTERING.start, DECENTERING.start + 1), camera.decentering_std),
    )


def _pose_scale(camera: Camera) -> Floats:
    """(6, r): one-sigma moves of the camera; no columns where the pose is exact."""
    if camera.pose_covariance is None:
        return np.zeros((6, 0))
    values, vectors = np.linalg.eigh(np.asarray(camera.pose_covariance, dtype=float))
    # An exact direction has no scale and would be a column of zeros.
    keep = values > 1e-24
    scale: Floats = vectors[:, keep] * np.sqrt(values[keep])
    return scale


def _index_scale(medium: Medium) -> list[Floats]:
    """One-sigma moves (out, back) of the group indices: Cholesky's factor of their covariance."""
    out, back = medium.path_group_index_std, medium.return_group_index_std
    # What is exact goes along with nothing.
    along = medium.index_correlation if out > 0 else 0.0
    pairs = np.array([[out, along * back], [0.0, back * np.sqrt(1.0 - along**2)]])
    return [pair for pair in pairs if pair.any()]


def moved(setting: Setting, errors: SharedErrors, delta: Floats) -> Setting:
    """The setting with its cameras and medium moved by `delta` (k,) standard deviations.

    Parameters
    ----------
    setting : Setting
        As told.
    errors : SharedErrors
        Of that setting.
    delta : array of float, shape (k,)
        In standard deviations.

    Returns
    -------
    Setting
        As told where nothing moves; the stated errors stay.
    """
    if not len(errors):
        return setting
    medium = _medium_moved_by(setting, errors, delta)
    cameras = [
        _camera_moved_by(setting, errors, delta, view, medium)
        for view in range(len(setting.cameras))
    ]
    return replace(setting, camera=cameras[0], others=tuple(cameras[1:]), medium=medium)


def _medium_moved_by(setting: Setting, errors: SharedErrors, delta: Floats) -> Medium:
    own = errors.view == MEDIUM
    if not own.any():
        return setting.medium
    return _medium_moved(setting.medium, errors.sigma[own].T @ delta[own])


def _camera_moved_by(
    setting: Setting, errors: SharedErrors, delta: Floats, view: int, medium: Medium
) -> Camera:
    # What times the light bends it: both indices of a medium are off by the same share.
    share = medium.return_group_index / setting.medium.return_group_index
    camera, own = scene_denser(setting.cameras[view], share), errors.view == view
    return _camera_moved(camera, errors.sigma[own].T @ delta[own]) if own.any() else camera


def _camera_moved(camera: Camera, by: Floats) -> Camera:
    """The camera moved by the numbers (14 + 2 f,) of `SharedErrors.sigma`."""
    # A pose that is exact stays, bit for bit.
    camera = camera.perturbed(by[POSE]) if by[POSE].any() else camera
    camera = camera.with_lens_moved(
        focal_share=float(by[FOCAL]), aspect=float(by[ASPECT]), axis_px=tuple(by[AXIS]),
        radial=float(by[RADIAL]), decentering=tuple(by[DECENTERING]),
    )  # fmt: skip
    if by[CLOCK]:
        camera = replace(camera, clock_offset_ps=camera.clock_offset_ps + float(by[CLOCK]))
    for number, (farther_mm, denser) in enumerate(by[INTERFACES:].reshape(-1, 2)):
        camera = interface_moved(camera, number, farther_mm) if farther_mm else camera
        camera = phase_index_moved(camera, number, denser) if denser else camera
    return camera


def _indices(medium: Medium) -> Floats:
    return np.array([medium.path_group_index, medium.return_group_index])


def _medium_moved(medium: Medium, by: Floats) -> Medium:
    """The medium with its indices (out, back) moved; not beyond what a record may hold."""
    slack = 0.999 * INDEX_SLACK_STDS
    stds = np.array([medium.path_group_index_std, medium.return_group_index_std])
    out, back = np.clip(_indices(medium) + by[:2], 1.0 - slack * stds, 10.0)
    return replace(medium, path_group_index=float(out), return_group_index=float(back))


def nudges_of_views(
    setting: Setting, errors: SharedErrors, delta: Floats, seen: Setting
) -> tuple[Nudges, ...]:
    """How each camera's picture follows the shared errors, about where they stand.

    Parameters
    ----------
    setting : Setting
        As told.
    errors : SharedErrors
        Of that setting.
    delta : array of float, shape (k,)
        Where they stand, in standard deviations.
    seen : Setting
        The setting `moved` by these.

    Returns
    -------
    tuple of Nudges
        One for each camera.
    """
    found = [
        Nudges(
            camera,
            turn_rad=np.zeros((len(errors), 3)),
            shift_mm=np.zeros((len(errors), 3)),
            index=np.zeros((len(errors), 2)),
            late_ps=np.zeros(len(errors)),
            lenses={},
        )
        for camera in seen.cameras
    ]
    for k, medium, cameras in errors.nudged(setting, delta):
        view = int(errors.view[k])
        if view == MEDIUM:
            for number, nudges in enumerate(found):
                nudges.index[k] = (_indices(medium) - _indices(seen.medium)) / NUDGE
                if number in cameras:
                    nudges.lenses[k] = cameras[number]
            continue
        turn, shift, lens = nudge_between(seen.cameras[view], cameras[view])
        found[view].turn_rad[k], found[view].shift_mm[k] = turn / NUDGE, shift / NUDGE
        late_ps = cameras[view].clock_offset_ps - seen.cameras[view].clock_offset_ps
        found[view].late_ps[k] = late_ps / NUDGE
        if lens is not None:
            found[view].lenses[k] = lens
    return tuple(found)


def undistorted_as_moved(points: Floats, told: Camera, seen: Camera) -> Floats:
    """Points (n, 2) of the undistorted picture of one camera in that of another; same pixels.

    Parameters
    ----------
    points : array of float, shape (n, 2)
        (u, v), px, of the camera `told`.
    told : Camera
        As it was when the points were measured.
    seen : Camera
        The same with its lens moved.

    Returns
    -------
    array of float, shape (n, 2)
        The same array where both lenses are one.
    """
    same = np.array_equal(told.matrix, seen.matrix)
    if same and np.array_equal(told.distortion, seen.distortion):
        return points
    return undistorted_px(seen, *pixels_of_undistorted(told, points))


def vertex_time_columns(errors: SharedErrors, state: PathState) -> Floats:
    """d(x, y, z, t of every vertex) / d(shared errors); (4m, k): a slower pulse is later.

    Parameters
    ----------
    errors : SharedErrors
        k of them.
    state : PathState
        The path.

    Returns
    -------
    array of float, shape (4m, k)
        Zero but for the times, and for the indices' columns.
    """
    travelled = state.in_medium_mm
    columns = np.zeros((len(travelled), 4, len(errors)))
    own = np.flatnonzero(errors.view == MEDIUM)
    columns[:, 3, own] = np.outer(travelled, errors.sigma[own, 0]) / SPEED_OF_LIGHT_MM_PER_PS
    return columns.reshape(4 * len(travelled), len(errors))


def group_index_std(errors: SharedErrors, covariance: Floats) -> float:
    """One-sigma error of the group index along a path; 0 where it is exact.

    Parameters
    ----------
    errors : SharedErrors
        k of them.
    covariance : array of float, shape (k, k)
        Of their sizes in standard deviations, as a fit found them.

    Returns
    -------
    float
    """
    by_error = np.where(errors.view == MEDIUM, errors.sigma[:, 0], 0.0)
    return float(np.sqrt(max(float(by_error @ covariance @ by_error), 0.0)))


def vertices_by_parameters(
    state: PathState, medium: Medium, basis: Floats, errors: SharedErrors, *, first: int
) -> tuple[NDArray[np.int64], Floats]:
    """Which parameters move vertices, their times and bends (k,), and how, (4m + b, k).

    Those are the freedom, first of all parameters, and errors of the medium.

    Parameters
    ----------
    state : PathState
        The path.
    medium : Medium
        Group indices out and back.
    basis : array of float, shape (3m + 1, p)
        Columns are unit moves of (vertices in mm, start time in ps).
    errors : SharedErrors
        Those that are parameters too.
    first : int
        The place of the first of those.

    Returns
    -------
    rows : array of int, shape (k,)
        Places among the parameters.
    jacobian : array of float, shape (4m + b, k)
        x, y, z, t of every vertex, then the b coefficients of bends; mm and ps.
    """
    to_vertices = vertex_time_jacobian(state, medium) @ basis
    by_shared = vertex_time_columns(errors, state)
    own = np.flatnonzero(by_shared.any(axis=0))
    if len(own):
        to_vertices = np.column_stack((to_vertices, by_shared[:, own]))
    if state.bends:
        of_bends = np.zeros((state.size - state.vertices_mm.size - 1, to_vertices.shape[1]))
        of_bends[:, : basis.shape[1]] = basis[state.vertices_mm.size + 1 :]
        to_vertices = np.vstack((to_vertices, of_bends))
    return np.concatenate((np.arange(basis.shape[1]), first + own)), to_vertices


def local_with_shared(
    state: PathState,
    light: Light,
    pixels: Pixels,
    layout: Layout,
    *,
    basis: Floats,
    modes: Floats,
    setting: Setting,
    errors: SharedErrors,
    delta: Floats,
    view: int = 0,
) -> Local:
    """`local_variables` as the moved setting sees them, and how they follow the shared errors.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    light : Light
        Brightness, spot and pulse width.
    pixels : Pixels
        The pixels that take part.
    layout : Layout
        Where each kind of parameter sits.
    basis : array of float, shape (3m + 1, p)
        Columns are unit moves of (vertices in mm, start time in ps).
    modes : array of float, shape (k,)
        Shared clock errors, in standard deviations.
    setting : Setting
        As told.
    errors : SharedErrors
        Of that setting.
    delta : array of float, shape (k,)
        Where they stand, in standard deviations.
    view : int, optional
        Which of the setting's cameras sees the pixels.

    Returns
    -------
    Local
        (n, L) each.
    """
    seen = moved(setting, errors, delta)
    camera = seen.cameras[view]
    seen_px = undistorted_px(camera, pixels.rows, pixels.cols) if len(errors) else None
    nudges = nudges_of_views(setting, errors, delta, seen)[view] if len(errors) else None
    return local_variables(
        state, light, pixels, layout, basis=basis, modes=modes, camera=camera,
        medium=seen.medium, nudges=nudges, seen_px=seen_px,
    )  # fmt: skip


def freed_names(free: Iterable[str]) -> list[str]:
    """Names of `free=`, checked.

    Parameters
    ----------
    free : iterable of str
        As given; one may stand alone.

    Returns
    -------
    list of str
        Of `FREE_NAMES`.

    Raises
    ------
    ValueError
        For another name.
    """
    try:
        names = [free] if isinstance(free, str) else list(free)
    except TypeError:
        names = [shown(free)]
    for name in names:
        if not isinstance(name, str) or name not in FREE_NAMES:
            raise ValueError(f"free: {shown(name)} is none of {', '.join(FREE_NAMES)}")
    return names


def freed(
    setting: Setting,
    clocks: Sequence[CodeClock | None],
    recordings: Sequence[Histograms],
    free: Iterable[str],
    shares: Mapping[str, float] = _WHOLE,
) -> tuple[Setting, list[CodeClock | None]]:
    """Setting and clocks with what `free` names uncertain by its plausible size, or a share of it.

    Parameters
    ----------
    setting : Setting
        As told.
    clocks : sequence of CodeClock or None
        One for each recording, in their order; None: nominal codes.
    recordings : sequence of Histograms
        Those recordings.
    free : iterable of str
        Of `FREE_NAMES`.
    shares : mapping of str to float, optional
        Of the plausible size, for each name; one where there is none.

    Returns
    -------
    setting : Setting
        Its records state these errors, or larger ones that were told.
    clocks : list of CodeClock or None
        Theirs too.

    Raises
    ------
    ValueError
        For another name.
    """
    wanted = {name: shares.get(name, 1.0) for name in freed_names(free)}
    source, medium = setting.source, setting.medium
    if "source" in wanted:
        size = wanted["source"] * PLAUSIBLE["source"].size
        std = np.maximum(source.position_std_xyz_mm, size)
        source = replace(source, position_std_mm=tuple(std.tolist()))
    if "emission_time" in wanted:
        size = wanted["emission_time"] * PLAUSIBLE["source time"].size
        source = replace(source, emission_time_std_ps=max(source.emission_time_std_ps, size))
    if "index" in wanted:
        size = wanted["index"] * PLAUSIBLE["index"].size
        stds = (medium.path_group_index_std, medium.return_group_index_std)
        out, back = (max(std, size) for std in stds)
        # The test that names it asks for each way by itself: a camera may stand in another medium.
        medium = replace(
            medium, path_group_index_std=out, return_group_index_std=back, index_correlation=0.0
        )
    cameras = [_freed_camera(camera, wanted) for camera in setting.cameras]
    if "clock_offset" in wanted:
        # The first camera's clock is freed against the laser, others against it: below, and here.
        size = wanted["clock_offset"] * PLAUSIBLE["clock_offset"].size
        cameras[1:] = [
            replace(camera, clock_offset_std_ps=max(camera.clock_offset_std_ps, size))
            for camera in cameras[1:]
        ]
    widened = replace(
        setting, camera=cameras[0], others=tuple(cameras[1:]), source=source, medium=medium
    )
    pairs = enumerate(zip(clocks, recordings, strict=True))
    n = len(recordings)
    others = {name: share for name, share in wanted.items() if name != "clock_offset"}
    freed_clocks = [
        _freed_clock(c, hist, wanted if not (k and setting.others) else others, (k + 0.5) / n)
        for k, (c, hist) in pairs
    ]
    return widened, freed_clocks


def _freed_camera(camera: Camera, wanted: Mapping[str, float]) -> Camera:
    changes: dict[str, object] = {}
    if "pose" in wanted:
        std = np.repeat([PLAUSIBLE["pose turn"].size, PLAUSIBLE["pose shift"].size], 3)
        told = np.zeros((6, 6)) if camera.pose_covariance is None else camera.pose_covariance
        changes["pose_covariance"] = told + np.diag((wanted["pose"] * std) ** 2)
    for name, error, size in _lens_sizes(camera):
        if name in wanted:
            changes[error] = max(getattr(camera, error), wanted[name] * size)
    faces = list(camera.interfaces)
    if "window" in wanted and faces:
        size = wanted["window"] * PLAUSIBLE["window"].size
        faces[0] = replace(faces[0], distance_std_mm=max(faces[0].distance_std_mm, size))
    if "index" in wanted and faces:
        # Another material, not the same one denser: phase and group index by themselves.
        size = wanted["index"] * PLAUSIBLE["index"].size
        faces[-1] = replace(faces[-1], phase_index_std=max(faces[-1].phase_index_std, size))
    if faces:
        changes["interfaces"] = tuple(faces)
    return replace(camera, **changes) if changes else camera  # type: ignore[arg-type]


def _lens_sizes(camera: Camera) -> tuple[tuple[str, str, float], ...]:
    """Name of `free=`, field of the camera and plausible size of each error of its lens."""
    radial = radial_of_corner(camera, PLAUSIBLE["distortion"].size)
    askew = decentering_of_corner(camera, PLAUSIBLE["decentering"].size)
    return (
        ("focal_length", "focal_std_fraction", PLAUSIBLE["focal_length"].size),
        ("aspect", "aspect_std", PLAUSIBLE["aspect"].size),
        ("axis", "axis_std_px", PLAUSIBLE["axis"].size),
        ("distortion", "distortion_std", radial),
        ("decentering", "decentering_std", askew),
    )


def _freed_clock(
    clock: CodeClock | None, hist: Histograms, wanted: Mapping[str, float], when: float
) -> CodeClock | None:
    """The clock with wider errors; `when`: the recording's middle as a share of all repeats."""
    names = ("clock_offset", "clock_scale", "clock_drift", "calibration")
    sizes = (wanted.get(name, 0.0) * PLAUSIBLE[name].size for name in names)
    offset, scale, drift, skew = sizes
    if not (offset or scale or drift or skew):
        return clock
    clock = TimingCalibration.nominal(hist) if clock is None else clock
    if not isinstance(clock, TimingCalibration):
        raise TypeError(f"free: the errors of a {type(clock).__name__} cannot be widened")
    return with_shared_errors(
        clock, offset_std_ps=offset, scale_std=scale, drift_std_ps=drift * when, skew_std_ps=skew
    )
