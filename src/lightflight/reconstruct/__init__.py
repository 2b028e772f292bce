"""Reconstruction: from arrival times and counts to the path (x, y, z, t).

The way of the data: `legs` (straight pieces in the picture) -> `start` (a first path) -> `picture`
and `lateral` (lines, spot and brightness from the counts) -> `joint` (one weighted fit over
`geometry`, by `least_squares` within a `freedom`) -> `result` (a LightPath). Beside it stand
`paper` (the literal baseline), `photon` over `forward` (the likelihood of all counts), and
`cramer_rao` (what the photons allow, and what they leave open). `api` holds the public door.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightflight.reconstruct.api import reconstruct
    from lightflight.reconstruct.cramer_rao import Bounds, bounds
    from lightflight.reconstruct.legs import ImageLeg, find_legs

__all__ = ["Bounds", "ImageLeg", "bounds", "find_legs", "reconstruct"]

_HOME_FROM_NAME = {
    "Bounds": "cramer_rao",
    "ImageLeg": "legs",
    "bounds": "cramer_rao",
    "find_legs": "legs",
    "reconstruct": "api",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME_FROM_NAME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    return getattr(importlib.import_module(f"{__name__}.{_HOME_FROM_NAME[name]}"), name)
