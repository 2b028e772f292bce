"""One pulse, three cameras: what each would see of the same path, and when.

python examples/three_cameras.py -o out/cameras.png
"""

from __future__ import annotations

import argparse
from pathlib import Path

from matplotlib.figure import Figure

import lightflight as lf
from lightflight import view
from lightflight.simulate import paper_scene
from lightflight.view.style import time_colormap

PLACES_MM = {
    "in front": (187.5, 37.5, 535.0),
    "beyond the first mirror": (900.0, 40.0, 30.0),
    "behind, and above": (100.0, 500.0, -500.0),
}


def main() -> None:
    """Draw the arrival times that each camera would record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pixels", type=int, default=64, help="of each camera, along each side")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/cameras.png"))
    args = parser.parse_args()
    args.output.parent.mkdir(parents=True, exist_ok=True)

    scene = paper_scene()
    with view.figure_style():
        figure = Figure(figsize=(9.0, 3.2), layout="constrained")
        for ax, (name, place) in zip(figure.subplots(1, 3), PLACES_MM.items(), strict=True):
            camera = view.camera_towards(scene, place, shape=(args.pixels, args.pixels))
            seen = lf.observe(scene, camera)
            times = seen.arrival_image() - seen.arrival_ps.min()
            drawn = ax.imshow(times, cmap=time_colormap())
            figure.colorbar(drawn, ax=ax, label="arrival time (ps)", shrink=0.8)
            ax.set(title=name, xlabel="column", ylabel="row")
            span = seen.arrival_ps.max() - seen.arrival_ps.min()
            print(f"{name}: the flight seems to last {span:.0f} ps")
    view.write_figure(figure, args.output)


if __name__ == "__main__":
    main()
