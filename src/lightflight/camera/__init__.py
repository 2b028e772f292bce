"""The camera: which ray each pixel looks along, how its place is found.

- the record and its projection: `model` (`Camera`); its distortion: `lens`, its place and turn:
  `rigid`
- a camera from points of known place: `calibration` (`calibrate_camera`), solved by `fit` from
  the first answers of `pose`
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.camera.calibration import calibrate_camera as calibrate_camera
    from lightflight.camera.model import Camera as Camera


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.camera.calibration": ("calibrate_camera",),
        "lightflight.camera.model": ("Camera",),
    },
)
