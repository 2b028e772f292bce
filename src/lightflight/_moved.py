"""Modules that were elsewhere before version 0.2: they can be imported from there until 1.0."""

from __future__ import annotations

import importlib
import sys
import warnings
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

HOMES_FROM_MODULE = {
    "batch.run": ("batch.runner",),
    "camera_calibration": ("camera.calibration", "camera.boards"),
    "camera_pose": ("camera.pose",),
    "histogram": ("recording.histograms", "recording.counting"),
    "path_error": ("path.error",),
    "reconstruct.api": ("reconstruct.chain",),
    "reconstruct.planning": ("reconstruct.limits.planning",),
    "simulate.run": ("simulate.recordings",),
    "timing.arrivals": ("timing.pulses.arrivals",),
    "timing.calibration": ("timing.clock.calibration", "timing.calibrate.chain"),
    "timing.response": ("timing.clock.response", "timing.calibrate.flat_response"),
    "view.figures_fiber": ("view.figures.fiber",),
    "view.observation": ("path.second_view",),
}
"""Where the names of a module are now, without the leading `lightflight.`."""


class _StandIn(ModuleType):
    """Answers for a module that moved, and says where to."""

    def __getattr__(self, name: str) -> object:
        old = self.__name__.removeprefix("lightflight.")
        for home in HOMES_FROM_MODULE[old]:
            module = importlib.import_module(f"lightflight.{home}")
            if hasattr(module, name) and not name.startswith("__"):
                text = f"{self.__name__} has moved: import {name} from lightflight.{home}"
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                return getattr(module, name)
        raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")


class _CallableStandIn(_StandIn):
    """Answers for a public function too, which the import of a module of its name hides."""

    def __call__(self, *args: object, **kwargs: object) -> Any:
        package = importlib.import_module("lightflight")
        return package.__getattr__(self.__name__.rpartition(".")[2])(*args, **kwargs)


class _Finder:
    """Finds the modules of `HOMES_FROM_MODULE`, after every ordinary one.

    A finder and a loader by its methods alone: `importlib.abc` would load `tempfile`, `random` and
    more with every `import lightflight`.
    """

    def find_spec(self, fullname: str, path: object, target: object = None) -> ModuleSpec | None:
        known = fullname.removeprefix("lightflight.") in HOMES_FROM_MODULE
        if not (fullname.startswith("lightflight.") and known):
            return None
        return ModuleSpec(fullname, self)  # type: ignore[arg-type]  # a Loader by its methods

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        function = spec.name in ("lightflight.histogram", "lightflight.path_error")
        return (_CallableStandIn if function else _StandIn)(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Nothing: names are looked for when they are asked for."""


def answer_for_moved_modules() -> None:
    """Let `import` find what `HOMES_FROM_MODULE` lists."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        # Last: a module that is there goes before the answer for one that moved.
        sys.meta_path.append(_Finder())
