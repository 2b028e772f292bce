"""Corners whose own light is none of the legs': what a mirror scatters, what its mount hides.

A beam that meets a mirror in view lights it, often brighter than all of the leg, and mounts and
edges hide light there. What pixels about such a corner count is no cut leg, and says nothing of
the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.thick_beam import BEAM_SHARE_STD, clear_of_corners_px
from lightflight.reconstruct.model.unknowns import Layout, Light

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.reconstruct.all_counts.climb import Climb
    from lightflight.reconstruct.all_counts.counts import Counts

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_AROUND_PX = 1.5
"""Uneven pixels this far beyond the reach of a corner belong to it, px: wings of a bright one, and
where the brightness of the leg went astray beside it."""
_SEEN_STDS = 3.0
"""A beam's share of the spot is told where it is so many of its standard deviations."""
_KEPT = 0.5
"""Share of the pixels of each of its legs that a corner leaves, or it stays."""


def pixels_of_uneven_corners(
    uneven: Bools, near: Bools, state: PathState, camera: Camera, spot_px: float
) -> tuple[Bools, tuple[int, ...]]:
    """Pixels about corners of which one counts other than its legs' light, and these corners.

    Parameters
    ----------
    uneven : array of bool, shape (rows, cols, L)
        True where a pixel's light departs from its leg's.
    near : array of bool, shape (rows, cols, L)
        True where a leg's light reaches a pixel that takes part.
    state : PathState
        The path.
    camera : Camera
        The camera that sees it.
    spot_px : float
        Standard deviation of the spot, px.

    Returns
    -------
    left_out : array of bool, shape (rows, cols)
        True in pixels to be left out.
    corners : tuple of int
        Vertices.
    """
    corners: list[int] = []
    left_out = np.zeros(uneven.shape[:2], dtype=bool)
    rows, cols = np.indices(left_out.shape)
    for corner in state.corners_seen:
        legs = [k for k in state.seen if corner in (k + 1, state.leg_starts[k])]
        row, col = camera.pixels_from_points(state.vertices_mm[corner])
        away = np.hypot(rows - row, cols - col)
        reach = max(
            clear_of_corners_px(state, k, camera, spot_px, share=BEAM_SHARE_STD)[
                1 if corner == k + 1 else 0
            ]
            for k in legs
        )
        own = away[uneven[:, :, legs].any(axis=2) & (away < reach + _AROUND_PX)]
        if not len(own):
            continue
        about = away < max(reach, own.max() + 0.5)
        if all(near[about, k].sum() <= (1.0 - _KEPT) * near[:, :, k].sum() for k in legs):
            left_out |= about
            corners.append(corner)
    return left_out, tuple(corners)


def statements_of_corners(
    ended: Climb, counts: Sequence[Counts], covariance: Floats
) -> tuple[str, ...]:
    """What corners in view and the widths of spots showed of the light, one sentence each.

    Parameters
    ----------
    ended : Climb
        To the path.
    counts : sequence of Counts
        Of its cameras, as they went in.
    covariance : array of float, shape (P, P)
        Of all parameters of the climb.
    """
    said = [
        f"What pixels count about vertex {vertex} is more or less than the light of its legs (a "
        "mirror that shines, a mount that hides): they were left out."
        for vertex in sorted({corner for own in counts for corner in own.corners})
    ]
    for at, layout, places in zip(
        ended.points, ended.order.layouts, ended.order.places, strict=True
    ):
        said.extend(_said_of_beam(at.light, layout, np.sqrt(np.diag(covariance)[places])))
    return tuple(said)


def _said_of_beam(light: Light, layout: Layout, stds: Floats) -> list[str]:
    """What of the spots is the beam's, where it is known: of all legs, and of each alone."""
    said = []
    if light.beam_share is not None and layout.beam is not None:
        share, std = light.beam_share, stds[layout.beam]
        if share > _SEEN_STDS * std:
            said.append(
                f"The beam's own thickness makes {share:.0%} ± {std:.0%} of the spot's variance: "
                "its mirrors and ends cut it aslant."
            )
    for leg, (first, own) in enumerate(zip(layout.own_shares, light.own_shares, strict=True), 1):
        share, std = own[0], stds[first]
        if share > _SEEN_STDS * std:
            said.append(
                f"Leg {leg} is wider than others, or fans out: the beam, not the lens, makes "
                f"{share:.0%} ± {std:.0%} of what its spot is wider."
            )
    return said
