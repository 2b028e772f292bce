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
    from lightflight.simulate.detector import Detector, PixelDefects
    from lightflight.simulate.mirrors import Mirror, dust, vertices_from_mirrors
    from lightflight.simulate.presets import angle_scene, ideal, paper_scene, pf32, spad256, streak
    from lightflight.simulate.recordings import simulate
    from lightflight.simulate.scene import Scene
    from lightflight.simulate.truth import Truth

__all__ = [
    "Detector",
    "Mirror",
    "PixelDefects",
    "Scene",
    "Truth",
    "angle_scene",
    "dust",
    "ideal",
    "paper_scene",
    "pf32",
    "simulate",
    "spad256",
    "streak",
    "vertices_from_mirrors",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Detector": "lightflight.simulate.detector",
        "Mirror": "lightflight.simulate.mirrors",
        "PixelDefects": "lightflight.simulate.detector",
        "Scene": "lightflight.simulate.scene",
        "Truth": "lightflight.simulate.truth",
        "angle_scene": "lightflight.simulate.presets",
        "dust": "lightflight.simulate.mirrors",
        "ideal": "lightflight.simulate.presets",
        "paper_scene": "lightflight.simulate.presets",
        "pf32": "lightflight.simulate.presets",
        "simulate": "lightflight.simulate.recordings",
        "spad256": "lightflight.simulate.presets",
        "streak": "lightflight.simulate.presets",
        "vertices_from_mirrors": "lightflight.simulate.mirrors",
    },
)
