"""Calls of the reconstruction: all that can be wrong with one is said before any work."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from numbers import Integral, Real
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from lightflight.arguments import mask_of_pixels, shown
from lightflight.camera.refraction import refuse_other_medium, refuse_way_through
from lightflight.errors import CalibrationError, GeometryError
from lightflight.flight import Source
from lightflight.reconstruct.estimators import ESTIMATORS, estimator_named
from lightflight.reconstruct.legs.plausible import refuse_other_field

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.reconstruct.model.setting import Setting
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.code_clock import CodeClock

_FOR_SEVERAL_CAMERAS = {one.name for one in ESTIMATORS if one.several_cameras}


def cameras_and_clocks(
    camera: Camera | Sequence[Camera] | None,
    timing: CodeClock | Sequence[CodeClock] | None,
    recordings: list[Histograms],
    method: str,
) -> tuple[list[Camera | None], list[CodeClock | None]]:
    """Cameras (one for all, or one for each recording), and a clock for each recording."""
    if not recordings:
        raise ValueError("hist is an empty list: give at least one recording")
    clocks: list[CodeClock | None] = (
        list(timing) if isinstance(timing, Sequence) else [timing] * len(recordings)
    )
    cameras: list[Camera | None] = list(camera) if isinstance(camera, Sequence) else [camera]
    if len(clocks) != len(recordings):
        raise ValueError(
            f"{len(clocks)} calibrations for {len(recordings)} recordings: give one for each"
        )
    if isinstance(camera, Sequence) and len(cameras) != len(recordings):
        raise ValueError(
            f"{len(cameras)} cameras for {len(recordings)} recordings: give one for all, or one "
            "for each"
        )
    if len(cameras) > 1 and method not in _FOR_SEVERAL_CAMERAS:
        raise ValueError(
            f"method={method!r} takes one camera: fit several at once with method='joint' or "
            "'photon'"
        )
    return cameras, clocks


def first_copy(recordings: Sequence[Histograms]) -> tuple[int, int] | None:
    """The first recording that holds the counts of an earlier one: that one and it, or None."""
    known: dict[bytes, int] = {}
    for k, hist in enumerate(recordings if len(recordings) > 1 else ()):
        digest = hashlib.sha256(np.ascontiguousarray(hist.counts).data).digest()
        if digest in known and hist.counts.any():
            return known[digest], k
        known[digest] = k
    return None


def refuse_copies(recordings: Sequence[Histograms]) -> None:
    """Raise ValueError where a recording is given twice: its photons would count twice."""
    copy = first_copy(recordings)
    if copy is not None:
        raise ValueError(
            f"hist: recordings {copy[0] + 1} and {copy[1] + 1} hold the same counts: give each "
            "recording once"
        )


def is_whole(number: object) -> bool:
    """Whether it is a whole number, or a float that is one."""
    if isinstance(number, Integral):
        return True
    return isinstance(number, Real) and float(number).is_integer()


def checked_call(
    repeats: list[Histograms],
    camera: Camera | None,
    source: Source,
    method: str,
    n_legs: int | None,
    exclude_mask: ArrayLike | None,
) -> Camera:
    """Everything that can be wrong with a call, before any work.

    Parameters
    ----------
    repeats : list of Histograms
        Recordings of one scene by one camera.
    camera : Camera or None
        The camera that recorded them.
    source : Source
        What is known of where and when the pulse starts.
    method : str
        The estimator asked for.
    n_legs : int or None
        How many legs there are, where the user knows it; None: as many as the data show.
    exclude_mask : array_like, shape (rows, cols) or None
        True for pixels that take no part.

    Returns
    -------
    Camera
        The camera, which then is not None.

    Raises
    ------
    ValueError
        For an unknown method, a number of legs that is none, a mask of another shape, or scaled
        intensities for an estimator that needs counts.
    TypeError
        Where `hist` holds no counts.
    CalibrationError
        Where the time per bin is unknown.
    GeometryError
        Where the camera is missing, has other pixels, is told in other units, or sits on the
        source.
    """
    estimator = estimator_named(method)
    if n_legs is not None and not (is_whole(n_legs) and n_legs >= 1):
        raise ValueError(f"n_legs must be a whole number of at least 1, got {shown(n_legs)}")
    for one in repeats:
        if not hasattr(one, "counts"):
            raise TypeError(
                f"hist must be Histograms or a list of them, got {type(one).__name__}: "
                "make them of a cube (lightflight.Histograms) or a file's recording "
                "(lightflight.histogram(lightflight.read(...)))"
            )
        # Without a scale of time there are legs in the picture, but no path in space.
        if one.bin_width_ps is None:
            raise CalibrationError(
                "the time per bin of this recording is unknown, so positions have no scale: give "
                "bin_width_ps (the legs in the picture need neither: lightflight.find_legs)"
            )
    if camera is None:
        raise GeometryError(
            "the camera's place is unknown, so arrival times have no geometry: give camera= (for "
            "instance Camera.facing_plane with its distance and field of view)"
        )
    for one in repeats:
        if tuple(one.shape) != tuple(camera.shape):
            raise GeometryError(
                f"the recording has {one.shape[0]} x {one.shape[1]} pixels and the camera "
                f"{camera.shape[0]} x {camera.shape[1]}: give the camera that recorded it"
            )
    if estimator.needs_counts and not all(one.poisson for one in repeats):
        raise ValueError(
            f"method={method!r} needs photon counts, and this recording holds scaled intensities "
            "(poisson=False): use method='joint'"
        )
    refuse_other_field(camera)
    if exclude_mask is not None:
        mask_of_pixels("exclude_mask", exclude_mask, camera.shape)
    if source.position_mm is not None:
        gap = np.linalg.norm(np.asarray(source.position_mm, dtype=float) - camera.center_mm)
        # s = 0 in the closed form: every ray then meets the source at once.
        if gap < 1e-6:
            raise GeometryError(
                "the source sits on the camera: every direction then gives the same times; check "
                "position_mm and the camera's pose"
            )
    return camera


def checked_media(setting: Setting, method: str) -> None:
    """What the cameras look through and the medium of the scene, before any work.

    Parameters
    ----------
    setting : Setting
        Cameras and medium.
    method : str
        The estimator asked for.

    Raises
    ------
    ValueError
        Where the medium is not the one behind the last interface, or the estimator knows no
        interfaces, blocks, curves or lengths; for curves beside blocks.
    GeometryError
        Where pixels look along rays that never get behind the interfaces, or the beam comes through
        one from the source.
    """
    if setting.medium.blocks and not estimator_named(method).through_windows:
        raise ValueError(
            f"method={method!r} knows one medium, and a block of glass stands in the beam: use "
            "method='joint' or 'photon'"
        )
    if setting.curves and estimator_named(method).of_fit is None:
        raise ValueError(
            f"method={method!r} knows straight legs, and a curve is told: use method='joint' or "
            "'photon'"
        )
    if setting.lengths and estimator_named(method).of_fit is None:
        raise ValueError(
            f"method={method!r} takes no lengths of legs: use method='joint' or 'photon'"
        )
    if setting.curves and setting.medium.blocks:
        raise ValueError(
            "a curve is told, and a block of glass stands in the beam: legs through glass are "
            "straight, leave one of both out"
        )
    for camera in setting.cameras:
        if not camera.interfaces:
            continue
        if not estimator_named(method).through_windows:
            raise ValueError(
                f"method={method!r} knows one medium, and the camera looks through an interface: "
                "use method='joint' or 'photon'"
            )
        refuse_other_medium(camera, setting.medium)
        refuse_way_through(camera, setting.source)
        _refuse_reflected(camera)


def _refuse_reflected(camera: Camera) -> None:
    """Refuse a camera some of whose pixels see nothing of the scene."""
    origins, _, _ = camera.lines_of_sight(*np.indices(camera.shape))
    lost = ~np.isfinite(origins).all(axis=-1)
    if lost.any():
        row, col = np.argwhere(lost)[0]
        raise GeometryError(
            f"{int(lost.sum())} of {lost.size} pixels, the first at (row, col) = ({row}, {col}), "
            "look along rays that are totally reflected, or miss an interface: check the order, "
            "the normals and the indices of what the camera looks through"
        )
