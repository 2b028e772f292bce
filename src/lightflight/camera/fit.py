"""The least-squares problem behind a camera calibration, and its solver.

Takes views (points and the pixels that saw them) and a lens model with priors; gives whitened
residuals, their analytic Jacobian and the model at the minimum. What is free, how well pixels
are known and what the answer is worth is decided in `calibration`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.model import Camera
from lightflight.camera.rigid import rotation_from_vector

Floats = NDArray[np.float64]

PARAMETER_NAMES = (
    "log_focal_length",
    "log_pixel_aspect",
    "principal_row",
    "principal_col",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
)
"""Lens parameters of the fit: f = fx in px, aspect = fy / fx, then OpenCV's distortion."""

MAX_STEPS = 200
"""Steps after which a fit is given up."""


@dataclass(frozen=True)
class View:
    """One pose of the camera: points and where it saw them.

    Attributes
    ----------
    points : array of float, shape (n, 3)
        World, mm.
    pixels : array of float, shape (n, 2)
        Row and col, px.
    """

    points: Floats

    pixels: Floats


@dataclass(frozen=True)
class LensModel:
    """Lens values, poses and the prior of each lens term.

    Attributes
    ----------
    shape : (int, int)
        (rows, cols) of the pixel array.
    lens : array of float, shape (9,)
        In the order of `PARAMETER_NAMES`.
    poses : tuple of arrays
        (4, 4) each, mm: world_from_camera of every view.
    prior_mean : array of float, shape (9,)
        What is believed of the lens before any data.
    prior_std : array of float, shape (9,)
        How firmly; 0 holds a term at its value.
    """

    shape: tuple[int, int]

    lens: Floats

    poses: tuple[Floats, ...]

    prior_mean: Floats

    prior_std: Floats

    def camera(self, view: int) -> Camera:
        """The camera at the pose of one view, without errors.

        Parameters
        ----------
        view : int
            Index in `poses`.
        """
        focal, aspect = np.exp(self.lens[0]), np.exp(self.lens[1])
        matrix = np.array(
            [[focal, 0.0, self.lens[3]], [0.0, focal * aspect, self.lens[2]], [0.0, 0.0, 1.0]]
        )
        return Camera(matrix, self.lens[4:], self.poses[view], self.shape)

    @property
    def free(self) -> NDArray[np.bool_]:
        """(9,), True for the lens terms that are fitted."""
        return np.asarray(self.prior_std > 0.0)

    def moved(self, step: Floats, views: Sequence[View]) -> LensModel:
        """Model after a step.

        A step is six numbers of each view, then the free lens terms. The six: a turn about the
        middle of the points (world axes, rad), the middle's shift across the line of sight in
        units of its depth (camera axes), and the logarithm of that depth. Near a minimum the
        picture is close to linear in these, which it is not in the camera's own place when focal
        length and distance trade against each other.

        Parameters
        ----------
        step : array of float, shape (6 n_views + n_free,)
            From here.
        views : sequence of View
            Those of `poses`, for the middle of their points.
        """
        n_pose = 6 * len(self.poses)
        poses = []
        for pose, delta, view in zip(self.poses, step[:n_pose].reshape(-1, 6), views, strict=True):
            middle = view.points.mean(axis=0)
            seen = pose[:3, :3].T @ (middle - pose[:3, 3])
            seen = np.exp(delta[5]) * (seen + seen[2] * np.array([delta[3], delta[4], 0.0]))
            moved = np.eye(4)
            moved[:3, :3] = rotation_from_vector(delta[:3]) @ pose[:3, :3]
            moved[:3, 3] = middle - moved[:3, :3] @ seen
            poses.append(moved)
        lens = self.lens.copy()
        lens[self.free] += step[n_pose:]
        return LensModel(self.shape, lens, tuple(poses), self.prior_mean, self.prior_std)


def _shifts_by_step(pose: Floats, view: View) -> Floats:
    """(3, 3), mm: apparent world shift of the points' middle by the last three of a step."""
    seen = pose[:3, :3].T @ (view.points.mean(axis=0) - pose[:3, 3])
    across = np.array([[seen[2], 0.0, seen[0]], [0.0, seen[2], seen[1]], [0.0, 0.0, seen[2]]])
    return np.asarray(pose[:3, :3] @ across)


def pose_error_from_step(pose: Floats, view: View) -> Floats:
    """(6, 6): pose error as `Camera.perturbed` takes it, by a small step of `LensModel.moved`."""
    arm = pose[:3, 3] - view.points.mean(axis=0)
    out = np.zeros((6, 6))
    out[:3, :3] = np.eye(3)
    out[3:, :3] = -np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    out[3:, 3:] = -_shifts_by_step(pose, view)
    return out


def view_residuals(model: LensModel, index: int, view: View) -> Floats:
    """(n, 2), px: measured minus modelled; a point that leaves the front is very wrong."""
    row, col = model.camera(index).pixels_from_points(view.points)
    residual = view.pixels - np.column_stack([row, col])
    return np.nan_to_num(residual, nan=1e4 * max(model.shape))


def _view_jacobian(model: LensModel, index: int, view: View) -> Floats:
    """(n, 2, 6 + 9): derivative of the modelled (row, col) by pose step and lens terms."""
    camera = model.camera(index)
    by_point = camera.pixel_jacobian(view.points)
    arm = view.points - view.points.mean(axis=0)
    out = np.zeros((len(view.points), 2, 15))
    # Turning the camera by w about the middle moves the scene, as it sees it, by arm x w.
    out[..., :3] = np.cross(by_point, arm[:, None, :], axis=-1)
    out[..., 3:6] = by_point @ _shifts_by_step(model.poses[index], view)
    row, col = camera.pixels_from_points(view.points)
    x, y = camera.normalized_from_points(view.points)
    q = x * x + y * y
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    out[:, 0, 6], out[:, 1, 6] = row - model.lens[2], col - model.lens[3]
    out[:, 0, 7] = row - model.lens[2]
    out[:, 0, 8] = out[:, 1, 9] = 1.0
    for slot, power in ((10, q), (11, q**2), (14, q**3)):
        out[:, 0, slot], out[:, 1, slot] = fy * y * power, fx * x * power
    out[:, 0, 12], out[:, 1, 12] = fy * (q + 2 * y * y), fx * 2 * x * y
    out[:, 0, 13], out[:, 1, 13] = fy * 2 * x * y, fx * (q + 2 * x * x)
    # Points behind the camera have no slope; their residual alone turns the fit away.
    return np.nan_to_num(out)


def system_residuals(model: LensModel, views: Sequence[View], pixel_std: float) -> Floats:
    """Whitened residuals: coordinates of all views, then lens terms against their priors.

    Parameters
    ----------
    model : LensModel
        Where they are taken.
    views : sequence of View
        What was measured.
    pixel_std : float
        Error of one coordinate, px.

    Returns
    -------
    array of float, shape (2 n_points + n_free,)
        In standard errors.
    """
    data = [view_residuals(model, i, view).ravel() / pixel_std for i, view in enumerate(views)]
    free = model.free
    lens = (model.lens - model.prior_mean)[free] / model.prior_std[free]
    return np.concatenate([*data, lens])


def system(model: LensModel, views: Sequence[View], pixel_std: float) -> tuple[Floats, Floats]:
    """Whitened residuals and their Jacobian by (poses, free lens terms).

    Parameters
    ----------
    model : LensModel
        Where they are taken.
    views : sequence of View
        What was measured.
    pixel_std : float
        Error of one coordinate, px.

    Returns
    -------
    residuals : array of float, shape (m,)
        As `system_residuals`.
    jacobian : array of float, shape (m, 6 n_views + n_free)
        By a step of `LensModel.moved`.
    """
    free, n_pose = model.free, 6 * len(views)
    jacobians = []
    for index, view in enumerate(views):
        derivative = _view_jacobian(model, index, view)
        block = np.zeros((2 * len(view.points), n_pose + int(free.sum())))
        block[:, 6 * index : 6 * index + 6] = derivative[..., :6].reshape(-1, 6)
        block[:, n_pose:] = derivative[..., 6:].reshape(-1, 9)[:, free]
        jacobians.append(-block / pixel_std)
    block = np.zeros((int(free.sum()), n_pose + int(free.sum())))
    # A prior is one more measurement of each free lens term.
    block[:, n_pose:] = np.diag(1.0 / model.prior_std[free])
    return system_residuals(model, views, pixel_std), np.concatenate([*jacobians, block])


def refined(
    model: LensModel, views: Sequence[View], pixel_std: float
) -> tuple[LensModel, float, bool]:
    """Model at the nearest minimum, by Levenberg-Marquardt steps.

    Each step is taken about the model of the step before, so that turns stay small and the
    Jacobian at zero step is always the right one. It ends when a step promises to lower
    chi-square by less than 1e-9: a thirty-thousandth of a standard error.

    Parameters
    ----------
    model : LensModel
        The start.
    views : sequence of View
        What was measured.
    pixel_std : float
        Error of one coordinate, px.

    Returns
    -------
    model : LensModel
        The minimum, or where `MAX_STEPS` ended.
    chi2 : float
        Its sum of squared residuals.
    settled : bool
        False: given up.
    """
    residual, jacobian = system(model, views, pixel_std)
    chi2, damping, harder = float(residual @ residual), 1e-3, 2.0
    for _ in range(MAX_STEPS):
        size = np.linalg.norm(jacobian, axis=0)
        size[size == 0.0] = 1.0
        # All a damped step needs of the long Jacobian is its triangle and the projected residual.
        basis, triangle = np.linalg.qr(jacobian / size)
        target = -basis.T @ residual
        bound = np.vstack([triangle, np.sqrt(damping) * np.eye(len(size))])
        move = np.linalg.lstsq(bound, np.append(target, np.zeros(len(size))), rcond=None)[0]
        promised = float(target @ target - np.sum((target - triangle @ move) ** 2))
        trial = model.moved(move / size, views)
        # A focal length that changes threefold at once has left the linear model's reach.
        if abs(trial.lens[0] - model.lens[0]) < 1.0:
            trial_residual = system_residuals(trial, views, pixel_std)
            trial_chi2 = float(trial_residual @ trial_residual)
        else:
            trial_chi2 = np.inf
        if trial_chi2 <= chi2:
            # Nielsen's rule: damping follows how well the linear model foretold the gain.
            gain = (chi2 - trial_chi2) / max(promised, 1e-300)
            damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3), 1e-14)
            model, chi2, harder = trial, trial_chi2, 2.0
            residual, jacobian = system(model, views, pixel_std)
        else:
            damping, harder = damping * harder, 2.0 * harder
        if promised < 1e-9 + 1e-14 * chi2 or damping > 1e12:
            return model, chi2, True
    return model, chi2, False


def degrees_of_freedom(model: LensModel, views: Sequence[View], pixel_std: float) -> float:
    """Coordinates minus the parameters that they, and not the priors, determine.

    Parameters
    ----------
    model : LensModel
        A minimum.
    views : sequence of View
        What was measured.
    pixel_std : float
        Error of one coordinate, px.

    Returns
    -------
    float
        Not whole: a parameter may rest on data and prior in part.
    """
    jacobian = system(model, views, pixel_std)[1]
    n_data = 2 * sum(len(view.points) for view in views)
    basis = np.linalg.svd(jacobian, full_matrices=False)[0]
    return n_data - float(np.sum(basis[:n_data] ** 2))
