"""Legs: straight pieces of the picture along which the pulse flew.

- `find` (`find_legs`, `ImageLeg`), on the search of plain arrays in `search`; `cut`
- which way times run: `curves`, `bend`, `direction`; light that is no flight: `ghosts`
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.reconstruct.legs.find import (
        ImageLeg,
        find_legs,
        image_leg,
        is_flash,
        legs_in_turn,
        unwrapped_arrivals,
        without_dim_legs,
    )

__all__ = [
    "ImageLeg",
    "find_legs",
    "image_leg",
    "is_flash",
    "legs_in_turn",
    "unwrapped_arrivals",
    "without_dim_legs",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "ImageLeg": "lightflight.reconstruct.legs.find",
        "find_legs": "lightflight.reconstruct.legs.find",
        "image_leg": "lightflight.reconstruct.legs.find",
        "is_flash": "lightflight.reconstruct.legs.find",
        "legs_in_turn": "lightflight.reconstruct.legs.find",
        "unwrapped_arrivals": "lightflight.reconstruct.legs.find",
        "without_dim_legs": "lightflight.reconstruct.legs.find",
    },
    moved={
        "along_across": "lightflight.reconstruct.model.image_plane",
        "mean_focal_px": "lightflight.reconstruct.model.image_plane",
        "undistorted_px": "lightflight.reconstruct.model.image_plane",
    },
)
