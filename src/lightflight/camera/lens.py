"""The lens: OpenCV's distortion of the image plane, its derivative and its inverse.

Takes and gives places in the image plane at unit depth (x right, y down); `camera.model` turns them
into pixels. `Lens` is the one place that knows the distortion terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.camera.rigid import read_only
from lightflight.errors import GeometryError

Floats = NDArray[np.float64]

_DISTORTION_SIZES = (0, 4, 5, 8, 12, 14)
_NEWTON_STEPS = 60
_NEWTON_TOLERANCE = 2e-15
"""Of the place: what is nearer is rounding (8 units in the last place), which no step betters."""


def checked_distortion(distortion: ArrayLike) -> Floats:
    """Distortion terms as a read-only array.

    Parameters
    ----------
    distortion : array of float, shape (0 | 4 | 5 | 8 | 12 | 14,)
        In OpenCV's order.

    Raises
    ------
    ValueError
        For another number of terms.
    GeometryError
        For NaN or inf.
    """
    k = read_only(distortion).flatten()
    k.setflags(write=False)
    if k.size not in _DISTORTION_SIZES:
        raise ValueError(
            f"distortion must have 0, 4, 5, 8, 12 or 14 numbers in OpenCV's order, got {k.size}"
        )
    if not np.isfinite(k).all():
        raise GeometryError("distortion holds NaN or inf: pass () for a lens without distortion")
    return k


def _tilt_matrix(tilt_x: float, tilt_y: float) -> Floats:
    """Homography (3, 3) of a tilted sensor, OpenCV's tau_x, tau_y in rad."""
    cx, sx, cy, sy = np.cos(tilt_x), np.sin(tilt_x), np.cos(tilt_y), np.sin(tilt_y)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
    about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    r = about_y @ about_x
    onto_sensor = np.array([[r[2, 2], 0.0, -r[0, 2]], [0.0, r[2, 2], -r[1, 2]], [0.0, 0.0, 1.0]])
    return np.asarray(onto_sensor @ r)


@dataclass(frozen=True, eq=False)
class Lens:
    """Distortion of a lens, in OpenCV's terms.

    With q = x^2 + y^2 a place (x, y) goes to

        x_d = g x + 2 p1 x y + p2 (q + 2 x^2) + s1 q + s2 q^2
        y_d = g y + p1 (q + 2 y^2) + 2 p2 x y + s3 q + s4 q^2
        g = (1 + k1 q + k2 q^2 + k3 q^3) / (1 + k4 q + k5 q^2 + k6 q^3)

    and from there, where tau is not zero, onto the tilted sensor.

    Attributes
    ----------
    distortion : array of float, shape (0 | 4 | 5 | 8 | 12 | 14,)
        k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y, as many as there are.

    References
    ----------
    OpenCV, *Camera Calibration and 3D Reconstruction*, "Detailed description".
    """

    distortion: Floats

    def distorted(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Distorted places from undistorted ones.

        Parameters
        ----------
        x, y : array of float, shape (...)
            Right and down, at unit depth.

        Returns
        -------
        xd, yd : array of float, shape (...)
            NaN beyond the radius where the radial polynomial folds back on itself: a real lens does
            not send light from there into the picture.
        """
        if self.is_ideal:
            return x, y
        inside = x * x + y * y < self._fold_radius2
        xd, yd = self._terms(np.where(inside, x, np.nan), np.where(inside, y, np.nan))
        return (xd, yd) if self._tilt is None else _mapped(self._tilt, xd, yd)

    def jacobian(self, x: Floats, y: Floats) -> Floats:
        """(..., 2, 2): derivative of the distorted (x, y) by the undistorted one."""
        if self.is_ideal:
            return np.broadcast_to(np.eye(2), (*np.shape(x), 2, 2))
        inside = x * x + y * y < self._fold_radius2
        x, y = np.where(inside, x, np.nan), np.where(inside, y, np.nan)
        lens = np.stack(self._terms_jacobian(x, y), axis=-1).reshape(*np.shape(x), 2, 2)
        if self._tilt is None:
            return lens
        t = self._tilt
        lensed = np.stack([*self._terms(x, y), np.ones_like(x)], axis=-1) @ t.T
        w = lensed[..., 2, None, None]
        tilt = (t[:2, :2] - lensed[..., :2, None] * (t[2, :2] / w)) / w
        return np.asarray(tilt @ lens)

    def undistorted(self, xd: Floats, yd: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Undistorted places from distorted ones, by Newton steps to machine precision.

        From the distorted point Newton is monotone for a radial polynomial of one curvature; the
        step is halved where the residual does not shrink, for the others.

        Parameters
        ----------
        xd, yd : array of float, shape (...)
            Right and down, at unit depth.

        Returns
        -------
        x, y : array of float, shape (...)
            NaN where the input is.
        lost : array of bool, shape (...)
            True where no undistorted place exists.
        """
        if self.is_ideal:
            return xd, yd, np.zeros(np.shape(xd), dtype=bool)
        if self._tilt is not None:
            xd, yd = _mapped(np.asarray(np.linalg.inv(self._tilt), float), xd, yd)
        x, y = np.array(xd), np.array(yd)
        ex, ey = self._residual(x, y, xd, yd)
        scale = 1.0 + np.hypot(xd, yd)
        for _ in range(_NEWTON_STEPS):
            error = np.hypot(ex, ey)
            # Who has arrived, or is NaN, must not keep the others halving.
            away = error > _NEWTON_TOLERANCE * scale
            if not away.any():
                break
            xx, xy, yx, yy = self._terms_jacobian(x, y)
            with np.errstate(divide="ignore", invalid="ignore"):
                determinant = xx * yy - xy * yx
                step_x = (yy * ex - xy * ey) / determinant
                step_y = (xx * ey - yx * ex) / determinant
            share = np.ones_like(x)
            for _ in range(30):
                fx, fy = self._residual(x - share * step_x, y - share * step_y, xd, yd)
                worse = away & ~(np.hypot(fx, fy) < error)
                if not worse.any():
                    break
                share = np.where(worse, 0.5 * share, share)
            nearer = away & ~worse
            if not nearer.any():
                break
            x, y = np.where(nearer, x - share * step_x, x), np.where(nearer, y - share * step_y, y)
            ex, ey = np.where(nearer, fx, ex), np.where(nearer, fy, ey)
        # 1e-13 and not the tolerance: the last bits of the residual are rounding.
        lost = ~(np.hypot(ex, ey) <= 1e-13 * scale) | ~(x * x + y * y < self._fold_radius2)
        return x, y, np.asarray(lost & ~np.isnan(xd) & ~np.isnan(yd))

    def _residual(self, x: Floats, y: Floats, xd: Floats, yd: Floats) -> tuple[Floats, Floats]:
        """Distorted (x, y) without tilt minus the wanted (xd, yd)."""
        fx, fy = self._terms(x, y)
        return fx - xd, fy - yd

    def _terms(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Radial, tangential and thin-prism terms, without the sensor tilt."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._coefficients
        q = x * x + y * y
        above = 1.0 + q * (k1 + q * (k2 + q * k3))
        if self._is_radial:
            return x * above, y * above
        gain = above / (1.0 + q * (k4 + q * (k5 + q * k6)))
        xd = x * gain + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x) + q * (s1 + q * s2)
        yd = y * gain + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y + q * (s3 + q * s4)
        return xd, yd

    def _terms_jacobian(self, x: Floats, y: Floats) -> tuple[Floats, ...]:
        """Derivatives (xd by x, xd by y, yd by x, yd by y) of `_terms`."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._coefficients
        q = x * x + y * y
        above = 1.0 + q * (k1 + q * (k2 + q * k3))
        if self._is_radial:
            twice = 2.0 * (k1 + q * (2.0 * k2 + q * 3.0 * k3))
            across = twice * x * y
            return above + twice * x * x, across, across, above + twice * y * y
        below = 1.0 + q * (k4 + q * (k5 + q * k6))
        gain = above / below
        slope = (
            k1 + q * (2.0 * k2 + q * 3.0 * k3) - gain * (k4 + q * (2.0 * k5 + q * 3.0 * k6))
        ) / below
        prism_x, prism_y = 2.0 * (s1 + 2.0 * q * s2), 2.0 * (s3 + 2.0 * q * s4)
        cross = 2.0 * slope * x * y
        xx = gain + 2.0 * slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x
        xy = cross + 2.0 * p1 * x + 2.0 * p2 * y + prism_x * y
        yx = cross + 2.0 * p1 * x + 2.0 * p2 * y + prism_y * x
        yy = gain + 2.0 * slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y
        return xx, xy, yx, yy

    @cached_property
    def is_ideal(self) -> bool:
        """True where it distorts nothing."""
        return not np.any(self.distortion)

    @cached_property
    def _is_radial(self) -> bool:
        """True where k1, k2 and k3 are all there is, as of most lenses: a fit asks them often."""
        return not np.any(self.distortion[2:4]) and not np.any(self.distortion[5:])

    @cached_property
    def _coefficients(self) -> tuple[float, ...]:
        """k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, zeros where the lens has fewer."""
        padded = np.zeros(14)
        padded[: self.distortion.size] = self.distortion
        return tuple(float(v) for v in padded[:12])

    @cached_property
    def _tilt(self) -> Floats | None:
        """(3, 3), homography onto the tilted sensor; None where it is not tilted."""
        if self.distortion.size < 14 or not np.any(self.distortion[12:]):
            return None
        return _tilt_matrix(float(self.distortion[12]), float(self.distortion[13]))

    @cached_property
    def _fold_radius2(self) -> float:
        """Square of the undistorted radius where the radial polynomial stops growing."""
        k1, k2, _, _, k3, k4, k5, k6, *_ = self._coefficients
        above, below = np.array([k3, k2, k1, 1.0]), np.array([k6, k5, k4, 1.0])
        # With q = r^2 the radius is r N/D and its derivative (N D + 2 q (N' D - N D')) / D^2.
        slope = np.convolve(np.polyder(above), below) - np.convolve(above, np.polyder(below))
        turn = np.convolve(above, below) + np.append(2.0 * slope, 0.0)
        roots = [complex(root) for root in (*np.roots(turn), *np.roots(below))]
        real = [z.real for z in roots if abs(z.imag) < 1e-9 * (1.0 + abs(z)) and z.real > 0.0]
        return min(real, default=np.inf)


def _mapped(homography: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Places (x, y) through a homography (3, 3)."""
    h = homography
    w = h[2, 0] * x + h[2, 1] * y + h[2, 2]
    return (h[0, 0] * x + h[0, 1] * y + h[0, 2]) / w, (h[1, 0] * x + h[1, 1] * y + h[1, 2]) / w
