"""What a fit took as exact, and what it costs where it is not: mm at a vertex for a size of it.

How far its vertices follow the data that a source, a camera or a medium off by that size would have
made: by the fit's own linear system, and the error per pulse that the misfit makes it believe in.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import Source
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.least_squares import Rays, Slopes, modelled
from lightflight.reconstruct.fit.robust import floor_variance
from lightflight.reconstruct.model.geometry import vertex_time_jacobian
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import (
    CLOCK,
    FOCAL,
    INTERFACES,
    MEDIUM,
    RADIAL,
    SharedErrors,
    undistorted_as_moved,
    width_of_errors,
)

Floats = NDArray[np.float64]

_ROUNDS = 4
"""Most rounds of step and floor; the third changes a price by some per cent."""
_SETTLED = 0.1
"""A floor's variance that changes by less than this share leaves the digits of a price."""


@dataclass(frozen=True)
class _Unit:
    """A thing taken as exact, and a handy size that it might be off by."""

    thing: str
    size: str
    view: int
    sigma: tuple[float, ...]


def _units(setting: Setting) -> list[_Unit]:
    """Things of camera and medium that are told as exact; of further cameras the clocks."""
    camera, medium = setting.camera, setting.medium
    pose = np.zeros(6) if camera.pose_covariance is None else np.diag(camera.pose_covariance)
    found, width = [], width_of_errors(setting)
    for axis, name in enumerate("xyz"):
        for first, thing, size, step in (
            (3, "camera's place", f"1 mm in {name}", 1.0),
            (0, "camera's rotation", f"0.1° about {name}", np.radians(0.1)),
        ):
            if pose[first + axis] == 0.0:
                sigma = np.eye(width)[first + axis] * step
                found.append(_Unit(thing, size, 0, tuple(sigma)))
    if camera.focal_std_fraction == 0.0:
        found.append(_Unit("focal length", "1 %", 0, tuple(np.eye(width)[FOCAL] * 0.01)))
    if camera.distortion_std == 0.0:
        found.append(_Unit("distortion", "0.01 of k1", 0, tuple(np.eye(width)[RADIAL] * 0.01)))
    if camera.interfaces and not any(face.distance_std_mm for face in camera.interfaces):
        found.append(_Unit("window", "1 mm", 0, tuple(np.eye(width)[INTERFACES])))
    for view, other in enumerate(setting.others, start=1):
        if other.clock_offset_std_ps == 0.0:
            late = tuple(np.eye(width)[CLOCK] * 10.0)
            found.append(_Unit(f"clock of camera {view + 1}", "10 ps", view, late))
    if medium.path_group_index_std == 0.0 and medium.return_group_index_std == 0.0:
        both = (np.eye(width)[0] + np.eye(width)[1]) * 1e-3
        found.append(_Unit("group index", "0.001", MEDIUM, tuple(both)))
    return found


def prices_of_fit(fit: JointFit, setting: Setting) -> tuple[str, ...]:
    """One sentence for each thing that was taken as exact, the dearest direction of each.

    Parameters
    ----------
    fit : JointFit
        The joint fit.
    setting : Setting
        As told.

    Returns
    -------
    tuple of str
        "source exact: 1 mm in z moves corner 1 by 0.45 mm" ...
    """
    dearest: dict[str, tuple[float, str]] = {}
    to_vertices = vertex_time_jacobian(fit.solution.state, fit.solution.medium)
    for thing, size, times, lines in _off_by(fit, setting):
        step = _settled_step(fit, times, lines)[: fit.freedom.basis.shape[1]]
        moves = (to_vertices @ fit.freedom.basis @ step).reshape(-1, 4)
        # Vertex 0 is the source, where that is known: what follows from it is of interest.
        moved_mm = np.linalg.norm(moves[1:, :3], axis=1)
        corners = moved_mm[:-1] if len(moved_mm) > 1 else moved_mm
        worst = int(np.argmax(corners))
        where = f"corner {worst + 1}" if len(moved_mm) > 1 else "the exit"
        said = f"{thing} exact: {size} moves {where} by {corners[worst]:.2g} mm"
        dearest[thing] = max(dearest.get(thing, (-1.0, "")), (float(corners[worst]), said))
    return tuple(said for _, said in dearest.values())


def _settled_step(fit: JointFit, times: Floats, lines: Floats) -> Floats:
    """How the parameters (p,) follow data that are off by times (n,) and whitened lines (2 L,).

    The joint fit gives every pulse the error that the misfit asks for, and then believes pulses and
    lines in another proportion: a millimetre of source may cost twice what a hundredth promises.
    """
    solution, n = fit.solution, len(times)
    weights = fit.times.weights(fit.floor_ps**2)
    by_time = solution.columns[:n] / np.sqrt(np.maximum(weights, 1e-300))[:, np.newaxis]
    floor_var = fit.floor_ps**2
    for _ in range(_ROUNDS):
        root = np.sqrt(fit.times.weights(floor_var))
        columns, data = solution.columns.copy(), np.zeros(len(solution.columns))
        columns[:n] = by_time * root[:, np.newaxis]
        data[:n], data[n : n + len(lines)] = root * times, lines
        step = np.linalg.lstsq(columns, data, rcond=None)[0].astype(np.float64, copy=False)
        left = solution.residual_ps + times - by_time @ step
        before, floor_var = floor_var, floor_variance(fit.times, solution, left)
        if abs(floor_var - before) <= _SETTLED * floor_var:
            break
    return step


def _off_by(fit: JointFit, setting: Setting) -> Iterator[tuple[str, str, Floats, Floats]]:
    """(thing, size, times (n,), whitened line offsets (2 L,)): what it would do to the data."""
    solution, n = fit.solution, len(fit.times.leg)
    units = _units(setting)
    errors = SharedErrors(
        tuple(unit.thing for unit in units),
        np.array([unit.view for unit in units], dtype=np.int64),
        np.array([unit.sigma for unit in units]).reshape(-1, width_of_errors(setting)),
    )
    seen = Setting(solution.cameras[0], Source(), solution.medium, others=solution.cameras[1:])
    # Anchors are told in the picture of the lens as told.
    anchors = fit.lines.anchors.copy()
    for number, camera in enumerate(setting.cameras):
        own = fit.lines.view == number
        anchors[own] = undistorted_as_moved(anchors[own], camera, seen.cameras[number])
    lines = replace(fit.lines, anchors=anchors)
    still = np.zeros(len(errors))
    slopes = modelled(solution.state, fit.times, lines, seen, errors, still, Rays()).slopes()
    for k, unit in enumerate(units):
        yield unit.thing, unit.size, slopes.by_shared[:n, k], slopes.by_shared[n:, k]
    yield from _off_at_the_start(fit, slopes, setting.source)


def _off_at_the_start(
    fit: JointFit, slopes: Slopes, source: Source
) -> Iterator[tuple[str, str, Floats, Floats]]:
    if source.position_mm is None:
        return
    by_line = fit.lines.whitening @ slopes.offset_by_state
    for axis in np.flatnonzero(source.position_std_xyz_mm == 0):
        size = f"1 mm in {'xyz'[axis]}"
        yield "source", size, slopes.arrival_by_state[:, axis], by_line[:, axis]
    if source.emission_time_ps is not None and source.emission_time_std_ps == 0:
        yield "emission time", "1 ps", slopes.arrival_by_state[:, -1], by_line[:, -1]
