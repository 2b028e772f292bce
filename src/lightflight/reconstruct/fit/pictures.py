"""The pictures of all cameras, of which each may show other legs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightflight.camera.model import Camera
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.leg_in_picture import (
    crosses_picture,
    leg_in_picture,
    lit_by_legs,
)
from lightflight.reconstruct.model.picture import Picture, measure_picture
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting


def pictures_of(
    state: PathState,
    sightings: list[Sighting],
    setting: Setting,
    *,
    std_ps: float,
    fine: bool = False,
    active_px: Mapping[int, float] | None = None,
) -> tuple[Picture, ...]:
    """What the counts of each recording say of the legs that its camera shows.

    Parameters
    ----------
    state : PathState
        The path as it is now.
    sightings : list of Sighting
        Recordings of one flight, on the clock and with their pulses found.
    setting : Setting
        Cameras and medium as they were found so far.
    std_ps : float
        Typical standard deviation of a pulse, ps.
    fine : bool, optional
        As `measure_picture`.
    active_px : mapping of int to float, optional
        Side of the active area of cameras of which it is known; of others their counts say it.

    Returns
    -------
    tuple of Picture
        One per recording; of several cameras each may leave legs dark.

    Raises
    ------
    GeometryError
        Where a leg crosses no camera's picture.
    NothingFoundError
        Where a leg has too few pixels of its own in every picture.
    """

    def measured(may_miss: tuple[int, ...]) -> tuple[Picture, ...]:
        return tuple(
            measure_picture(
                state_in_view(state, setting, o.view), o, camera=setting.cameras[o.view],
                medium=setting.medium, std_ps=std_ps, fine=fine,
                active_px=(active_px or {}).get(o.view), may_miss=may_miss,
            )
            for o in sightings
        )  # fmt: skip

    if not setting.others:
        return measured(())
    pictures = measured(state.seen)
    shown = tuple(k for k in state.seen if any(not one.legs[k].dark for one in pictures))
    if shown != state.seen:
        # What no camera shows well is told as well as it can be.
        pictures = measured(shown)
        for k in state.seen:
            if all(picture.legs[k].dark for picture in pictures):
                leg_in_picture(state, k, setting.camera)
    return pictures


def state_in_view(state: PathState, setting: Setting, view: int) -> PathState:
    """The path as one of several cameras may show it: legs outside of its picture are dark."""
    if not setting.others:
        return state
    camera = setting.cameras[view]
    return _darker(state, [k for k in state.seen if not crosses_picture(state, k, camera)])


def as_shown(state: PathState, picture: Picture) -> PathState:
    """The path as a picture showed it: legs that it tells nothing of are dark."""
    return _darker(state, [k for k in state.seen if picture.legs[k].dark])


def lit_untold(state: PathState, camera: Camera, picture: Picture) -> NDArray[np.bool_] | None:
    """Pixels with light of legs that a picture shows too little of to say where they run.

    Such a leg is dark there: its light is not expected, and says nothing for or against the path.

    Parameters
    ----------
    state : PathState
        The path as the camera may show it (`state_in_view`).
    camera : Camera
        The camera.
    picture : Picture
        What its counts say of the legs.

    Returns
    -------
    array of bool, shape (rows, cols), or None
        None where there is no such leg.
    """
    few = tuple(leg_in_picture(state, k, camera) for k in state.seen if picture.legs[k].dark)
    if not few:
        return None
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    lit = lit_by_legs(few, undistorted_px(camera, rows, cols), spot_px=picture.spot_std_px)
    hidden: NDArray[np.bool_] = lit.any(axis=1).reshape(camera.shape)
    return hidden


def _darker(state: PathState, legs: list[int]) -> PathState:
    return replace(state, dark=(*state.dark, *legs)) if legs else state
