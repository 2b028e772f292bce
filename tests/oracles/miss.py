"""By how much a path misses the truth, where both say the same thing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath


def across(vertices: np.ndarray) -> np.ndarray:
    """(k, 2 or 3 n): what is compared, as rows over x, y, z of the vertices in question.

    Of several legs the corners between them, of one its direction.
    """
    if len(vertices) > 2:
        return np.eye(3 * (len(vertices) - 2))
    return np.asarray(np.linalg.svd(np.diff(vertices, axis=0))[2][1:])


def error_and_covariance(path: LightPath, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Error (k,) in mm of what is compared, and its stated covariance (k, k)."""
    frame = across(vertices)
    if len(vertices) > 2:
        inner = np.arange(4 * len(path.vertices_mm)).reshape(-1, 4)[1:-1, :3].ravel()
        off = (path.vertices_mm - vertices)[1:-1].ravel()
        return frame @ off, path.covariance[np.ix_(inner, inner)]
    # The path ends where the view does: its direction is carried on to the world's vertex.
    step, truth = np.diff(path.vertices_mm, axis=0)[0], np.diff(vertices, axis=0)[0]
    longer = float(truth @ truth / (step @ truth))
    last = frame @ path.covariance[4:7, 4:7] @ frame.T
    return frame @ (longer * step - truth), longer**2 * last


def pulls(path: LightPath, vertices: np.ndarray) -> np.ndarray:
    """(k,), the error whitened by the stated covariance."""
    error, stated = error_and_covariance(path, vertices)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(stated), error))
