"""From the photons of a SPAD camera to the 4D path (x, y, z, t) of a laser pulse.

Records: `Histograms`, `Recording`, `TimingCalibration`, `Pulses`, `Arrivals`, `Camera`,
`Interface`, `Material`, `Source`, `Medium`, `LightPath`, `LaserPulse`, `Scene`, `Detector`,
`Bounds`, `Plan`.

The chain: `read` a file, `histogram` it, `calibrate_timing` and `calibrate_camera`,
`fit_pulses` or `find_arrivals`, `find_legs`, `reconstruct`; `write` keeps a record;
`laser_pulse` says how long the laser's pulse was; `window` is what a camera looks through.

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
    from lightflight.blocks import Block as Block
    from lightflight.camera.calibration import calibrate_camera as calibrate_camera
    from lightflight.camera.model import Camera as Camera
    from lightflight.camera.refraction import Interface as Interface, window as window
    from lightflight.curves import DrawnCurve as DrawnCurve
    from lightflight.flight import Medium as Medium, Source as Source
    from lightflight.formats.registry import read as read, write as write
    from lightflight.materials import Material as Material
    from lightflight.path.error import path_error as path_error
    from lightflight.path.light_path import LightPath as LightPath
    from lightflight.path.second_view import observe as observe
    from lightflight.reconstruct.chain import reconstruct as reconstruct
    from lightflight.reconstruct.laser import LaserPulse as LaserPulse, laser_pulse as laser_pulse
    from lightflight.reconstruct.legs.find import find_legs as find_legs
    from lightflight.reconstruct.limits.bounds import Bounds as Bounds, bounds as bounds
    from lightflight.reconstruct.limits.planning import Plan as Plan, plan as plan
    from lightflight.recording.counting import histogram as histogram
    from lightflight.recording.histograms import Histograms as Histograms
    from lightflight.recording.recording import Recording as Recording
    from lightflight.simulate.detector import Detector as Detector
    from lightflight.simulate.recordings import simulate as simulate
    from lightflight.simulate.scene import Scene as Scene
    from lightflight.timing.calibrate.chain import calibrate_timing as calibrate_timing
    from lightflight.timing.clock.calibration import TimingCalibration as TimingCalibration
    from lightflight.timing.pulses.arrivals import (
        Arrivals as Arrivals,
        find_arrivals as find_arrivals,
    )
    from lightflight.timing.pulses.pulses import Pulses as Pulses, fit_pulses as fit_pulses


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.blocks": ("Block",),
        "lightflight.camera.calibration": ("calibrate_camera",),
        "lightflight.camera.model": ("Camera",),
        "lightflight.camera.refraction": ("Interface", "window"),
        "lightflight.curves": ("DrawnCurve",),
        "lightflight.flight": ("Medium", "Source"),
        "lightflight.formats.registry": ("read", "write"),
        "lightflight.materials": ("Material",),
        "lightflight.path.error": ("path_error",),
        "lightflight.path.light_path": ("LightPath",),
        "lightflight.path.second_view": ("observe",),
        "lightflight.reconstruct.chain": ("reconstruct",),
        "lightflight.reconstruct.laser": ("LaserPulse", "laser_pulse"),
        "lightflight.reconstruct.legs.find": ("find_legs",),
        "lightflight.reconstruct.limits.bounds": ("Bounds", "bounds"),
        "lightflight.reconstruct.limits.planning": ("Plan", "plan"),
        "lightflight.recording.counting": ("histogram",),
        "lightflight.recording.histograms": ("Histograms",),
        "lightflight.recording.recording": ("Recording",),
        "lightflight.simulate.detector": ("Detector",),
        "lightflight.simulate.recordings": ("simulate",),
        "lightflight.simulate.scene": ("Scene",),
        "lightflight.timing.calibrate.chain": ("calibrate_timing",),
        "lightflight.timing.clock.calibration": ("TimingCalibration",),
        "lightflight.timing.pulses.arrivals": ("Arrivals", "find_arrivals"),
        "lightflight.timing.pulses.pulses": ("Pulses", "fit_pulses"),
    },
)
__all__ += ["__version__"]

# Two rooms have the name of the function that they are the room of. Python binds a subpackage in
# its package once, when it is first imported: done here, and unbound again, it leaves the name to
# the function (docs/decisions/0005).
for _room in ("reconstruct", "simulate"):
    importlib.import_module(f"{__name__}.{_room}")
    del globals()[_room]
del _room

answer_for_moved_modules()
