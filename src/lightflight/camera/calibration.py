"""A camera from points of known place and the pixels that saw them.

Takes world points (mm) with their pixels (row, col), or pictures of a chessboard; gives a
`Camera` with the covariance of its pose. One least-squares fit does both: pose and focal length
are free, the other lens terms carry the weak priors of `LENS_PRIORS`, so that they move exactly
as far as the data push them and what stays unknown about them widens the pose's error.

The fit starts from the linear poses of `pose`. Lens model: OpenCV.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.arguments import (
    finite_number,
    finite_numbers,
    pixels_of_shape,
    real_numbers,
    yes_or_no,
)
from lightflight.camera.fit import (
    MAX_STEPS,
    PARAMETER_NAMES,
    LensModel,
    View,
    degrees_of_freedom,
    pose_error_from_step,
    refined,
    system,
    system_residuals,
    view_residuals,
)
from lightflight.camera.model import Camera
from lightflight.camera.pose import is_planar, poses_from_plane, poses_from_space
from lightflight.display import Shown
from lightflight.errors import (
    GeometryError,
    NotConvergedError,
    SuspectDataWarning,
)

Floats = NDArray[np.float64]

LENS_PRIORS = {"k1": 0.3, "k2": 0.3, "p1": 0.005, "p2": 0.005, "k3": 0.1}
"""One-sigma width about zero of each distortion coefficient before any data."""

PRINCIPAL_POINT_PRIOR = 0.1
"""One-sigma offset of the principal point from the middle of the array, in array widths."""

FOCAL_LENGTH_PRIOR = (2.0, 3.0)
"""Focal length before any data, in array widths, and its one-sigma width as a logarithm: so
wide that it only keeps a fit bounded which is refused afterwards (see `fit_camera`)."""

_FREE_ASPECT_PRIOR = 0.5
# Rounding of float64 coordinates: no data are taken as better than this.
_PIXEL_STD_FLOOR = 1e-5
# A point said to lie in pixel k lies anywhere in it.
_WHOLE_PIXEL_STD = 1.0 / np.sqrt(12.0)
_LEAST_PX, _MOST_PX = 1e-6, 1e9
"""Pixels: no lens has a shorter or longer focal length, or is clicked on better or worse."""
_WEAKEST_FOCAL_STD = 0.3


@dataclass(frozen=True, eq=False, repr=False)
class CameraFit(Shown):
    """What a camera calibration found, and how well.

    Attributes
    ----------
    camera : Camera
        The camera, with pose covariance and the lens's share in it.
    lens : mapping of str to float
        Fitted value of each of `PARAMETER_NAMES`.
    lens_std : mapping of str to float
        One-sigma error of each, pose free; 0 where it was given. Near its prior: not fixed.
    residuals_px : array of float, shape (n, 2)
        px: measured minus fitted (row, col), in the order of the input, NaN where unused.
    pixel_std_px : float
        Error of one measured coordinate, px: as given, or from the residuals.
    dof : float
        Observed coordinates minus the number of parameters they determine.
    """

    camera: Camera

    lens: dict[str, float]

    lens_std: dict[str, float]

    residuals_px: Floats

    pixel_std_px: float

    dof: float


def calibrate_camera(
    points_mm: ArrayLike,
    pixels: ArrayLike,
    shape: tuple[int, int],
    *,
    focal_length_px: float | None = None,
    pixel_aspect: float | None = None,
    principal_point_px: tuple[float, float] | None = None,
    distortion: bool = True,
    pixel_std_px: float | None = None,
) -> Camera:
    """Camera from points of known place and the pixels that saw them.

    Parameters
    ----------
    points_mm : array of float, shape (n, 3)
        World, mm. At least 4 points in a plane or 6 in space, not on a line. A plane that faces the
        camera cannot tell focal length from distance: tilt it, add points off it, or give
        `focal_length_px`.
    pixels : array of float, shape (n, 2)
        (row, col) that saw each point, px, fractional allowed; rows with NaN are left out.
    shape : (int, int)
        (rows, cols) of the pixel array.
    focal_length_px : float, optional
        Column direction, px (focal length / pixel pitch); None: fitted.
    pixel_aspect : float, optional
        fy / fx; None: 1, and fitted where the points show that it is not.
    principal_point_px : (float, float), optional
        (row, col), px; None: fitted, near the middle of the array.
    distortion : bool
        False holds all distortion terms at zero.
    pixel_std_px : float, optional
        Error of one pixel coordinate, px; None: from the residuals.

    Returns
    -------
    Camera
        `pose_covariance` holds the error of the pose with all fitted lens terms unknown;
        `center_mm` is the entrance pupil. `fit_camera` gives residuals and lens errors too.

    Raises
    ------
    GeometryError
        For too few or degenerate points, or where these data do not fix the pose.
    NotConvergedError
        Where the fit does not settle.
    ValueError
        For arrays of another shape.
    """
    return fit_camera(
        points_mm,
        pixels,
        shape,
        focal_length_px=focal_length_px,
        pixel_aspect=pixel_aspect,
        principal_point_px=principal_point_px,
        distortion=distortion,
        pixel_std_px=pixel_std_px,
    ).camera


def fit_camera(
    points_mm: ArrayLike,
    pixels: ArrayLike,
    shape: tuple[int, int],
    *,
    focal_length_px: float | None = None,
    pixel_aspect: float | None = None,
    principal_point_px: tuple[float, float] | None = None,
    distortion: bool = True,
    pixel_std_px: float | None = None,
) -> CameraFit:
    """As `calibrate_camera`, with residuals, lens values and their errors.

    Parameters
    ----------
    points_mm, pixels, shape
        As of `calibrate_camera`, like all that follows.

    Returns
    -------
    CameraFit
        Residuals in the order of the input.
    """
    points, seen = _checked_correspondences(points_mm, pixels)
    if pixel_std_px is not None:
        must = f"be positive and finite, from {_LEAST_PX:g} to {_MOST_PX:g}"
        finite_number("pixel_std_px", pixel_std_px, must, low=_LEAST_PX, high=_MOST_PX)
    used = np.isfinite(points).all(axis=1) & np.isfinite(seen).all(axis=1)
    view = View(points[used], seen[used])
    _check_spread(view)
    model = starting_lens(
        shape, focal_length_px, pixel_aspect, principal_point_px, distortion=distortion
    )
    fit = fit_views([view], model, pixel_std_px, free_aspect=pixel_aspect is None)
    residuals = np.full(seen.shape, np.nan)
    residuals[used] = fit.residuals_px
    _warn_of_outliers(residuals, fit)
    return replace(fit, residuals_px=residuals)


# ---- checks ---------------------------------------------------------------------------------


def _checked_correspondences(points_mm: ArrayLike, pixels: ArrayLike) -> tuple[Floats, Floats]:
    """Points (n, 3) and pixels (n, 2) as floats; ValueError for other shapes."""
    points = real_numbers("points_mm", points_mm)
    seen = real_numbers("pixels", pixels)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points_mm must have shape (n, 3), got {points.shape}")
    if seen.shape != (points.shape[0], 2):
        raise ValueError(
            f"pixels must have shape ({points.shape[0]}, 2), one (row, col) per point, "
            f"got {seen.shape}"
        )
    return points, seen


def _check_spread(view: View) -> None:
    """Raise GeometryError for points that are too few, or lie on a line."""
    n = len(view.points)
    flat = is_planar(view.points)
    needed = 4 if flat else 6
    if n < needed:
        raise GeometryError(
            f"{n} usable points cannot fix a camera: give at least {needed} "
            f"{'in a plane' if flat else 'in space'}, spread over the picture"
        )
    for name, values in (("points_mm", view.points), ("pixels", view.pixels)):
        spread = np.linalg.svd(values - values.mean(axis=0), compute_uv=False)
        if not spread[1] > 1e-6 * spread[0]:
            raise GeometryError(
                f"{name} lie on a line or in one place: points must spread over two directions"
            )


def _warn_of_outliers(residuals: Floats, fit: CameraFit) -> None:
    # 6 standard errors: one false alarm in 2.5e8 points of honest noise.
    """Warn of points that no honest noise puts so far from the fitted camera."""
    far = np.flatnonzero((np.abs(residuals) > 6.0 * fit.pixel_std_px).any(axis=1))
    if far.size:
        worst = float(np.nanmax(np.abs(residuals)))
        warnings.warn(
            f"{far.size} points lie more than 6 standard errors ({fit.pixel_std_px:.2g} px each) "
            f"from the fitted camera, the worst by {worst:.2g} px, first at index {far[0]}: "
            "check them or leave them out",
            SuspectDataWarning,
            stacklevel=3,
        )


# ---- start ----------------------------------------------------------------------------------


def starting_lens(
    shape: tuple[int, int],
    focal_length_px: float | None,
    pixel_aspect: float | None,
    principal_point_px: tuple[float, float] | None,
    *,
    distortion: bool,
) -> LensModel:
    """Lens model at the middle of its priors, without poses; what was given has prior width 0."""
    rows, cols = pixels_of_shape(shape)
    try:
        for name, value in (("focal_length_px", focal_length_px), ("pixel_aspect", pixel_aspect)):
            if value is not None:
                must = f"be positive and finite, from {_LEAST_PX:g} to {_MOST_PX:g}"
                finite_number(name, value, must, low=_LEAST_PX, high=_MOST_PX)
    except ValueError as error:
        raise GeometryError(str(error)) from None
    mean, std = np.zeros(9), np.zeros(9)
    mean[0] = np.log(focal_length_px or FOCAL_LENGTH_PRIOR[0] * max(rows, cols))
    std[0] = 0.0 if focal_length_px is not None else FOCAL_LENGTH_PRIOR[1]
    mean[1] = 0.0 if pixel_aspect is None else np.log(pixel_aspect)
    if principal_point_px is None:
        mean[2:4] = (rows - 1) / 2.0, (cols - 1) / 2.0
        std[2:4] = PRINCIPAL_POINT_PRIOR * rows, PRINCIPAL_POINT_PRIOR * cols
    else:
        must = f"be (row, col), within {_MOST_PX:g} pixels"
        far = _MOST_PX
        mean[2:4] = finite_numbers(
            "principal_point_px", principal_point_px, must, shapes=[(2,)], low=-far, high=far
        )
    yes_or_no("distortion", distortion)
    if distortion:
        std[4:] = [LENS_PRIORS[name] for name in PARAMETER_NAMES[4:]]
    return LensModel((rows, cols), mean.copy(), (), mean, std)


def _start_poses(view: View, model: LensModel) -> list[Floats]:
    """Candidate poses of one view for the focal length in `model`, best first."""
    focal, aspect = np.exp(model.lens[0]), np.exp(model.lens[1])
    rays = (view.pixels - model.lens[2:4])[:, ::-1] / (focal, focal * aspect)
    poses = poses_from_plane(view.points, rays)
    if not is_planar(view.points):
        poses += poses_from_space(view.points, rays)
    poses = [p for p in poses if np.isfinite(p).all()]
    return sorted(poses, key=lambda pose: _start_error(view, model, pose))


def _start_error(view: View, model: LensModel, pose: Floats) -> float:
    """Sum of squared residuals of one view at a pose, px^2."""
    held = LensModel(model.shape, model.lens, (pose,), model.prior_mean, model.prior_std)
    return float(np.sum(view_residuals(held, 0, view) ** 2))


def fit_views(
    views: Sequence[View], model: LensModel, pixel_std_px: float | None, *, free_aspect: bool
) -> CameraFit:
    """Joint fit of all views; the first one's board or points define the world."""
    start = _best_start(views, model)
    for held in ((), (8,), (5, 8), (4, 5, 6, 7, 8)):
        # Terms that rest on their priors alone may fold the picture's corners: leave them out.
        prior_std = start.prior_std.copy()
        prior_std[list(held)] = 0.0
        free = LensModel(model.shape, start.lens, start.poses, start.prior_mean, prior_std)
        fitted, std = _with_noise(free, views, pixel_std_px)
        if free_aspect:
            fitted, std = _with_free_aspect(fitted, std, views, pixel_std_px)
        if _sees_its_corners(fitted):
            break
    _check_plausible(views, fitted)
    return _record(views, fitted, std)


def _sees_its_corners(model: LensModel) -> bool:
    """False where the distortion folds before it reaches a corner of the picture."""
    rows, cols = model.shape
    try:
        model.camera(0).rays_from_pixels([0, 0, rows - 1, rows - 1], [0, cols - 1, 0, cols - 1])
    except GeometryError:
        return False
    return True


def _with_free_aspect(
    fitted: LensModel, std: float, views: Sequence[View], pixel_std_px: float | None
) -> tuple[LensModel, float]:
    """Fit with oblong pixels, where the points show clearly that they are."""
    prior_std = fitted.prior_std.copy()
    prior_std[1] = _FREE_ASPECT_PRIOR
    wider = LensModel(fitted.shape, fitted.lens, fitted.poses, fitted.prior_mean, prior_std)
    try:
        oblong, oblong_std = _with_noise(wider, views, pixel_std_px, start_std=std)
    except NotConvergedError:
        return fitted, std
    gain = np.sum(system_residuals(fitted, views, oblong_std) ** 2) - np.sum(
        system_residuals(oblong, views, oblong_std) ** 2
    )
    # Chance alone gives one parameter a gain of 25 once in 1.7 million times.
    return (oblong, oblong_std) if gain > 25.0 else (fitted, std)


def _best_start(views: Sequence[View], model: LensModel) -> LensModel:
    """Poses and focal length from which the full fit starts."""
    if model.free[0]:
        # From wide angle to telephoto, in array widths; steps of half as much again.
        focals = np.geomspace(0.3, 100.0, 15) * max(model.shape)
    else:
        focals = np.exp(model.prior_mean[:1])
    trials: list[tuple[float, LensModel]] = []
    for focal in focals:
        lens = model.prior_mean.copy()
        lens[0] = np.log(focal)
        held = LensModel(model.shape, lens, (), model.prior_mean, model.prior_std)
        ranked = [_start_poses(view, held) for view in views]
        if not all(ranked):
            continue
        for choice in range(max(len(poses) for poses in ranked)):
            poses = tuple(p[min(choice, len(p) - 1)] for p in ranked)
            trial = LensModel(model.shape, lens, poses, model.prior_mean, model.prior_std)
            error = sum(
                float(np.sum(view_residuals(trial, i, v) ** 2)) for i, v in enumerate(views)
            )
            trials.append((error, trial))
    if not trials:
        raise GeometryError(
            "no camera pose explains these points: check that points and pixels are in one order"
        )
    trials.sort(key=lambda item: item[0])
    # Pose and focal length first: distortion must not stand in for a wrong pose.
    only_focal = np.where(np.arange(9) == 0, model.prior_std, 0.0)
    candidates = []
    for _, trial in trials[:4]:
        plain = LensModel(model.shape, trial.lens, trial.poses, model.prior_mean, only_focal)
        candidates.append(refined(plain, views, 1.0))
    best = min(candidates, key=lambda item: item[1])[0]
    return LensModel(model.shape, best.lens, best.poses, model.prior_mean, model.prior_std)


def _with_noise(
    model: LensModel,
    views: Sequence[View],
    pixel_std_px: float | None,
    *,
    start_std: float = _WHOLE_PIXEL_STD,
) -> tuple[LensModel, float]:
    """Fit with the pixel error given or, in a few rounds, taken from the residuals."""
    if pixel_std_px is not None:
        return _settled(*refined(model, views, pixel_std_px)), pixel_std_px
    std = start_std
    for _ in range(12):
        model = _settled(*refined(model, views, std))
        dof = degrees_of_freedom(model, views, std)
        if dof < 3.0:
            warnings.warn(
                "too few points to read the pixel error off the residuals: "
                f"{_WHOLE_PIXEL_STD:.2f} px assumed (a whole pixel); give pixel_std_px",
                SuspectDataWarning,
                stacklevel=5,
            )
            return _settled(*refined(model, views, _WHOLE_PIXEL_STD)), _WHOLE_PIXEL_STD
        squares = sum(float(np.sum(view_residuals(model, i, v) ** 2)) for i, v in enumerate(views))
        before, std = std, max(float(np.sqrt(squares / dof)), _PIXEL_STD_FLOOR)
        if abs(std - before) < 1e-3 * before:
            break
    return model, std


def _settled(model: LensModel, chi2: float, settled: bool) -> LensModel:
    """The model, if the fit of it settled; else NotConvergedError."""
    if settled:
        return model
    raise NotConvergedError(
        f"the camera fit did not settle in {MAX_STEPS} steps (chi-square {chi2:.3g}): the points "
        "hardly fix the camera; add points, or give focal_length_px"
    )


def _check_plausible(views: Sequence[View], model: LensModel) -> None:
    """Refuse a fit that misses the points by so much that the input must be wrong."""
    view = views[0]
    rms = float(np.sqrt(np.mean(view_residuals(model, 0, view) ** 2)))
    if rms <= max(1.0, 0.02 * max(model.shape)):
        return
    advice = "check that points and pixels are in one order and in mm and (row, col)"
    mirrored = View(view.points, view.pixels[:, ::-1])
    plain = LensModel(model.shape, model.prior_mean, (), model.prior_mean, model.prior_std)
    try:
        swapped = _best_start([mirrored], plain)
        better = float(np.sqrt(np.mean(view_residuals(swapped, 0, mirrored) ** 2)))
    except GeometryError:
        better = np.inf
    if better < 0.3 * rms:
        advice = (
            f"with row and col exchanged they fit to {better:.2g} px: give (row, col), "
            "row 0 at the top, and a right-handed world"
        )
    raise GeometryError(f"no camera explains these points: they miss by {rms:.2g} px rms; {advice}")


def _record(views: Sequence[View], model: LensModel, pixel_std: float) -> CameraFit:
    """Covariance at the minimum, in the pose convention of `Camera.perturbed`."""
    jacobian = system(model, views, pixel_std)[1]
    n_pose, free = 6 * len(views), model.free
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    # Columns of one size: rad, mm and logarithms differ by decades.
    _, values, right = np.linalg.svd(jacobian / size, full_matrices=False)
    with np.errstate(divide="ignore"):
        # What no data fix becomes infinite, and is refused below.
        root = (right / np.where(values > 1e-13 * values[0], values, 0.0)[:, None]) / size
    for index, view in enumerate(views):
        block = slice(6 * index, 6 * index + 6)
        root[:, block] = root[:, block] @ pose_error_from_step(model.poses[index], view).T
    covariance = root.T @ root
    std = np.sqrt(np.diag(covariance))
    focal_std = std[n_pose] if free[0] else 0.0
    far = np.linalg.norm(views[0].points.mean(axis=0) - model.poses[0][:3, 3])
    if not (np.isfinite(covariance).all() and focal_std < _WEAKEST_FOCAL_STD):
        raise GeometryError(
            "these points do not fix the camera: focal length and distance trade against each "
            "other (a plane that faces the camera); tilt the plane, add points off it, or give "
            "focal_length_px"
        )
    if np.sqrt(np.trace(covariance[3:6, 3:6])) > far:
        raise GeometryError(
            "these points do not fix where the camera stands: spread them over the picture, "
            "add points, or give what is known of the lens"
        )
    lens_std = np.zeros(9)
    lens_std[free] = std[n_pose:]
    camera = _camera_with_errors(model, covariance, n_pose)
    names = PARAMETER_NAMES
    return CameraFit(
        camera=camera,
        lens=dict(zip(names, model.lens.tolist(), strict=True)),
        lens_std=dict(zip(names, lens_std.tolist(), strict=True)),
        residuals_px=np.concatenate([view_residuals(model, i, v) for i, v in enumerate(views)]),
        pixel_std_px=pixel_std,
        dof=degrees_of_freedom(model, views, pixel_std),
    )


def _camera_with_errors(model: LensModel, covariance: Floats, n_pose: int) -> Camera:
    """First view's camera, its pose covariance (6, 6) and how the lens goes along with the pose."""
    camera = model.camera(0)
    pose_covariance = (covariance[:6, :6] + covariance[:6, :6].T) / 2.0
    # Regression of the lens on the pose; radians and mm differ by decades, so scaled.
    std = np.sqrt(np.diag(pose_covariance))
    correlation = pose_covariance / np.outer(std, std)
    lens_slopes = np.zeros((9, 6))
    lens_slopes[model.free] = (
        np.linalg.lstsq(correlation, covariance[:6, n_pose:] / std[:, None], rcond=1e-12)[0].T / std
    )
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    slopes = np.zeros((9, 6))
    slopes[0] = fx * lens_slopes[0]
    slopes[1] = fy * (lens_slopes[0] + lens_slopes[1])
    slopes[2], slopes[3] = lens_slopes[3], lens_slopes[2]
    slopes[4:] = lens_slopes[4:]
    return Camera(
        camera.matrix,
        camera.distortion,
        camera.world_from_camera,
        model.shape,
        pose_covariance,
        slopes,
    )
