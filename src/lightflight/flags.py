"""One registry of everything that can be wrong with a pixel or a pulse.

A bad pixel never raises and never passes silently: its floats become NaN where they mean
nothing, and a bit is set in its `flags` (uint32). Constants, the decoder and the generated
documentation all come from `REGISTRY`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Flag:
    """One thing that can be wrong.

    Attributes
    ----------
    value : int
        The bit.
    name : str
        Short word in tables.
    meaning : str
        Sentence in the documentation.
    excludes : bool
        Whether a pulse that carries it takes no part in a reconstruction.
    """

    value: int
    name: str
    meaning: str
    excludes: bool


REGISTRY: tuple[Flag, ...] = (
    Flag(1 << 0, "no_photons", "the pixel holds no counts at all", True),
    Flag(1 << 1, "too_few", "too few photons stand above the background to place a pulse", True),
    Flag(1 << 2, "no_pulse", "the counts show no pulse: background alone explains them", True),
    Flag(1 << 3, "too_wide", "the pulse is much wider than the array's (paper Fig. 2b)", True),
    Flag(1 << 4, "too_narrow", "the pulse is much narrower than the array's (Fig. 2b)", True),
    Flag(1 << 5, "abnormal_count", "the pixel counts far more than its peers (Fig. 2b)", True),
    Flag(1 << 6, "screaming", "the pixel fires in most frames, light or no light", True),
    Flag(1 << 7, "dead", "the pixel never fires, or is blind to light", True),
    Flag(1 << 8, "saturated", "counts stand at the storage limit or at one per frame", True),
    Flag(1 << 9, "not_converged", "the fit did not meet its tolerance", True),
    Flag(1 << 10, "no_covariance", "the fit has no usable covariance", True),
    Flag(1 << 11, "poor_fit", "goodness of fit is worse than chance allows", False),
    Flag(1 << 12, "multiple_pulses", "the pixel holds more than one pulse", False),
    Flag(1 << 13, "near_gate_edge", "the pulse is cut by the end of the recorded range", True),
    Flag(1 << 14, "uncalibrated", "no calibration reaches this pixel; nominal values used", False),
    Flag(1 << 15, "interpolated", "the value was interpolated from neighbouring pixels", False),
    Flag(1 << 16, "masked", "excluded by the user", True),
    Flag(1 << 17, "ray_misses_path", "the pixel's ray comes near no leg of the path", False),
    Flag(1 << 18, "ill_conditioned", "the geometry turns small errors into large ones", False),
    Flag(1 << 19, "pile_up", "the rate per laser period is high enough to bend time", False),
    Flag(1 << 20, "outlier", "its time disagrees with the path by more than chance allows", False),
)

NO_PHOTONS, TOO_FEW, NO_PULSE, TOO_WIDE, TOO_NARROW, ABNORMAL_COUNT = (
    flag.value for flag in REGISTRY[:6]
)
SCREAMING, DEAD, SATURATED, NOT_CONVERGED, NO_COVARIANCE, POOR_FIT = (
    flag.value for flag in REGISTRY[6:12]
)
MULTIPLE_PULSES, NEAR_GATE_EDGE, UNCALIBRATED, INTERPOLATED, MASKED = (
    flag.value for flag in REGISTRY[12:17]
)
RAY_MISSES_PATH, ILL_CONDITIONED, PILE_UP, OUTLIER = (flag.value for flag in REGISTRY[17:21])

EXCLUDING: int = sum(flag.value for flag in REGISTRY if flag.excludes)
"""All bits that keep a pulse out of a reconstruction."""

SCREAMING_OCCUPANCY = 0.6
"""A pixel that fires in more of its frames than this may scream; what else it must do depends on
the light: see `pixels_that_scream_in_a_scene`, `..._under_even_light` and, for a dark recording,
`timing.pulses.checks`."""


def names_from_flags(flags: int) -> tuple[str, ...]:
    """Short names of the bits set in one flag word.

    Parameters
    ----------
    flags : int
        Sum of bits; unknown ones are passed over.

    Returns
    -------
    tuple of str
        In the order of `REGISTRY`.

    Examples
    --------
    >>> names_from_flags(TOO_FEW | SATURATED)
    ('too_few', 'saturated')
    """
    return tuple(flag.name for flag in REGISTRY if int(flags) & flag.value)


def count_flags(flags: ArrayLike) -> dict[str, int]:
    """How many elements carry each bit.

    Parameters
    ----------
    flags : array of int
        Of any shape.

    Returns
    -------
    dict of str to int
        By short name; bits that none carries are left out.
    """
    words = np.asarray(flags, dtype=np.uint32)
    counted = {flag.name: int(np.count_nonzero(words & flag.value)) for flag in REGISTRY}
    return {name: n for name, n in counted.items() if n}


def is_usable(flags: ArrayLike) -> NDArray[np.bool_]:
    """Whether no excluding bit is set.

    Parameters
    ----------
    flags : array of int
        Of any shape.

    Returns
    -------
    array of bool
        Of the same shape.
    """
    words = np.asarray(flags, dtype=np.uint32)
    usable: NDArray[np.bool_] = (words & np.uint32(EXCLUDING)) == 0
    return usable
