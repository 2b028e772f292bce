"""What a set-up file may say: every section, its keys, what each means and may hold.

`SECTIONS` has them all (docs/reference/setup-file.md is made from it). Keys that mirror a record
field by field, those of [detector], are read from the record: its annotations say what a value may
be, the Attributes section of its docstring what it means.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache

from lightflight.files import toml_tables as config
from lightflight.files.toml_tables import Key
from lightflight.materials import MATERIALS
from lightflight.reconstruct import FREE_NAMES
from lightflight.reconstruct.estimators import METHODS
from lightflight.simulate.detector import Detector
from lightflight.timing.calibrate.flat_shapes import FLAT_SHAPE_NAMES

WORD_FOR_NONE = "none"
"""How a set-up file says None where that is not the default."""

# One number for all three axes, or one for each.
_per_axis = config.either(config.number, config.numbers(3))


def _number_or_inf(value: object) -> float:
    """Accept any number and inf."""
    return math.inf if value == math.inf else config.number(value)


CAMERA_KEYS = (
    Key(
        "file",
        "set-up file of a calibrated camera (from `lightflight calibrate camera`), beside this "
        "one; stands in place of all other keys",
        config.text,
    ),
    Key("shape", "(rows, cols) of the pixel array", config.integers(2)),
    Key(
        "distance_mm",
        "entrance pupil to the plane z = 0 that the camera faces, mm",
        config.number,
    ),
    Key(
        "field_of_view_mm",
        "(width, height) on z = 0 between the outer edges of the outer pixels, mm",
        config.numbers(2),
    ),
    Key("center_mm", "(x, y) that the pupil stands above, mm", config.numbers(2)),
    Key(
        "matrix",
        "OpenCV's camera matrix K, px; with it, world_from_camera stands in place of "
        "distance_mm, field_of_view_mm and center_mm",
        config.table_of_numbers(3, rows=3),
    ),
    Key("distortion", "OpenCV's k1 k2 p1 p2 k3 ...", config.numbers()),
    Key(
        "world_from_camera",
        "rigid pose, mm; camera axes x right, y down, z forward",
        config.table_of_numbers(4, rows=4),
    ),
    Key("position_std_mm", "one-sigma error of the pupil's place, one or three, mm", _per_axis),
    Key(
        "rotation_std_deg",
        "one-sigma error of the pose's rotation about the world axes, one or three, deg",
        _per_axis,
    ),
    Key(
        "pose_covariance",
        "in place of the two above: rotation (rad), then place (mm), world axes",
        config.table_of_numbers(6, rows=6),
    ),
    Key(
        "field_of_view_std_mm",
        "one-sigma error of the width at that distance, the height going along: an error of the "
        "focal length, mm",
        config.number,
    ),
    Key(
        "focal_std_fraction",
        "in place of field_of_view_std_mm: one-sigma error of the focal length as a share of it",
        config.number,
    ),
    Key("aspect_std", "one-sigma error of height against width, fy / fx, a share", config.number),
    Key(
        "axis_std_px",
        "one-sigma error of where the optical axis meets the picture, each way, px",
        config.number,
    ),
    Key("distortion_std", "one-sigma error of the radial distortion k1", config.number),
    Key("decentering_std", "one-sigma error of the decentring p1 and p2", config.number),
    Key(
        "clock_offset_ps",
        "how much later its clock tells the same instant than all others (the first camera's), ps",
        config.number,
    ),
    Key(
        "clock_offset_std_ps",
        "its one-sigma error, ps; inf: nothing is known of it; 0: exact",
        _number_or_inf,
    ),
)

SOURCE_KEYS = (
    Key("position_mm", "(x, y, z) where the pulse leaves the laser, mm", config.numbers(3)),
    Key("position_std_mm", "its one-sigma error, one or three, mm; 0: exact", _per_axis),
    Key(
        "emission_time_ps",
        "when the pulse leaves the source, on the calibrated clock, ps; left out: fitted",
        config.number,
    ),
    Key("emission_time_std_ps", "its one-sigma error, ps; 0: exact", config.number),
    Key("pulse_fwhm_ps", "full width at half maximum of the laser pulse, ps", config.number),
)

MEDIUM_KEYS = (
    Key("path_group_index", "group index along the path (fibre: about 1.47)", config.number),
    Key(
        "material",
        "in place of both group indices, what light flies through; with wavelength_nm",
        config.choice(*MATERIALS),
    ),
    Key("wavelength_nm", "of the laser, nm", config.number),
    Key("return_group_index", "group index from the path to the camera", config.number),
    Key("path_group_index_std", "one-sigma error of path_group_index; 0: exact", config.number),
    Key("return_group_index_std", "one-sigma error of return_group_index; 0: exact", config.number),
    Key(
        "index_correlation",
        "of those two errors: 1, one medium both ways; 0, two that know nothing of each other",
        config.number,
    ),
)

_indices = config.numbers(2)

WINDOW_KEYS = (
    Key(
        "distance_mm",
        "from the entrance pupil along the optical axis to the face that the camera sees first, mm",
        config.number,
    ),
    Key("thickness_mm", "of the glass, mm; left out: one face, as of open water", config.number),
    Key(
        "normal",
        "direction across the window; left out: it faces the camera squarely",
        config.numbers(3),
    ),
    Key("distance_std_mm", "one-sigma error of distance_mm, mm; 0: exact", config.number),
    Key("wavelength_nm", "of the laser, nm: materials named here have its indices", config.number),
    Key("glass", f"of the window: {', '.join(MATERIALS)}", config.choice(*MATERIALS)),
    Key("glass_indices", "in place of glass: its phase index and its group index", _indices),
    Key(
        "behind",
        "what fills the scene behind it; left out: air",
        config.choice(*MATERIALS),
    ),
    Key("behind_indices", "in place of behind: its phase index and its group index", _indices),
    Key(
        "interfaces",
        "in place of all these, any planes from the camera to the scene, one row (x, y, z of a "
        "point, x, y, z of the normal, phase index and group index beyond, one-sigma errors of its "
        "place and of that phase index) each, mm",
        config.table_of_numbers(10),
    ),
    Key("front_indices", "phase and group index of what the camera stands in", _indices),
)

BLOCK_KEYS = (
    Key("center_mm", "middle of a block of glass in the beam, mm", config.numbers(3)),
    Key("normal", "direction across its faces, either way", config.numbers(3)),
    Key("thickness_mm", "from face to face, mm", config.number),
    Key(
        "diameter_mm",
        "how wide its faces are, mm: pixels that look at a disc of this size take no part",
        config.number,
    ),
    Key("wavelength_nm", "of the laser, nm: materials named here have its indices", config.number),
    Key("glass", f"of the block: {', '.join(MATERIALS)}", config.choice(*MATERIALS)),
    Key("glass_indices", "in place of glass: its phase index and its group index", _indices),
    Key("around", "what it stands in; left out: air", config.choice(*MATERIALS)),
    Key("around_indices", "in place of around: its phase index and its group index", _indices),
    Key(
        "blocks",
        "in place of all these, any number of blocks, one row (x, y, z of the middle, x, y, z of "
        "the normal, thickness, diameter, phase index and group index of the glass, and of what "
        "it stands in) each, mm",
        config.table_of_numbers(12),
    ),
)

CURVE_KEYS = (
    Key(
        "points_mm",
        "places on the curve that a leg runs along, in the order of flight, one row (x, y, z) "
        "each, mm",
        config.table_of_numbers(3),
    ),
    Key("leg", "which leg, from 0; 0", config.integer),
    Key("point_std_mm", "one-sigma error of each place by itself, mm", config.number),
    Key("position_std_mm", "of the whole curve on each axis, mm; 0", config.number),
    Key("turn_std_deg", "of the whole curve about each axis, deg; 0", config.number),
)

TIMING_KEYS = (
    Key(
        "flat_arrival_ps",
        "when the light of the flat recording reached the camera, on the clock it defines, ps",
        config.number,
    ),
    Key(
        "dead_codes",
        "whether the time of the dead codes is absorbed by the first live ones or lost",
        config.choice("absorbed", "lost"),
    ),
    Key(
        "assumed_skew_std_ps",
        "spread of the pixels' own delays to assume where no flat was recorded, ps",
        config.number,
    ),
    Key(
        "flat_tilt_std_ps",
        "how far the flat's beam may have been tilted, as time from edge to edge of the array, ps",
        config.number,
    ),
    Key(
        "flat_arrival_std_ps",
        "one-sigma error of flat_arrival_ps, alike in all pixels: of the clock's zero, ps",
        config.number,
    ),
    Key(
        "scale_std",
        "one-sigma error of the length of all codes, as a share, beyond what is measured",
        config.number,
    ),
    Key(
        "drift_std_ps",
        "how far the clock may have drifted from its flat by the middle of a recording, ps",
        config.number,
    ),
    Key(
        "flat_pulse",
        "shape of the flat's pulse, and of the recordings' where it is a tail",
        config.choice(*FLAT_SHAPE_NAMES),
    ),
)

RECONSTRUCT_KEYS = (
    Key("method", "estimator", config.choice(*sorted(METHODS))),
    Key(
        "free",
        "what to fit within its plausible size, of those that are told as exact or nearly so",
        config.texts(*FREE_NAMES),
    ),
    Key("n_legs", "number of legs, where it is known; left out: found", config.integer),
    Key(
        "waypoints",
        "known places of vertices, one row (vertex, x, y, z, std) each, mm",
        config.table_of_numbers(5),
    ),
    Key(
        "lengths",
        "known lengths of legs, one row (leg from 0, length, std) each, mm",
        config.table_of_numbers(3),
    ),
)

SCENE_KEYS = (
    Key("vertices_mm", "source, mirrors and end of the path, mm", config.table_of_numbers(3)),
    Key(
        "source_direction",
        "in place of vertices_mm: in which the pulse leaves [source] position_mm; of any length",
        config.numbers(3),
    ),
    Key(
        "mirrors",
        "plane mirrors that the pulse may meet, in any order; one row (x, y, z of the middle, x, "
        "y, z of the normal, diameter) each, mm; diameter 0: no rim",
        config.table_of_numbers(7),
    ),
    Key("exit_length_mm", "length of the last leg of a path by way of mirrors, mm", config.number),
    Key(
        "most_reflections",
        "where a path by way of mirrors ends at the latest (a cavity); 100",
        config.integer,
    ),
    Key(
        "photons_per_pixel",
        "expected signal counts in the brightest pixel (code_density, flat: mean counts)",
        config.number,
    ),
    Key("brightness", "relative scattering strength of each leg", config.numbers()),
    Key(
        "dust_contrast",
        "in place of brightness: uneven scattering; standard deviation of its logarithm",
        config.number,
    ),
    Key("dust_correlation_mm", "path length over which dust stays alike, mm; 10", config.number),
    Key("dust_seed", "decides the pattern of the dust; 0", config.integer),
    Key("background", "expected background counts per pixel", config.number),
    Key(
        "true_emission_time_ps",
        "when the pulse starts, where [source] does not say, ps",
        config.number,
    ),
    Key(
        "true_pulse_fwhm_ps",
        "width of the laser pulse, where [source] does not say, ps",
        config.number,
    ),
    Key("beam_diameter_mm", "1/e^2 diameter of the beam, mm; 0: a line", config.number),
    Key("scattering", "angular law of the scattering", config.choice("uniform", "rayleigh")),
    Key(
        "polarization", "direction of the field on the first leg; left out: none", config.numbers(3)
    ),
    Key("inverse_square", "light thins with the distance to the camera", config.flag),
    Key("cos4_falloff", "the lens darkens towards the rim of its field", config.flag),
    Key(
        "vignetting",
        "share of light that the lens's mount holds back in the corner of the picture, 0 to 1",
        config.number,
    ),
)


@cache
def field_meanings(record: type) -> dict[str, str]:
    """What the Attributes section of a record's docstring says of each field.

    Parameters
    ----------
    record : type
        A dataclass with a docstring in the form of numpydoc.

    Returns
    -------
    dict of str to str
        Sentence by name of the field, in one line; empty where there is no such section.

    Examples
    --------
    >>> from lightflight.flight import Medium
    >>> field_meanings(Medium)["path_group_index_std"]
    'One-sigma error of n_p. 0: exact.'
    """
    section = (inspect.getdoc(record) or "").partition("Attributes\n----------\n")[2]
    entries = re.findall(r"^(\w+) : .*\n((?: {4}.*\n?)+)", section, re.MULTILINE)
    return {name: " ".join(meaning.split()) for name, meaning in entries}


_CHECK_FROM_ANNOTATION = {
    "bool": config.flag,
    "int": config.integer,
    "float": config.number,
    "tuple[float, ...]": config.numbers(),
    "tuple[float, float]": config.numbers(2),
    "ArrayLike": config.nested_numbers,
}
"""How a set-up file writes a field that is annotated so."""


def _keys_from_fields(record: type) -> tuple[Key, ...]:
    """Keys of a section that mirrors a dataclass field by field."""
    keys = []
    for item in fields(record):
        annotation = str(item.type)
        may_be_none = annotation.endswith(" | None")
        check = _CHECK_FROM_ANNOTATION[annotation.removesuffix(" | None")]
        # Where None is the default, leaving the key out says it; a word for it is needed elsewhere.
        if may_be_none and item.default is not None:
            check = config.either(check, config.word_for_none(WORD_FOR_NONE))
        keys.append(Key(item.name, field_meanings(record).get(item.name, ""), check))
    return tuple(keys)


DETECTOR_KEYS = (
    Key("preset", "a detector to start from; the other keys change it", config.text),
    *_keys_from_fields(Detector),
)

SECTIONS: Mapping[str, Sequence[Key] | None] = {
    "camera": CAMERA_KEYS,
    "window": WINDOW_KEYS,
    "source": SOURCE_KEYS,
    "medium": MEDIUM_KEYS,
    "block": BLOCK_KEYS,
    "curve": CURVE_KEYS,
    "detector": DETECTOR_KEYS,
    "recording": None,
    "timing": TIMING_KEYS,
    "reconstruct": RECONSTRUCT_KEYS,
    "scene": SCENE_KEYS,
}
"""Keys of each section; None: the section is passed on, and checked by `lightflight.read`."""
