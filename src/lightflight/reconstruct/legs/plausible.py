"""Whether a set-up can be that of a recording: units, aspect, and which way round the picture is.

Takes what is told and the legs in the picture; no path is needed. What these checks find is told
as findings; lengths off by so much that no path could be computed are refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import GeometryError
from lightflight.path.verdict import Finding, FindingName, noted
from lightflight.reconstruct.model.image_plane import mean_focal_px
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS

if TYPE_CHECKING:
    from lightflight.camera.model import Camera
    from lightflight.flight import Medium, Source
    from lightflight.reconstruct.legs.find import ImageLeg

Floats = NDArray[np.float64]

_SLOWEST = 200.0
"""Light that flies away from the camera, 1 degree off the line of sight, seems to cross a pixel so
many times slower than it can; metres for mm make a thousand."""
_LEAST_CODES = 0.05
"""A clock tells nothing of light that crosses the whole picture in a smaller part of a code: of
metres for mm there is a hundredth. Swiftest legs do not tell where pixels have delays unknown."""
_SQUARE = 0.05
"""Pixels whose sides differ by less are taken for square."""
_SURELY_SQUARE = 0.02
_LEAST_MISS_PX = 3.0
"""A leg's line that passes the source by less may well start there, px."""
_LINE_PX = 0.3
"""How well a leg's line is known at its ends, px."""
_NEARLY = 2.0
"""A miss must be this many times what is allowed before another orientation is asked."""
_TINY_MM = 2.0
"""A place told as nearer than this to the origin, and not at it, may be in metres, mm."""

_NARROWEST, _WIDEST = 3e-3, 20.0
"""Width of the field over its distance: 0.2 degrees, and 168, which no pinhole's lens sees. Of the
usual 0.1 to 1 metres for mm make a thousandth or a thousand times as much."""

_TURNS = (
    ("mirrored left to right", ((-1, 0), (0, 1))),
    ("mirrored top to bottom", ((1, 0), (0, -1))),
    ("turned by 180 degrees", ((-1, 0), (0, -1))),
    ("transposed", ((0, 1), (1, 0))),
    ("turned by 90 degrees", ((0, -1), (1, 0))),
    ("turned by 270 degrees", ((0, 1), (-1, 0))),
    ("transposed along the other diagonal", ((0, -1), (-1, 0))),
)
"""What may have been done to a picture, on (u, v); the last four want square arrays."""


def distance_mm(camera: Camera, source: Source) -> float:
    """Depth of the source along the optical axis; of the origin, where that is not known; mm."""
    point = np.zeros(3) if source.position_mm is None else np.asarray(source.position_mm)
    depth = float((camera.center_mm - point) @ camera.backward_axis)
    return depth if depth > 0.0 else float(np.linalg.norm(camera.center_mm - point))


def pixel_sides_mm(camera: Camera, source: Source) -> tuple[float, float]:
    """(width, height) of what one pixel sees at the source's distance, mm."""
    far = distance_mm(camera, source)
    return far / abs(float(camera.matrix[0, 0])), far / abs(float(camera.matrix[1, 1]))


def slowness(
    camera: Camera, source: Source, medium: Medium, legs: Sequence[ImageLeg]
) -> tuple[float, float]:
    """Time from pixel to pixel as recorded, of the leg that is swiftest, and of flight, ps."""
    recorded = float(np.min([1.0 / leg.apparent_speed_px_per_ps for leg in legs]))
    return recorded, _pixel_flight_ps(camera, source, medium)


def _pixel_flight_ps(camera: Camera, source: Source, medium: Medium) -> float:
    """Time in which light crosses what one pixel sees, ps."""
    seen_mm = distance_mm(camera, source) / mean_focal_px(camera)
    return seen_mm * medium.path_group_index / SPEED_OF_LIGHT_MM_PER_PS


class OtherUnitsError(GeometryError):
    """Lengths in other units than mm: no path is worth a trial."""


def refuse_other_field(camera: Camera) -> None:
    """Refuse a field of view that no lens sees.

    Raises
    ------
    OtherUnitsError
        Where it is far too wide, or too narrow, for its distance.
    """
    found = units_of_camera(camera)
    if found is not None:
        raise OtherUnitsError(f"{found.sentence}: {found.remedy}")


def refuse_other_units(
    camera: Camera, source: Source, medium: Medium, legs: Sequence[ImageLeg]
) -> None:
    """Refuse lengths that are off by orders of magnitude.

    Raises
    ------
    OtherUnitsError
        Where light would cross a pixel many times slower than it can.
    """
    found = units_of_lengths(camera, source, medium, legs)
    if found is not None:
        raise OtherUnitsError(f"{found.sentence}: {found.remedy}")


def implausible(
    camera: Camera,
    source: Source,
    medium: Medium,
    legs: Sequence[ImageLeg],
    *,
    code_ps: float | None = None,
) -> tuple[Finding, ...]:
    """All that makes a set-up an unlikely one for a recording.

    Parameters
    ----------
    camera : Camera
        As told.
    source : Source
        As told.
    medium : Medium
        As told.
    legs : sequence of ImageLeg
        Found in the picture of that camera; none: what rests on them is not asked.
    code_ps : float, optional
        Width of a code, ps.

    Returns
    -------
    tuple of Finding
        Empty for a sound set-up.
    """
    asked = (
        units_of_camera(camera),
        (units_of_lengths(camera, source, medium, legs) if legs else None)
        or units_of_field(camera, source, medium, code_ps),
        units_of_source(camera, source),
        unit_of_emission(source, code_ps),
        aspect(camera, source),
        orientation(camera, source, legs),
    )
    return tuple(finding for finding in asked if finding is not None)


def units_of_camera(camera: Camera) -> Finding | None:
    """Whether the field of view can be as wide as it is told to be, so far away."""
    width = camera.shape[1] / abs(float(camera.matrix[0, 0]))
    if _NARROWEST < width < _WIDEST:
        return None
    return noted(
        FindingName.UNITS,
        f"the camera is told to see a field {width:.3g} times as wide as it is far away",
        "give distance and field of view both in mm (0.535, or 535?)",
    )


def units_of_lengths(
    camera: Camera, source: Source, medium: Medium, legs: Sequence[ImageLeg]
) -> Finding | None:
    """Whether light crosses a pixel in about the time that its length asks for."""
    recorded, flight = slowness(camera, source, medium, legs)
    if recorded < _SLOWEST * flight:
        return None
    far = distance_mm(camera, source)
    return noted(
        FindingName.UNITS,
        f"light crosses what one pixel sees in {flight:.2g} ps by the set-up, and needs "
        f"{recorded:.2g} ps from pixel to pixel in the recording",
        f"give all lengths in mm: is the source {far:.3g} mm from the camera, or {1e3 * far:.3g}?",
    )


def units_of_field(
    camera: Camera, source: Source, medium: Medium, code_ps: float | None
) -> Finding | None:
    """Whether light crosses the picture in a time that the camera's clock can tell."""
    flight = max(camera.shape) * _pixel_flight_ps(camera, source, medium)
    if code_ps is None or flight > _LEAST_CODES * code_ps:
        return None
    far = distance_mm(camera, source)
    return noted(
        FindingName.UNITS,
        f"light crosses the whole picture in {flight:.2g} ps by the set-up, and a code is "
        f"{code_ps:.3g} ps",
        f"give all lengths in mm: is the source {far:.3g} mm from the camera, or {1e3 * far:.3g}?",
    )


def units_of_source(camera: Camera, source: Source) -> Finding | None:
    """Whether the source's place may be in metres, where the camera's is not."""
    if source.position_mm is None:
        return None
    away = float(np.linalg.norm(source.position_mm))
    if not 0.0 < away < _TINY_MM or distance_mm(camera, source) < 50.0 * _TINY_MM:
        return None
    return noted(
        FindingName.UNITS,
        f"the source is told to be {away:.3g} mm from the origin",
        f"give its place in mm: {away:.3g}, or {1000.0 * away:.3g}?",
    )


def unit_of_emission(source: Source, code_ps: float | None) -> Finding | None:
    """Whether the emission time may be in ns or s: less than a code, and not zero."""
    told = source.emission_time_ps
    if told is None or code_ps is None or not 0.0 < abs(told) < code_ps:
        return None
    # Of ns, or of seconds: a laser's delay is not below a femtosecond of either.
    unit = 1e3 if abs(told) > 1e-3 else 1e12
    return noted(
        FindingName.UNITS,
        f"the emission time of {told:.3g} ps is less than one code of {code_ps:.3g} ps",
        f"give it in ps on the calibrated clock: {told:.3g}, or {told * unit:.4g}?",
    )


def aspect(camera: Camera, source: Source) -> Finding | None:
    """Whether pixels are square, and would be with width and height of the field swapped."""
    width, height = pixel_sides_mm(camera, source)
    rows, cols = camera.shape
    if abs(width / height - 1.0) < _SQUARE:
        return None
    swapped = (rows / cols) ** 2 * height / width
    doubt = "are width and height of the field of view what they are told to be?"
    if abs(swapped - 1.0) < _SURELY_SQUARE:
        doubt = "swap width and height of the field of view, and pixels are square"
    return noted(
        FindingName.ORIENTATION,
        f"one pixel sees {width:.3g} x {height:.3g} mm, not a square",
        doubt,
    )


def orientation(camera: Camera, source: Source, legs: Sequence[ImageLeg]) -> Finding | None:
    """Whether the first leg leads back to the source, or would in a picture the other way round."""
    at = source_px(camera, source)
    if at is None or not legs:
        return None
    first = legs[0]
    allowed = _allowed_px(camera, source, first, at)
    miss = _miss_px(first, at)
    if miss < _NEARLY * allowed:
        return None
    square = camera.shape[0] == camera.shape[1]
    turns = _TURNS if square else _TURNS[:3]
    # The source in a picture that was turned, instead of the leg in the one that was not.
    better = [name for name, turn in turns if _miss_px(first, np.array(turn).T @ at) < allowed]
    if not better:
        return None
    return noted(
        FindingName.ORIENTATION,
        f"the first leg in the picture passes the source by {miss:.0f} px, and would lead back to "
        f"it were the picture {' or '.join(better)}",
        "look at the set-up drawn over the picture (lightflight check -o), and read the recording "
        "the right way round",
    )


def source_px(camera: Camera, source: Source) -> Floats | None:
    """(u, v) of the source in the undistorted picture, px; None: unknown, or behind the camera."""
    if source.position_mm is None:
        return None
    x, y = camera.normalized_from_points(source.position_mm)
    at = mean_focal_px(camera) * np.array([float(x), float(y)])
    return at if np.isfinite(at).all() else None


def _miss_px(leg: ImageLeg, point: Floats) -> float:
    """How far a point is from the line of a leg, before its beginning, px."""
    offset = point - leg.origin_px
    along = float(offset @ leg.direction_px)
    across = float(offset[0] * leg.direction_px[1] - offset[1] * leg.direction_px[0])
    beyond = max(along - leg.extent_px[0], 0.0)
    return float(np.hypot(across, beyond))


def _allowed_px(camera: Camera, source: Source, leg: ImageLeg, at: Floats) -> float:
    """By how much a sound first leg may miss the source: line, source and camera, px."""
    length = leg.extent_px[1] - leg.extent_px[0]
    lever = float(np.linalg.norm(at - leg.origin_px)) / max(length, 1.0)
    per_mm = mean_focal_px(camera) / distance_mm(camera, source)
    place = float(np.max(source.position_std_mm))
    pose = camera.pose_covariance
    if pose is not None:
        turn, shift = (
            float(np.sqrt(np.diag(pose)[part].max())) for part in (slice(3), slice(3, 6))
        )
        place += shift + turn * distance_mm(camera, source)
    return _LEAST_MISS_PX + 4.0 * (_LINE_PX * lever + per_mm * place)
