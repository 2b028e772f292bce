"""Hints that every format takes: how the codes of a file are read as times.

A file's own statements are the start; what the user says goes before them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from lightflight.errors import ConfigError

CLOCK_HINTS: Mapping[str, str] = {
    "bin_width_ps": "nominal width of one code, ps",
    "laser_period_ps": "period of the laser, ps",
    "n_frames": "frames that were recorded",
    "periods_per_frame": "laser periods in one frame",
    "reversed_codes": "true where a larger code is an earlier photon",
    "first_edge_ps": "start of code 0 after the sync (reversed: before the next sync), ps",
    "no_photon_code": "code that means no photon, or none",
}
"""Hints about the clock and what they mean; names of the fields of our records."""

_NUMBERS = ("bin_width_ps", "laser_period_ps", "first_edge_ps")
_POSITIVE = ("bin_width_ps", "laser_period_ps", "n_frames", "periods_per_frame")
_WHOLE = ("n_frames", "periods_per_frame", "no_photon_code")

PF32_BIN_WIDTH_PS = 55.0
"""Data-sheet width of one PF32 code."""

PF32_CODES = 1024
"""TDC codes of a PF32 (10 bits)."""


def checked_clock(hints: Mapping[str, Any]) -> dict[str, object]:
    """Clock hints of the right type.

    Parameters
    ----------
    hints : mapping of str
        Some of `CLOCK_HINTS`, as the user gave them.

    Returns
    -------
    dict of str
        The same with whole numbers as int; a `first_edge_ps` of None is left to the default.

    Raises
    ------
    ConfigError
        Naming the hint that is of another type.
    """
    clock = dict(hints)
    for name, value in clock.items():
        if name in _NUMBERS and not (_is_number(value) or value is None):
            raise ConfigError(f"hint {name} must be a number of ps, got {value!r}")
        if name in _POSITIVE and value is not None and not value > 0:
            raise ConfigError(f"hint {name} must be positive, got {value!r}")
        if name in _WHOLE and value is not None and (not _is_number(value) or value % 1):
            raise ConfigError(f"hint {name} must be a whole number, got {value!r}")
        if name in _WHOLE and value is not None:
            clock[name] = int(value)
        if name == "reversed_codes" and value not in (True, False):
            raise ConfigError(f"hint reversed_codes must be True or False, got {value!r}")
    if clock.get("first_edge_ps", 0.0) is None:
        del clock["first_edge_ps"]
    return clock


def _is_number(value: Any) -> bool:
    """True for what is a finite number and neither text nor truth value."""
    try:
        return not isinstance(value, str | bool) and math.isfinite(value)
    except TypeError:
        return False


def pf32_clock(
    clock: Mapping[str, object], *, laser_period_ps: float | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Clock of a PF32 in the mode where the laser is the master, and notes of what was assumed.

    Its codes count back from the next laser pulse, so without the laser period there is no time
    axis: width and direction are then left open unless the user gives them.

    Parameters
    ----------
    clock : mapping of str
        What the user said; it goes before every default.
    laser_period_ps : float, optional
        Period, ps, where the file tells it.

    Returns
    -------
    fields : dict of str
        Fields of the record.
    notes : list of str
        A sentence for each thing that was assumed.
    """
    defaults: dict[str, object] = {"no_photon_code": 0}
    notes = ["code 0 is taken as: no photon in this frame (PF32)"]
    period = clock.get("laser_period_ps", laser_period_ps)
    if period is not None:
        defaults |= {
            "laser_period_ps": period,
            "reversed_codes": True,
            "bin_width_ps": PF32_BIN_WIDTH_PS,
        }
        if clock.get("reversed_codes") is None:
            notes.append("codes are taken to run backwards from the next laser pulse (PF32)")
        if clock.get("bin_width_ps") is None:
            notes.append(f"a code is taken as {PF32_BIN_WIDTH_PS:g} ps wide (PF32 data sheet)")
    else:
        notes.append(
            "codes of a PF32 count back from the next laser pulse: give laser_period_ps to read "
            "them as times (20 MHz: laser_period_ps=50000)"
        )
    return defaults | dict(clock), notes
