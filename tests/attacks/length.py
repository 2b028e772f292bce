"""How long the attacks last: quick with the suite, at length by `make attack`."""

from __future__ import annotations

import os


def at_length(quick: int, long: int) -> int:
    """One number for the suite, another one for `make attack`."""
    return long if os.environ.get("LIGHTFLIGHT_ATTACK") == "long" else quick
