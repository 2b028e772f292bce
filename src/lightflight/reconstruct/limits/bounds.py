"""What the photons allow: the Cramér-Rao bound of a path, and what the data leave open.

Takes a scene or a path (anything with `vertices_mm`, `camera`, `source`, `medium`) and how much
light there is; gives the smallest covariance any unbiased estimator can have, by the Fisher
information of the counts under `forward`, with these nuisances: every pixel's background,
emission time and source as far as unknown, log-strength along the legs (one knot per three
pixels), spot width, the errors that camera and medium state, and those of the clock. Gauges are
projected out: an unknown source is replaced by the entry into view, the end by the exit. No
recording is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import check_kinds
from lightflight.display import Card, Shown, number, picture_from_vertices
from lightflight.errors import GeometryError
from lightflight.flight import Medium, Source
from lightflight.path.bends import BentCourse
from lightflight.path.light_path import LightPath
from lightflight.path.on_bends import course_of_leg, covariance_on_bent_leg, drawn_outline_mm
from lightflight.path.tables import Goodness
from lightflight.reconstruct.fit.result import prior_in_words
from lightflight.reconstruct.fit.statements import statements_from_covariance
from lightflight.reconstruct.limits.conditions import (
    Conditions,
    conditions_of,
    expected_codes,
    light_and_pixels,
)
from lightflight.reconstruct.model.freedom import (
    Freedom,
    ends_in_view,
    freedom_of_path,
    last_in_view,
    view_end,
    view_plane,
    with_tip,
)
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.glass import through_blocks
from lightflight.reconstruct.model.information import covariance_from_information
from lightflight.reconstruct.model.likelihood import likelihood
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.shared import (
    local_with_shared,
    shared_errors,
    vertices_by_parameters,
)
from lightflight.reconstruct.model.told import (
    ToldLength,
    Waypoint,
    checked_lengths,
    checked_waypoints,
)
from lightflight.reconstruct.model.unknowns import layout_of
from lightflight.timing.clock.response import Response

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.timing.clock.code_clock import CodeClock

Floats = NDArray[np.float64]

_GAUGE = 1e-13
"""Share of the largest scaled information below which a direction is a gauge, fixed by nothing."""
_FIXED = 1e12
"""Information that stands for "known exactly"."""


@dataclass(frozen=True, eq=False, repr=False)
class Bounds(Shown):
    """The smallest errors any unbiased estimator can reach.

    Attributes
    ----------
    path : LightPath
        The path with the bound as its covariance: `path.sample`, `path.legs`, `vertex_std` ...
    position_rms_mm : float
        rms error of the position in view, at equal event times, mm; over all branches.
    event_time_rms_ps : float
        rms error of the event time on the path in view, ps.
    angle_std_deg : array of float, shape (legs,)
        Of the elevation of each leg, deg.
    photons : float
        Expected signal photons in all pixels.
    photons_per_pixel : float
        Expected signal photons in the brightest pixel.
    n_pixels : int
        Pixels that see at least one photon in a hundred recordings.
    prior : str
        What is taken as known, in words.
    statements : tuple of str
        What these data fix and what they do not, one sentence each.
    condition : float
        Condition number of the path's information matrix, parameters in their own errors' units.
    """

    path: LightPath
    position_rms_mm: float
    event_time_rms_ps: float
    angle_std_deg: Floats
    photons: float
    photons_per_pixel: float
    n_pixels: int
    prior: str
    statements: tuple[str, ...]
    condition: float

    def _card(self) -> Card:
        facts = [
            ("prior", self.prior),
            ("photons", f"{number(self.photons, 4)} in {self.n_pixels} pixels"),
            ("position, rms in view", f"{number(self.position_rms_mm, 3)} mm"),
            ("event time, rms in view", f"{number(self.event_time_rms_ps, 3)} ps"),
            ("elevation of the legs", ", ".join(f"{number(a, 2)}°" for a in self.angle_std_deg)),
            *(("", sentence) for sentence in self.statements),
        ]
        picture = partial(picture_from_vertices, drawn_outline_mm(self.path))
        return Card("Bounds", facts, picture, "from the front, and from above")

    @property
    def vertex_std(self) -> Floats:
        """(m, 4), x, y, z (mm) and t (ps) of each vertex."""
        return self.path.vertex_std


def bounds(
    subject: object,
    *,
    photons_per_pixel: float = 40_000.0,
    source: Source | None = None,
    camera: Camera | None = None,
    medium: Medium | None = None,
    spot_std_px: float | None = None,
    pulse_std_ps: float | None = None,
    response: Response | None = None,
    code_width_ps: float | None = None,
    background_per_code: float | None = None,
    pixel_std_ps: float = 0.0,
    timing: CodeClock | None = None,
    waypoints: tuple[tuple[int, ArrayLike, float], ...] = (),
    lengths: tuple[tuple[int, float, float], ...] = (),
) -> Bounds:
    """Cramér-Rao bound of a scene or path.

    Parameters
    ----------
    subject : object
        A Scene, a LightPath, or anything with `vertices_mm` (m, 3), `camera`, `source`, `medium`.
        Where it has a detector, spot, response and code width come from that.
    photons_per_pixel : float, optional
        Expected signal photons in the brightest pixel.
    source, camera, medium : Source, Camera, Medium, optional
        Stand in for those of the subject.
    spot_std_px : float, optional
        std of optics and active area, px (else from the detector, else 0.35).
    pulse_std_ps : float, optional
        std of laser pulse and response, ps (else from source and detector, else 70).
    response : Response, optional
        Shape of a recorded pulse (else the detector's, with its tail; else a Gaussian). The
        estimators must be told it too, by a calibration whose flat was fitted with it.
    code_width_ps : float, optional
        ps (else from the detector, else 55).
    background_per_code : float, optional
        Background counts per pixel and code (else from the scene, else 0.02).
    pixel_std_ps : float, optional
        Calibration error of each pixel, ps.
    timing : CodeClock, optional
        A calibration whose errors count beside that: of each pixel, and those all share.
    waypoints : tuple of (int, array_like, float), optional
        (vertex index, position_mm, std_mm) of corners measured otherwise.
    lengths : tuple of (int, float, float), optional
        (leg, length_mm, std_mm) of legs, from 0, measured otherwise.

    Raises
    ------
    GeometryError
        Where the camera does not see the path.
    ValueError
        For a subject without vertices or camera, or a light level that is not positive.
    """
    check_kinds(camera=camera, source=source, medium=medium, timing=timing, response=response)
    source = source or getattr(subject, "source", None) or Source()
    medium = medium or getattr(subject, "medium", None) or Medium()
    camera = camera or getattr(subject, "camera", None)
    if not hasattr(subject, "vertices_mm") or camera is None:
        raise ValueError("bounds needs a Scene or a LightPath: vertices_mm and a camera")
    told = checked_waypoints(waypoints, None), checked_lengths(lengths, None)
    conditions = conditions_of(
        subject,
        source,
        photons_per_pixel=photons_per_pixel,
        spot_std_px=spot_std_px,
        pulse_std_ps=pulse_std_ps,
        response=response,
        code_width_ps=code_width_ps,
        background_per_code=background_per_code,
        pixel_std_ps=pixel_std_ps,
        timing=timing,
    )
    times = getattr(subject, "vertex_times_ps", None)
    start = 0.0 if times is None else float(np.asarray(times)[0])
    forks = tuple(getattr(subject, "forks", ()))
    bends = tuple(getattr(subject, "bends", ()))
    vertices = np.array(subject.vertices_mm, dtype=float)
    whole = PathState(vertices, start, forks=forks, bends=bends)
    whole = through_blocks(whole, medium.blocks, (camera,))
    # Beyond the view nothing is recorded: what lies there is a gauge, not an error.
    state, freedom, cut_ends = _state_in_view(whole, camera, medium, source, *told)
    setting = Setting(camera, source, medium)
    known = _information(state, whole, freedom, cut_ends, conditions, setting)
    return _bounds(
        state,
        known,
        freedom,
        conditions.photons_per_pixel,
        camera=camera,
        source=source,
        medium=medium,
    )


def _state_in_view(
    whole: PathState,
    camera: Camera,
    medium: Medium,
    source: Source,
    waypoints: tuple[Waypoint, ...],
    lengths: tuple[ToldLength, ...],
) -> tuple[PathState, Freedom, tuple[bool, ...]]:
    """The path cut where it enters (unknown source) and leaves the view, and its freedom.

    Besides, whether its light begins within the view, and whether each branch stops there: such an
    end is free along its leg too.
    """
    whole = _with_bent_ends_cut(whole, camera, medium, source)
    vertices, start_time = whole.vertices_mm.copy(), whole.start_time_ps
    ends = [(int(whole.leg_starts[leg]), leg + 1) for leg in whole.last_legs]
    for before, tip in ends:
        if not whole.is_bent(np.array([tip - 1]))[0]:
            vertices[tip] = _end_in_view(vertices[before], vertices[tip], camera, tip)
    start_basis = None
    begins = ends_in_view(camera, vertices[0])
    if source.position_mm is not None:
        begins = bool(camera.sees(vertices[0]))
    cut_ends = (begins, *(ends_in_view(camera, vertices[tip]) for _, tip in ends))
    if source.position_mm is None and not whole.is_bent(np.array([0]))[0]:
        first = _middle_in_view(vertices[0], vertices[1], camera, 1)
        step = vertices[1] - vertices[0]
        direction = step / np.linalg.norm(step)
        entry = view_end(camera, first, -direction)
        if entry is not None and (entry.position_mm - vertices[0]) @ direction > 0:
            cut = PathState(np.array([vertices[0], entry.position_mm]), start_time)
            start_time = float(cut.vertex_times_ps(medium)[-1])
            vertices[0] = entry.position_mm
    state = replace(whole, vertices_mm=vertices, start_time_ps=start_time)
    if source.position_mm is None:
        after = _neighbour(state, 0, 1, 0)
        start_basis = _moves_of_end(camera, vertices[0], after, in_view=cut_ends[0])
    freedom = freedom_of_path(
        state,
        source=source,
        waypoints=waypoints,
        start_basis=start_basis,
        end_bases=tuple(
            _moves_of_end(
                camera, vertices[tip], _neighbour(state, tip, before, tip - 1), in_view=cut
            )
            for (before, tip), cut in zip(ends, cut_ends[1:], strict=True)
        ),
        lengths=lengths,
    )
    return state, freedom, cut_ends


def _neighbour(state: PathState, vertex: int, other: int, leg: int) -> Floats:
    """Where a leg goes on from one of its ends: its other end, or along its tangent there; (3,)."""
    if not state.is_bent(np.array([leg]))[0]:
        return np.asarray(state.vertices_mm[other])
    at_end = vertex == leg + 1
    tangent = state.tangents_mm(leg, np.array([float(at_end)]))[0]
    towards: Floats = state.vertices_mm[vertex] + (-tangent if at_end else tangent)
    return towards


def _end_in_view(start: Floats, end: Floats, camera: Camera, leg: int) -> Floats:
    """Where a leg leaves the view, or its end where that is in view: it is not prolonged; (3,)."""
    last = _middle_in_view(start, end, camera, leg)
    step = end - start
    at_edge = view_end(camera, last, step / np.linalg.norm(step))
    if at_edge is None or not (at_edge.position_mm - end) @ step < 0:
        return end
    return at_edge.position_mm


def _with_bent_ends_cut(
    whole: PathState, camera: Camera, medium: Medium, source: Source
) -> PathState:
    """The same flight, with bent legs at its ends cut where they enter and leave the view."""
    ends = [(whole.n_legs - 1, True)] + [(0, False)] * (source.position_mm is None)
    for leg, at_end in ends:
        if not whole.is_bent(np.array([leg]))[0]:
            continue
        fraction = np.linspace(0.0, 1.0, 2001)
        seen = np.flatnonzero(camera.sees(whole.points_mm(leg, fraction)))
        if not len(seen):
            raise GeometryError(
                f"the camera does not see leg {leg + 1} of the path: check its pose"
            )

        def place(at: Floats | float, leg: int = leg, path: PathState = whole) -> Floats:
            found = path.points_mm(leg, np.atleast_1d(np.asarray(at, dtype=float)))
            return found if np.ndim(at) else found[0]

        middle = int(seen[len(seen) // 2])
        last = last_in_view(camera, place, fraction[middle:] if at_end else fraction[middle::-1])
        if last is not None:
            whole = whole.prolonged(leg, last, medium, at_end=at_end)
    return whole


def _middle_in_view(start: Floats, end: Floats, camera: Camera, leg: int) -> Floats:
    fraction = np.linspace(0, 1, 2001)[:, np.newaxis]
    points = (1 - fraction) * start + fraction * end
    seen = np.flatnonzero(camera.sees(points))
    if not len(seen):
        raise GeometryError(f"the camera does not see leg {leg} of the path: check its pose")
    middle: Floats = points[seen[len(seen) // 2]]
    return middle


def _moves_of_end(camera: Camera, end: Floats, before: Floats, *, in_view: bool) -> Floats:
    """How an end may move: along its ray, across its leg, in view along it too; (3, 2 or 3)."""
    plane = view_plane(camera, end, before)
    return with_tip(plane, end, end - before, camera) if in_view else plane


@dataclass(frozen=True, eq=False)
class _Information:
    """What the counts and the priors know of a path.

    Attributes
    ----------
    covariance : array of float, shape (p, p)
        Of the path's freedom, every nuisance eliminated; mm and ps.
    vertex_covariance : array of float, shape (4m + b, 4m + b)
        Of x, y, z, t of every vertex, then of the b coefficients of bends.
    signal : array of float, shape (n, L)
        Expected photons of each leg in each pixel.
    """

    covariance: Floats
    vertex_covariance: Floats
    signal: Floats


def _information(
    state: PathState,
    whole: PathState,
    freedom: Freedom,
    cut_ends: tuple[bool, ...],
    conditions: Conditions,
    setting: Setting,
) -> _Information:
    """The Fisher information of the expected counts, turned into the path's covariance."""
    camera, medium = setting.camera, setting.medium
    light, pixels = light_and_pixels(state, whole, cut_ends, conditions, camera, medium)
    errors, n_modes = shared_errors(setting), pixels.n_modes
    layout = layout_of(freedom.basis.shape[1], n_modes, light, len(errors))
    local = local_with_shared(
        state,
        light,
        pixels,
        layout,
        basis=freedom.basis,
        modes=np.zeros(n_modes),
        setting=setting,
        errors=errors,
        delta=np.zeros(len(errors)),
    )
    n = len(pixels.rows)
    found = likelihood(
        local,
        pixels,
        expected_codes(local, conditions),
        log_background=np.full(n, np.log(conditions.background_per_ps)),
        delay_shift_ps=np.zeros(n),
        expected_only=True,
    )
    prior = np.zeros_like(found.information)
    prior[: layout.n_free, : layout.n_free] = freedom.prior_information
    units = np.arange(layout.size)[layout.unit_priors]
    prior[units, units] = 1.0
    # A calibrated pulse's width is known: left free it would take part of the times' information.
    prior[-1, -1] = _FIXED
    covariance = covariance_from_information(found.information + prior, rcond=_GAUGE)
    rows, to_vertices = vertices_by_parameters(
        state, medium, freedom.basis, errors, first=layout.n_free + n_modes
    )
    return _Information(
        covariance[: layout.n_free, : layout.n_free],
        to_vertices @ covariance[np.ix_(rows, rows)] @ to_vertices.T,
        np.exp(local.log_photons) * pixels.near,
    )


def _bounds(
    state: PathState,
    known: _Information,
    freedom: Freedom,
    photons_per_pixel: float,
    *,
    camera: Camera,
    source: Source,
    medium: Medium,
) -> Bounds:
    """The record of a bound, from what is known of the path."""
    free, signal = known.covariance, known.signal
    n = 4 * len(state.vertices_mm)
    path = LightPath(
        state.vertices_mm,
        state.vertex_times_ps(medium),
        known.vertex_covariance[:n, :n],
        camera=camera,
        source=source,
        medium=medium,
        method="bound",
        goodness=Goodness(float("nan"), 0, len(signal), 0, float("nan"), 0.0, True),
        prior=prior_in_words(source),
        forks=state.forks,
        bends=state.bends,
        bend_covariance=known.vertex_covariance[:, n:],
    )
    branches = [(branch, branch.sample(1000)) for branch in path.branches]
    in_view = [(branch, sampled[sampled["in_view"]]) for branch, sampled in branches]
    seen = np.concatenate([sampled for _, sampled in in_view])
    position = sum(seen[name] ** 2 for name in ("x_std_mm", "y_std_mm", "z_std_mm"))
    std = np.sqrt(np.diag(free))
    own = free / np.maximum(std[:, np.newaxis] * std, 1e-300)
    return Bounds(
        path=path,
        position_rms_mm=float(np.sqrt(np.mean(position))),
        event_time_rms_ps=_event_time_rms(in_view, camera),
        angle_std_deg=np.array([leg.angle_std_deg for leg in path.legs]),
        photons=float(signal.sum()),
        photons_per_pixel=photons_per_pixel,
        n_pixels=int((signal.sum(axis=1) > 0.01).sum()),
        prior=prior_in_words(source),
        statements=statements_from_covariance(free, freedom.labels),
        condition=float(np.linalg.cond(own)) if len(own) else 1.0,
    )


def _event_time_rms(branches: list[tuple[LightPath, NDArray[np.void]]], camera: Camera) -> float:
    """Rms error of the event time on a pixel's ray: the point slides along the ray, not the leg."""
    variance = []
    for path, sampled in branches:
        # A hundred points are plenty for a mean.
        some = sampled[:: max(1, len(sampled) // 100)]
        variance += [_event_time_variance(path, row, camera) for row in some]
    return float(np.sqrt(np.mean(variance)))


def _event_time_variance(path: LightPath, row: np.void, camera: Camera) -> float:
    """Variance of the event time on the ray of one point of a chain's sample, ps^2."""
    leg = int(row["leg"])
    course = course_of_leg(path, leg)
    if course is not None:
        return _variance_on_ray(path, course, row, camera)
    t0, t1 = path.vertex_times_ps[leg : leg + 2]
    start, step = path.vertices_mm[leg], path.vertices_mm[leg + 1] - path.vertices_mm[leg]
    f = (row["event_time_ps"] - t0) / (t1 - t0)
    point = start + f * step
    ray = camera.sight_directions(point)
    across = step - (step @ ray) * ray
    slide = across / (across @ across)
    jacobian = np.zeros(8)
    jacobian[0:3] = -(1 - f) * slide * (t1 - t0)
    jacobian[4:7] = -f * slide * (t1 - t0)
    jacobian[3], jacobian[7] = 1 - f, f
    block = np.arange(4 * leg, 4 * leg + 8)
    return float(jacobian @ path.covariance[np.ix_(block, block)] @ jacobian)


def _variance_on_ray(path: LightPath, course: BentCourse, row: np.void, camera: Camera) -> float:
    """Variance of the event time at which a bent leg crosses a pixel's ray, ps^2."""
    t0, t1 = path.vertex_times_ps[course.leg : course.leg + 2]
    share = np.array([(row["event_time_ps"] - t0) / (t1 - t0)])
    length = float(course.ways_mm(np.ones(1))[0])
    fraction = course.fractions_at(share * length)
    tangent = course.tangents_mm(fraction)[0]
    along = tangent / np.linalg.norm(tangent)
    ray = camera.sight_directions(course.points_mm(fraction)[0])
    across = along - (along @ ray) * ray
    # What moves the curve in the picture slides the place that the ray sees along it.
    weights = np.append(-across / (across @ along) * (t1 - t0) / length, 1.0)
    return float(weights @ covariance_on_bent_leg(path, course, share)[0] @ weights)
