"""From a simulated recording to a path with error bars, in one page of Python.

python examples/first_path.py -o out/first
"""

from __future__ import annotations

import argparse
from pathlib import Path

import lightflight as lf
from lightflight import view
from lightflight.simulate import paper_scene


def main() -> None:
    """Simulate, calibrate, reconstruct, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photons", type=float, default=40_000.0, help="in the brightest pixel")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/first"))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)

    scene = paper_scene()
    recording = lf.simulate(scene, photons_per_pixel=args.photons, seed=4)
    bright = lf.simulate(scene, photons_per_pixel=4e6, seed=2, kind="code_density")
    flat = lf.simulate(scene, photons_per_pixel=4e5, seed=3, kind="flat")

    timing = lf.calibrate_timing(
        bright, flat=flat, flat_arrival_ps=flat.truth.flat_arrival_ps, dead_codes="absorbed"
    )
    # The scene's camera, and how well a calibrated one is known.
    camera = lf.Camera.facing_plane(
        center_mm=(187.5, 37.5),
        position_std_mm=0.5,
        rotation_std_deg=0.05,
        field_of_view_std_mm=0.1,
    )
    path = lf.reconstruct(recording, camera=camera, source=scene.source, timing=timing)

    print(path.verdict.headline)
    for k, (place, std) in enumerate(zip(path.vertices_mm, path.vertex_std, strict=True)):
        x, y, z = (f"{v:8.2f} ± {s:.2f}" for v, s in zip(place, std[:3], strict=True))
        print(f"vertex {k}: {x} {y} {z} mm")
    error = lf.path_error(path, recording.truth, scene.camera)
    print(f"off the truth by {error.position_rms_mm:.3f} mm and {error.event_time_rms_ps:.3f} ps")
    figure = view.demo_figure(path, arrivals=lf.find_arrivals(recording, timing=timing))
    view.write_figure(figure, args.output / "path.png")


if __name__ == "__main__":
    main()
