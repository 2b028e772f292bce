"""A second pulse that flew the same path: how much later, and with how much of the light."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lightflight.display import with_error

_FARTHEST_PS = 1e9
"""A laser of 1 kHz has no other pulse for so long."""


@dataclass(frozen=True)
class SecondPulse:
    """The same light once more: a satellite of the laser, or a reflection between two windows.

    Attributes
    ----------
    delay_ps : float
        After the pulse that the path tells of; negative: before it. Where the clock starts anew
        with each pulse of the laser, as near to zero as it may be.
    delay_std_ps : float
        One-sigma error, that of the clock's scale included, ps.
    share : float
        Its light over that of the pulse that the path tells of.
    share_std : float
        One-sigma error.
    """

    delay_ps: float
    delay_std_ps: float
    share: float
    share_std: float

    def __post_init__(self) -> None:
        for name in ("delay_ps", "delay_std_ps", "share", "share_std"):
            value = getattr(self, name)
            if type(value) not in (int, float) or not math.isfinite(value):
                raise ValueError(f"{name} of a second pulse must be a finite number, got {value!r}")
        if not (self.share > 0.0 and self.share_std >= 0.0 and self.delay_std_ps >= 0.0):
            raise ValueError(f"a second pulse has light and errors of zero or more, got {self}")
        if abs(self.delay_ps) > _FARTHEST_PS:
            raise ValueError(f"delay_ps must lie within {_FARTHEST_PS:g} ps, got {self.delay_ps}")

    def __str__(self) -> str:
        share = with_error(100.0 * self.share, 100.0 * self.share_std)
        when = "later" if self.delay_ps > 0.0 else "earlier"
        return (
            f"{share} % of the light, {with_error(abs(self.delay_ps), self.delay_std_ps)} ps {when}"
        )

    @classmethod
    def from_json(cls, plain: Mapping[str, Any] | None) -> SecondPulse | None:
        """What a path file holds; None where it holds none."""
        if plain is None:
            return None
        if not isinstance(plain, Mapping) or set(plain) != set(cls.__dataclass_fields__):
            raise ValueError(f"a second pulse cannot be {plain!r:.60}")
        return cls(**plain)
