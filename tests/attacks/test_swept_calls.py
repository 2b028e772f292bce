"""Every argument of every public call with what its name does not say, one by one.

What is wrong is said by us, of a bounded length: no exception comes out of NumPy, SciPy or the
depths of Python. Quick: a sample; at length all of them.
"""

from __future__ import annotations

import inspect
import linecache
import traceback
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from tests.attacks.length import at_length
from tests.labs import three_legs

SOURCE = Path(lf.__file__).parent
NAN, INF = float("nan"), float("inf")


class Odd:
    """Of no kind that anybody knows."""


@cache
def _bench() -> dict[str, Any]:
    """A recording with all that belongs to it."""
    lab = three_legs()
    hist = lab.recording(0, 4000.0)
    of_lab = {"camera": lab.camera, "timing": lab.timing}
    path = lf.reconstruct(hist, source=lab.timed, **of_lab)
    points = np.random.default_rng(0).uniform(-100.0, 100.0, (20, 3))
    pixels = np.column_stack(lab.camera.pixels_from_points(points))
    arrivals = lf.find_arrivals(hist, timing=lab.timing)
    few = lf.histogram(hist, rows=(12, 20), cols=(12, 20))
    scene = lf.Scene([[-50.0, 0, 0], [50.0, 0, 0]], camera=lf.Camera.facing_plane((8, 8)))
    return {
        "Camera": {
            name: getattr(lab.camera, name)
            for name in ("matrix", "distortion", "world_from_camera", "shape")
        },
        "Camera.facing_plane": {},
        "Detector": {},
        "Medium": {},
        "Source": {"position_mm": (0.0, 0.0, 0.0)},
        "Histograms": {"counts": np.ones((4, 4, 8), np.uint16)},
        "Scene": {"vertices_mm": [[-50.0, 0, 0], [50.0, 0, 0]], "camera": lab.camera},
        "bounds": {"subject": path},
        "plan": {"subject": path},
        "find_arrivals": {"hist": hist, "timing": lab.timing},
        "fit_pulses": {"hist": hist, "timing": lab.timing},
        "find_legs": {"arrivals": arrivals, "camera": lab.camera},
        "histogram": {"recording": hist},
        "laser_pulse": {"path": path, "hist": hist, "response_fwhm_ps": 100.0},
        "observe": {"path": path, "camera": lab.camera},
        "path_error": {"path": path, "truth": path, "camera": lab.camera},
        "read": {"path": "no such file"},
        "reconstruct": {"hist": hist, "source": lab.timed, **of_lab},
        "simulate": {"scene": scene, "photons_per_pixel": 10.0},
        "calibrate_timing": {"flat": few},
        "calibrate_camera": {
            "points_mm": points, "pixels": pixels, "shape": (32, 32), "focal_length_px": 60.0,
        },
    }  # fmt: skip


@cache
def _values() -> tuple[Any, ...]:
    """Of any kind, size and shape; what some arguments may well be is among them."""
    calls = _bench()
    ones = np.ones((32, 32, 64))
    return (
        True, 0, -1, 2, 10**30, 2**63, 1.5, NAN, INF, -INF, 1e308, 1e-320, "", "none", "x" * 5000,
        b"x", None, Odd(), [], [[]], [1], [1, 2], (1, 2, 3), [NAN] * 3, ["a", "b"], {}, {"a": 1},
        np.zeros(0), np.zeros((3, 3)), np.ones((4, 4), bool), np.ma.masked_equal([1, 2, 3], 2),
        np.array([1j]), np.array(["a"]), np.array([None]), np.uint64(2**64 - 1), np.float32(1),
        np.array(5), np.full((32, 32), NAN), np.ones((32, 32), np.uint8), ones, range(3), object,
        1j, calls["reconstruct"]["hist"], calls["reconstruct"]["camera"],
        calls["reconstruct"]["timing"], calls["bounds"]["subject"],
    )  # fmt: skip


def _arguments() -> list[tuple[str, str]]:
    calls = (
        "Camera", "Camera.facing_plane", "Detector", "Medium", "Source", "Histograms", "Scene",
        "bounds", "plan", "find_arrivals", "fit_pulses", "find_legs", "histogram", "laser_pulse",
        "observe", "path_error", "read", "reconstruct", "simulate", "calibrate_timing",
        "calibrate_camera",
    )  # fmt: skip
    return [
        (call, name)
        for call in calls
        for name, told in inspect.signature(_of(call)).parameters.items()
        if told.kind not in (told.VAR_KEYWORD, told.VAR_POSITIONAL)
    ]


def _of(call: str) -> Any:
    found: Any = lf
    for part in call.split("."):
        found = getattr(found, part)
    return found


def _is_ours(error: Exception) -> bool:
    """Whether it was raised on purpose, by a line of the package."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    lines = [linecache.getline(last.filename, last.lineno or 1)]
    return Path(last.filename).is_relative_to(SOURCE) and "raise " in lines[0]


@pytest.mark.parametrize(("call", "name"), _arguments())
def test_an_argument_of_another_kind_is_told(call, name):
    given, foreign = _bench()[call], []
    # A prime step: each argument of the suite's sample meets other values.
    first = sum(map(ord, call + name))
    values = _values()[first % at_length(23, 1) :: at_length(23, 1)]
    for value in values:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                _of(call)(**{**given, name: value})
            except Exception as error:  # noqa: BLE001
                # The name of a file is told whole.
                text = str(error).replace(str(value), "")
                if not _is_ours(error) or len(text) > 1000:
                    foreign.append((repr(value)[:60], repr(error)[:200]))
    assert foreign == []
