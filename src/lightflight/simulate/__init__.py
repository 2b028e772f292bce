"""The digital twin: from a scene to what the camera would have written.

Scene and detector: `Scene`, `Detector`; ready-made ones: `paper_scene`, `angle_scene`; `ideal`,
`pf32`, `spad256`, `streak`. Paths and air: `Mirror`, `vertices_from_mirrors`, `dust`.
Recording: `simulate`, which attaches a `Truth`.

Shares camera, flight and path constants with `reconstruct`, and nothing else: light is drawn
photon by photon here and computed as a mean there.
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.simulate.detector import Detector as Detector, PixelDefects as PixelDefects
    from lightflight.simulate.mirrors import (
        Mirror as Mirror,
        dust as dust,
        vertices_from_mirrors as vertices_from_mirrors,
    )
    from lightflight.simulate.presets import (
        angle_scene as angle_scene,
        ideal as ideal,
        paper_scene as paper_scene,
        pf32 as pf32,
        spad256 as spad256,
        streak as streak,
    )
    from lightflight.simulate.recordings import simulate as simulate
    from lightflight.simulate.scene import Scene as Scene
    from lightflight.simulate.truth import Truth as Truth


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.simulate.detector": ("Detector", "PixelDefects"),
        "lightflight.simulate.mirrors": ("Mirror", "dust", "vertices_from_mirrors"),
        "lightflight.simulate.presets": (
            "angle_scene",
            "ideal",
            "paper_scene",
            "pf32",
            "spad256",
            "streak",
        ),
        "lightflight.simulate.recordings": ("simulate",),
        "lightflight.simulate.scene": ("Scene",),
        "lightflight.simulate.truth": ("Truth",),
    },
)
