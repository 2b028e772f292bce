"""A camera from pictures of a chessboard: where its corners are, then the fit of `calibration`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightflight.camera.calibration import CameraFit, fit_views, starting_lens
from lightflight.camera.fit import (
    View,
)
from lightflight.errors import (
    GeometryError,
    optional_package,
)

Floats = NDArray[np.float64]


def calibrate_camera_from_boards(
    images: Sequence[ArrayLike],
    *,
    corners: tuple[int, int],
    square_mm: float,
    pixel_std_px: float | None = None,
) -> CameraFit:
    """Camera from pictures of a chessboard through the same lens (needs OpenCV).

    The first picture's board is the world: its plane is z = 0, the origin the inner corner
    nearest the top left of that picture, x along its first count of corners, z towards the
    camera.

    Parameters
    ----------
    images : sequence of array, shape (rows, cols)
        Counts or intensities, one board position each, all of one shape; at least one clearly
        tilted.
    corners : (int, int)
        (corners per row, corners per column) of the board's inner corners.
    square_mm : float
        Side of one square, mm.
    pixel_std_px : float, optional
        Error of one corner coordinate, px; None: from the residuals.

    Returns
    -------
    CameraFit
        Its camera is that of the first picture.

    Raises
    ------
    MissingExtraError
        Without the `camera` extra.
    GeometryError
        Where a board is not found in a picture, or the boards do not fix the camera.
    ValueError
        For pictures of different shapes, or none.
    """
    pictures = [np.asarray(image, dtype=np.float64) for image in images]
    if not pictures or any(p.ndim != 2 or p.shape != pictures[0].shape for p in pictures):
        raise ValueError(
            f"images must be pictures (rows, cols) of one shape, got {[p.shape for p in pictures]}"
        )
    across, down = corners
    # y falls from row to row of corners, so that z of a right-handed world faces the camera.
    grid = np.stack(
        [
            np.tile(np.arange(across), down),
            -np.repeat(np.arange(down), across),
            np.zeros(across * down),
        ],
        axis=1,
    )
    board = float(square_mm) * grid
    views = [
        View(board, _board_corners(picture, corners, index))
        for index, picture in enumerate(pictures)
    ]
    rows, cols = pictures[0].shape
    model = starting_lens((rows, cols), None, None, None, distortion=True)
    return fit_views(views, model, pixel_std_px, free_aspect=True)


def _board_corners(picture: Floats, corners: tuple[int, int], index: int) -> Floats:
    """(n, 2) sub-pixel (row, col) of a board's inner corners, by OpenCV."""
    cv2 = optional_package(
        "cv2", otherwise="finding chessboards needs OpenCV: pip install 'lightflight[camera]'"
    )
    # OpenCV finds corners in 8-bit grey only.
    low, high = np.nanmin(picture), np.nanmax(picture)
    span = (high - low) or 1.0
    grey = np.clip(255.0 * (np.nan_to_num(picture, nan=low) - low) / span, 0, 255)
    image = grey.astype(np.uint8)
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY
    found, places = cv2.findChessboardCornersSB(image, corners, flags=flags)
    if not found:
        raise GeometryError(
            f"no chessboard with {corners[0]} x {corners[1]} inner corners in image {index}: "
            "leave the picture out, or check corners=",
            offenders=index,
        )
    # Half the spacing of the corners, so that the window never reaches the next one.
    spacing = np.linalg.norm(np.diff(places.reshape(-1, 2)[: corners[0]], axis=0), axis=1).min()
    window = max(2, int(0.4 * spacing))
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    places = cv2.cornerSubPix(image, places, (window, window), (-1, -1), stop)
    found_at = np.asarray(places, dtype=np.float64).reshape(-1, 2)[:, ::-1]
    # A board looks the same after half a turn: the end nearer to the top left is the first.
    return found_at if found_at[0].sum() <= found_at[-1].sum() else found_at[::-1].copy()
