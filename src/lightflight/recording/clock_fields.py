"""How codes are read as times: the fields that `Recording` and `Histograms` share, and their rules.

What each means stands with the records; files keep them under these names.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lightflight.arguments import POSITIVE, finite_number, whole_number, yes_or_no

CLOCK_FIELDS = (
    "bin_width_ps",
    "laser_period_ps",
    "n_frames",
    "periods_per_frame",
    "reversed_codes",
    "first_edge_ps",
    "no_photon_code",
)
"""Names of the fields, in the order in which they are kept and shown."""


def clock_fields_of(record: object) -> dict[str, Any]:
    """The clock's fields of a `Recording` or `Histograms`, by name."""
    return {name: getattr(record, name) for name in CLOCK_FIELDS}


def check_clock_fields(clock: Mapping[str, Any], *, n_codes: int) -> None:
    """Raise ValueError where the clock's fields cannot be those of `n_codes` codes.

    Parameters
    ----------
    clock : mapping of str
        All of `CLOCK_FIELDS`.
    n_codes : int
        Number of TDC codes.

    Raises
    ------
    ValueError
        For a width, period or number that is not positive and finite, a number of frames that is
        not whole, reversed codes without a period, and a `no_photon_code` that is no code.
    """
    for name in ("bin_width_ps", "laser_period_ps", "n_frames", "periods_per_frame"):
        value = clock[name]
        if value is not None:
            finite_number(name, value, "be positive and finite", low=POSITIVE)
    for name in ("n_frames", "periods_per_frame"):
        value = clock[name]
        if value is not None and value != int(value):
            raise ValueError(f"{name} must be a whole number, got {value}")
    finite_number("first_edge_ps", clock["first_edge_ps"])
    if yes_or_no("reversed_codes", clock["reversed_codes"]) and clock["laser_period_ps"] is None:
        raise ValueError(
            "reversed_codes=True needs laser_period_ps: reversed codes count back from the "
            "next laser pulse"
        )
    code = clock["no_photon_code"]
    if code is not None and not 0 <= whole_number("no_photon_code", code) < n_codes:
        raise ValueError(f"no_photon_code = {code} is not one of the {n_codes} codes")
