"""Legs: straight pieces of the picture along which the pulse flew.

- `find` (`find_legs`, `ImageLeg`), on the search of plain arrays in `search`; `cut`
- which way times run: `curves`, `bend`, `direction`; light that is no flight: `ghosts`
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.reconstruct.legs.find import (
        ImageLeg as ImageLeg,
        find_legs as find_legs,
        image_leg as image_leg,
        is_flash as is_flash,
        legs_in_turn as legs_in_turn,
        unwrapped_arrivals as unwrapped_arrivals,
        without_dim_legs as without_dim_legs,
    )


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.reconstruct.legs.find": (
            "ImageLeg",
            "find_legs",
            "image_leg",
            "is_flash",
            "legs_in_turn",
            "unwrapped_arrivals",
            "without_dim_legs",
        ),
    },
    moved={
        "along_across": "lightflight.reconstruct.model.image_plane",
        "mean_focal_px": "lightflight.reconstruct.model.image_plane",
        "undistorted_px": "lightflight.reconstruct.model.image_plane",
    },
)
