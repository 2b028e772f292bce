"""Places along the legs of a path with the light that they give, in the picture and about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.fit.ends import DARK_PX
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.membership import tip_of_leg
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import inside_edges_px, undistorted_px
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.strength import strength_as_seen

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]

_PER_PX = 3.0
"""Places per pixel of a leg."""
_RUN_ON = 2.0
"""Of a leg's length: so far its light is followed beyond the end of the path. A leg that is half as
long in the picture as a halo is wide sends hardly any light from farther off."""
_STEPS = 801
"""Places at which it is asked how far a leg runs in the picture or near it."""


@dataclass(frozen=True, eq=False)
class LitPlaces:
    """n places along one leg.

    Attributes
    ----------
    leg : int
    points_mm : array of float, shape (n, 3)
    row, col : array of float, shape (n,)
        Where they are seen, px.
    event_ps : array of float, shape (n,)
        When the light passes.
    photons : array of float, shape (n,)
        That they give to the picture; beyond what is seen, as at the last place that is.
    beyond : array of bool, shape (n,)
    """

    leg: int
    points_mm: Floats
    row: Floats
    col: Floats
    event_ps: Floats
    photons: Floats
    beyond: NDArray[np.bool_]


def lit_places(
    fit: JointFit,
    number: int,
    whole: Sighting,
    *,
    source_told: bool,
    near_px: float,
) -> Iterator[LitPlaces]:
    """Places along the bright legs that the picture shows, or nearly.

    Parameters
    ----------
    fit : JointFit
        The path.
    number : int
        The recording whose picture of the path is taken.
    whole : Sighting
        All recordings alike.
    source_told : bool
        Whether the path begins at its source, and not where it enters the view.
    near_px : float
        So far outside of the picture a place is nearly shown, px. A path that ends where the view
        does runs on as far; where light ends in view it does not.

    Yields
    ------
    LitPlaces
        Of one leg.
    """
    camera, picture = fit.solution.cameras[whole.view], fit.pictures[number]
    state, medium = fit.solution.state, fit.solution.medium
    brightest = float(np.nanmax(whole.arrivals.photons, initial=1.0))
    runs_in = not source_told and not _in_picture(fit.tips[0], camera)
    runs_out = {
        k for k in state.last_legs if not _in_picture(tip_of_leg(fit.tips, k, state), camera)
    }
    for k, (leg, of) in enumerate(zip(picture.legs, picture.fits, strict=True)):
        if leg.dark:
            continue
        between = -_RUN_ON * (k == 0 and runs_in), 1.0 + _RUN_ON * (k in runs_out)
        share = _shares_about_view(state, k, camera, between, near_px)
        # About light that is mostly another's, a leg may run away from the picture: no place then.
        if len(share) < 2:
            continue
        points = state.points_mm(k, share)
        row, col = camera.pixels_from_points(points)
        along = leg.along_across(undistorted_px(camera, row, col))[0]
        strength, beyond = strength_as_seen(of.spline, of.spline_covariance, brightest, along)
        across = np.sqrt(2.0 * np.pi) * of.spot_std_at(along)
        photons = across * strength * np.abs(np.gradient(along))
        event = state.event_times_ps(k, share, medium)
        yield LitPlaces(k, points, row, col, event, photons, beyond)


def _in_picture(tip: Floats | None, camera: Camera) -> bool:
    """Whether light begins or stops in the picture: one cut at its edge may run on as well."""
    return tip is not None and bool(inside_edges_px(tip[0], tip[1], camera.shape).min() > DARK_PX)


def _shares_about_view(
    state: PathState, leg: int, camera: Camera, between: tuple[float, float], near_px: float
) -> Floats:
    """(n,), places along a leg, in its length, as far as it runs in the picture or near it."""
    share, (rows, cols) = np.linspace(*between, _STEPS), camera.shape
    row, col = camera.pixels_from_points(state.points_mm(leg, share))
    with np.errstate(invalid="ignore"):
        near = (np.abs(row - 0.5 * rows) < 0.5 * rows + near_px) & (
            np.abs(col - 0.5 * cols) < 0.5 * cols + near_px
        )
    if np.count_nonzero(near) < 2:
        return np.zeros(0)
    low, high = share[near][[0, -1]]
    length_px = float(np.sum(np.hypot(np.diff(row[near]), np.diff(col[near]))))
    n = int(np.ceil(_PER_PX * length_px))
    shares: Floats = low + (high - low) * (np.arange(n) + 0.5) / n
    return shares
