"""From the photons of a SPAD camera to the 4D path (x, y, z, t) of a laser pulse.

Records: `Histograms`, `Recording`, `TimingCalibration`, `Pulses`, `Arrivals`, `Camera`,
`Source`, `Medium`, `LightPath`, `LaserPulse`, `Scene`, `Detector`, `Bounds`, `Plan`.

The chain: `read` a file, `histogram` it, `calibrate_timing` and `calibrate_camera`,
`fit_pulses` or `find_arrivals`, `find_legs`, `reconstruct`; `write` keeps a record;
`laser_pulse` says how long the laser's pulse was.

Without a lab: `simulate` a `Scene`; `bounds` says what its photons allow,
`plan` what light a wanted error takes; `path_error`
compares a path with the truth; `observe` says what another camera would see of it.

Everything is loaded when it is first used (PEP 562): importing the package costs nothing.
"""

import importlib
from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names
from lightflight._moved import answer_for_moved_modules
from lightflight._version import __version__

if TYPE_CHECKING:
    from lightflight.camera.calibration import calibrate_camera
    from lightflight.camera.model import Camera
    from lightflight.flight import Medium, Source
    from lightflight.formats.registry import read, write
    from lightflight.path.error import path_error
    from lightflight.path.light_path import LightPath
    from lightflight.path.second_view import observe
    from lightflight.reconstruct.chain import reconstruct
    from lightflight.reconstruct.laser import LaserPulse, laser_pulse
    from lightflight.reconstruct.legs.find import find_legs
    from lightflight.reconstruct.limits.bounds import Bounds, bounds
    from lightflight.reconstruct.limits.planning import Plan, plan
    from lightflight.recording.counting import histogram
    from lightflight.recording.histograms import Histograms
    from lightflight.recording.recording import Recording
    from lightflight.simulate.detector import Detector
    from lightflight.simulate.recordings import simulate
    from lightflight.simulate.scene import Scene
    from lightflight.timing.calibrate.chain import calibrate_timing
    from lightflight.timing.clock.calibration import TimingCalibration
    from lightflight.timing.pulses.arrivals import Arrivals, find_arrivals
    from lightflight.timing.pulses.pulses import Pulses, fit_pulses

__all__ = [
    "Arrivals",
    "Bounds",
    "Camera",
    "Detector",
    "Histograms",
    "LaserPulse",
    "LightPath",
    "Medium",
    "Plan",
    "Pulses",
    "Recording",
    "Scene",
    "Source",
    "TimingCalibration",
    "__version__",
    "bounds",
    "calibrate_camera",
    "calibrate_timing",
    "find_arrivals",
    "find_legs",
    "fit_pulses",
    "histogram",
    "laser_pulse",
    "observe",
    "path_error",
    "plan",
    "read",
    "reconstruct",
    "simulate",
    "write",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "Arrivals": "lightflight.timing.pulses.arrivals",
        "Bounds": "lightflight.reconstruct.limits.bounds",
        "Camera": "lightflight.camera.model",
        "Detector": "lightflight.simulate.detector",
        "Histograms": "lightflight.recording.histograms",
        "LaserPulse": "lightflight.reconstruct.laser",
        "LightPath": "lightflight.path.light_path",
        "Medium": "lightflight.flight",
        "Plan": "lightflight.reconstruct.limits.planning",
        "Pulses": "lightflight.timing.pulses.pulses",
        "Recording": "lightflight.recording.recording",
        "Scene": "lightflight.simulate.scene",
        "Source": "lightflight.flight",
        "TimingCalibration": "lightflight.timing.clock.calibration",
        "bounds": "lightflight.reconstruct.limits.bounds",
        "calibrate_camera": "lightflight.camera.calibration",
        "calibrate_timing": "lightflight.timing.calibrate.chain",
        "find_arrivals": "lightflight.timing.pulses.arrivals",
        "find_legs": "lightflight.reconstruct.legs.find",
        "fit_pulses": "lightflight.timing.pulses.pulses",
        "histogram": "lightflight.recording.counting",
        "laser_pulse": "lightflight.reconstruct.laser",
        "observe": "lightflight.path.second_view",
        "path_error": "lightflight.path.error",
        "plan": "lightflight.reconstruct.limits.planning",
        "read": "lightflight.formats.registry",
        "reconstruct": "lightflight.reconstruct.chain",
        "simulate": "lightflight.simulate.recordings",
        "write": "lightflight.formats.registry",
    },
)

# Two rooms have the name of the function that they are the room of. Python binds a subpackage in
# its package once, when it is first imported: done here, and unbound again, it leaves the name to
# the function (docs/decisions/0005).
for _room in ("reconstruct", "simulate"):
    importlib.import_module(f"{__name__}.{_room}")
    del globals()[_room]
del _room

answer_for_moved_modules()
