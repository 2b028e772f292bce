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
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

from lightflight._version import __version__

if TYPE_CHECKING:
    from lightflight.camera import Camera
    from lightflight.camera_calibration import calibrate_camera
    from lightflight.flight import Medium, Source
    from lightflight.histogram import Histograms
    from lightflight.path import LightPath
    from lightflight.path_error import path_error
    from lightflight.reconstruct import Bounds, bounds, find_legs, reconstruct
    from lightflight.reconstruct.laser import LaserPulse, laser_pulse
    from lightflight.reconstruct.planning import Plan, plan
    from lightflight.recording import Recording, histogram, read, write
    from lightflight.simulate import Detector, Scene, simulate
    from lightflight.timing.arrivals import Arrivals, find_arrivals
    from lightflight.timing.calibration import TimingCalibration, calibrate_timing
    from lightflight.timing.pulses import Pulses, fit_pulses
    from lightflight.view.observation import observe

_HOME_FROM_NAME = {
    "Arrivals": "timing.arrivals",
    "Bounds": "reconstruct",
    "Camera": "camera",
    "Detector": "simulate",
    "Histograms": "histogram",
    "LaserPulse": "reconstruct.laser",
    "LightPath": "path",
    "Medium": "flight",
    "Plan": "reconstruct.planning",
    "Pulses": "timing.pulses",
    "Recording": "recording",
    "Scene": "simulate",
    "Source": "flight",
    "TimingCalibration": "timing.calibration",
    "bounds": "reconstruct",
    "calibrate_camera": "camera_calibration",
    "calibrate_timing": "timing.calibration",
    "find_arrivals": "timing.arrivals",
    "find_legs": "reconstruct",
    "fit_pulses": "timing.pulses",
    "histogram": "recording",
    "laser_pulse": "reconstruct.laser",
    "observe": "view.observation",
    "path_error": "path_error",
    "plan": "reconstruct.planning",
    "read": "recording",
    "reconstruct": "reconstruct",
    "simulate": "simulate",
    "write": "recording",
}

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


def _exported(name: str) -> Any:
    """Import what the public name stands for."""
    home = importlib.import_module(f"{__name__}.{_HOME_FROM_NAME[name]}")
    return getattr(home, name)


class _CallableModule(ModuleType):
    """A submodule that shares its name with the public function: calling it calls that."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return _exported(self.__name__.rpartition(".")[2])(*args, **kwargs)

    @property
    def __signature__(self) -> Any:
        import inspect

        return inspect.signature(_exported(self.__name__.rpartition(".")[2]))


class _Package(ModuleType):
    """Package that keeps `lf.simulate(...)` working once `lightflight.simulate` is imported.

    Importing a submodule binds it in the package, over the function of the same name
    (`histogram`, `path_error`, `reconstruct`, `simulate`); such a submodule is made callable.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if type(value) is ModuleType and name in _HOME_FROM_NAME:
            value.__class__ = _CallableModule
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name not in _HOME_FROM_NAME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _exported(name)


def __dir__() -> list[str]:
    return sorted(__all__)
