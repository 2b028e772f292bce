"""Number of legs told, untold and true: scenes with all corners in the picture.

    python benchmarks/told_legs.py                      # 40 recordings
    python benchmarks/told_legs.py --first 400 --runs 100

Scenes are those of `tests/issues/test_told_numbers_of_legs_gave_other_paths.py`: 2 to 4 legs, 32 to
96 pixels, 40,000 photons a pixel. Printed: what is not right (number of legs, or a corner more than
1.5 mm off), one by one, and how many are right both told and untold.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

import numpy as np

import lightflight as lf

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.issues.test_told_numbers_of_legs_gave_other_paths import scene_of

FARTHEST_MM = 1.5


def what_is_wrong(seed: int, *, told: bool) -> str:
    """Nothing, or a few words."""
    scene = scene_of(seed)
    n_legs = len(scene.vertices_mm) - 1
    hist = lf.simulate(scene, photons_per_pixel=40_000, seed=seed)
    try:
        path = lf.reconstruct(
            hist,
            camera=scene.camera,
            source=scene.source,
            timing=lf.TimingCalibration.nominal(hist),
            n_legs=n_legs if told else None,
        )
    except (ValueError, RuntimeError) as refused:
        return f"{type(refused).__name__}: {refused}"
    if path.n_legs != n_legs:
        return f"{path.n_legs} legs for {n_legs}, {path.verdict.level}"
    # The exit from view lies short of the scene's end.
    off = np.linalg.norm(path.vertices_mm[:-1] - scene.vertices_mm[:-1], axis=1).max()
    return f"{off:.2f} mm off, {path.verdict.level}" if off >= FARTHEST_MM else ""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=200, help="first seed")
    parser.add_argument("--runs", type=int, default=40, help="recordings")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    right = 0
    for seed in range(given.first, given.first + given.runs):
        wrong = {told: what_is_wrong(seed, told=told) for told in (True, False)}
        for told, words in wrong.items():
            if words:
                print(f"{seed} {'told' if told else 'untold'}: {words}", flush=True)
        right += not any(wrong.values())
    print(f"right told and untold: {right} of {given.runs}")


if __name__ == "__main__":
    main()
