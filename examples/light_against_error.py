"""How the error falls with the light: what the photons allow, and what `joint` reaches.

python examples/light_against_error.py -o out/light.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import lightflight as lf
from lightflight import view
from lightflight.simulate import ideal, paper_scene


def rms_error_mm(scene: lf.Scene, photons: float, repeats: int) -> float:
    """Position error, rms, of `joint` over some recordings, mm, in view."""
    timing = None
    squares = []
    for seed in range(repeats):
        hist = lf.simulate(scene, photons_per_pixel=photons, seed=seed)
        timing = timing or lf.TimingCalibration.nominal(hist)  # an ideal clock needs no other
        path = lf.reconstruct(hist, camera=scene.camera, source=scene.source, timing=timing)
        squares.append(lf.path_error(path, hist.truth, scene.camera).position_rms_mm ** 2)
    return float(np.sqrt(np.mean(squares)))


def main() -> None:
    """Draw error against photons."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=8, help="recordings per light level")
    parser.add_argument("--levels", type=int, default=5, help="light levels")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/light.png"))
    args = parser.parse_args()
    args.output.parent.mkdir(parents=True, exist_ok=True)

    scene = paper_scene(ideal())
    levels = np.geomspace(1_000.0, 100_000.0, args.levels)
    limit = [lf.bounds(scene, photons_per_pixel=level).position_rms_mm for level in levels]
    reached = [rms_error_mm(scene, level, args.repeats) for level in levels]
    for level, bound, error in zip(levels, limit, reached, strict=True):
        print(f"{level:8.0f} photons: limit {bound:.3f} mm, joint {error:.3f} mm")

    with view.figure_style():
        figure = Figure(figsize=(5.0, 3.4), layout="constrained")
        ax = figure.subplots()
        ax.loglog(levels, limit, "-", label="limit of the photons")
        ax.loglog(levels, reached, "o", label=f"joint, {args.repeats} recordings each")
        ax.set(xlabel="photons in the brightest pixel", ylabel="position in view, rms (mm)")
        ax.legend()
    view.write_figure(figure, args.output)


if __name__ == "__main__":
    main()
