"""Three walks through the code with a value, as by a reader who looks up each function once.

One run on a small recording is traced, after a run that loads and compiles everything. Every
function of the package is noted when it is called for the first time, compiled kernels that Python
calls too (what a kernel calls is inside it). On that way a *stop* is a function in another file
than the one before, a *turn* a stop in a file that was left before: stops = files + turns.

    NUMBA_NUM_THREADS=1 python tools/walks.py  # JSON: {walk: {"stops", "files", "turns", "way"}}

The `lightflight` that Python finds is walked through; `count_lines.py` runs this with a tree of its
own. Public names alone are called, so that trees of different shape can be compared. One thread:
what runs on others is not seen.
"""

from __future__ import annotations

import json
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import lightflight as lf
from lightflight.simulate import paper_scene

_ROOT = Path(lf.__file__).parent

Place = tuple[str, str]
"""(file below the package, name of the function)."""


def walks() -> dict[str, list[Place]]:
    """Functions in the order of their first call, of each of the three walks."""
    scene = paper_scene()
    recording = lf.simulate(scene, photons_per_pixel=4e4, seed=1)
    bright = lf.simulate(scene, photons_per_pixel=4e6, seed=2, kind="code_density")
    flat = lf.simulate(scene, photons_per_pixel=4e5, seed=3, kind="flat")
    timing = lf.calibrate_timing(bright, flat=flat, dead_codes="absorbed")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "recording.h5"
        lf.write(recording, file)
        return {
            "a file to histograms": walk(lambda: lf.histogram(lf.read(file))),
            "a flat to a clock": walk(
                lambda: lf.calibrate_timing(bright, flat=flat, dead_codes="absorbed")
            ),
            "a recording to a path": walk(
                lambda: lf.reconstruct(
                    recording, camera=scene.camera, source=scene.source, timing=timing
                )
            ),
        }


def walk(call: Callable[[], Any]) -> list[Place]:
    """Functions of the package in the order of their first call, by the call's second run."""
    call()
    way: dict[Place, None] = {}

    def note(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and not frame.f_code.co_name.startswith("<"):
            _note(frame.f_code, way)

    with _kernels_noted(way):
        before = sys.getprofile()
        sys.setprofile(note)
        try:
            call()
        finally:
            sys.setprofile(before)
    return list(way)


def _note(code: CodeType, way: dict[Place, None]) -> None:
    file = Path(code.co_filename)
    if file.is_relative_to(_ROOT):
        way[file.relative_to(_ROOT).as_posix(), code.co_qualname] = None


@contextmanager
def _kernels_noted(way: dict[Place, None]) -> Iterator[None]:
    """Compiled functions stand behind Python ones that note them: a profiler does not see them."""

    def noting(kernel: Any) -> Callable[..., Any]:
        def stand_in(*args: Any, **kwargs: Any) -> Any:
            _note(kernel.py_func.__code__, way)
            return kernel(*args, **kwargs)

        return stand_in

    ours = [m for name, m in sys.modules.items() if name.partition(".")[0] == lf.__name__]
    kernels = [
        (module, name, value)
        for module in ours
        for name, value in vars(module).items()
        if hasattr(value, "py_func")
    ]
    for module, name, kernel in kernels:
        setattr(module, name, noting(kernel))
    try:
        yield
    finally:
        for module, name, kernel in kernels:
            setattr(module, name, kernel)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parent))
    from house import stops_and_turns

    report = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for label, way in walks().items():
            stops, files, turns = stops_and_turns(file for file, _ in way)
            report[label] = {
                "stops": stops, "files": files, "turns": turns, "functions": len(way),
                "way": [" ".join(place) for place in way],
            }  # fmt: skip
    print(json.dumps(report))
