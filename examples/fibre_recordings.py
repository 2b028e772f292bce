"""A light pulse in a scattering fibre, as a streak camera of another laboratory saw it.

    python examples/fibre_recordings.py lift_derived.h5 -o out/fibre

The recordings are not part of this project: `lift_derived.h5` is made from the data of Feng and
Gao, Nature Communications 12, 2179 (2021). They hold (t, y, x) cubes of scaled intensities; nobody
wrote down the time per row or the camera's distance. The chain therefore stops at the legs in the
picture (u, v, t_a); with both assumed it goes on to a path, and says that it rests on them.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

import lightflight as lf
from lightflight.view.figures.fiber import fiber_figure

RECORDINGS = ("LinearFiber", "LinearFiber_vertical", "CurveFiber")

ASSUMED_BIN_WIDTH_PS = 1.5  # sweeps of 1 and 2 ns over 1,016 rows would be 0.98 and 1.97
ASSUMED_DISTANCE_MM = 400.0
ASSUMED_FIELD_MM = (60.0, 60.0)
FIBRE = lf.Medium(path_group_index=1.47, return_group_index=1.00027)
LAID_IN_AN_ARCH = ("CurveFiber",)
"""Of these it is known that one fibre runs on one smooth curve."""


@dataclass(frozen=True)
class Track:
    """The pulse's place as seven views of the same recording give it, by other means."""

    row: np.ndarray
    """(n,), row of the cube (time), where at least six views agree to 2 px."""
    uv: np.ndarray
    """(n, 2), cell column and row of the cube."""
    cell_px: float
    """Width of a cell, slit pixels."""


def read_track(file: Path, name: str) -> Track:
    """Seven-view track of one recording, in cells of its cube."""
    with h5py.File(file) as data:
        group = data[name]
        axis, first = group["cube_axis_px"][:], int(group.attrs["row0"])
        x, y, _, rms, views = group["track_X_Y_s_rms_nviews"][:].T
    good = (views >= 6) & (rms < 2.0)
    cell = float(axis[1] - axis[0])
    uv = np.column_stack(((x - axis[0]) / cell, (y - axis[0]) / cell))
    return Track(np.flatnonzero(good) - first, uv[good], cell)


def legs_in_picture(file: Path, name: str) -> tuple[lf.Histograms, lf.Arrivals, tuple]:
    """Recording, pulses and legs without any scale: u, v in cells, t_a in rows of the sweep."""
    hist = lf.read(file, dataset=f"{name}/cube_t_y_x", axes="tyx", poisson=False)
    arrivals = lf.find_arrivals(hist)
    return hist, arrivals, lf.find_legs(arrivals, computed_cube=True)


def distance_to_legs_px(track: Track, legs: tuple) -> np.ndarray:
    """Distance of every point of the track from the nearest leg, slit pixels."""
    distances = []
    for leg in legs:
        offset = track.uv - leg.origin_px
        along = np.clip(offset @ leg.direction_px, *leg.extent_px)
        distances.append(np.hypot(*(offset - along[:, np.newaxis] * leg.direction_px).T))
    return np.min(distances, axis=0) * track.cell_px


def path_on_assumptions(file: Path, name: str) -> lf.LightPath:
    """The path in space, resting on an assumed time per row and camera distance."""
    hist = lf.read(
        file,
        dataset=f"{name}/cube_t_y_x",
        axes="tyx",
        poisson=False,
        bin_width_ps=ASSUMED_BIN_WIDTH_PS,
    )
    camera = lf.Camera.facing_plane(
        shape=hist.shape, distance_mm=ASSUMED_DISTANCE_MM, field_of_view_mm=ASSUMED_FIELD_MM
    )
    told = {"n_legs": 1, "free": ("bend",)} if name in LAID_IN_AN_ARCH else {}
    return lf.reconstruct(hist, camera=camera, source=lf.Source(), medium=FIBRE, **told)


def distance_to_path_px(track: Track, path: lf.LightPath) -> np.ndarray:
    """Distance of every point of the track from the picture of the path, slit pixels."""
    times_ps = np.linspace(*path.vertex_times_ps[[0, -1]], 2000)
    row, col = path.camera.pixels_from_points(path.position_at(times_ps))
    away = track.uv[:, np.newaxis] - np.column_stack((col, row))
    return np.hypot(away[..., 0], away[..., 1]).min(axis=1) * track.cell_px


def main() -> None:
    """Legs, figures and assumed paths of all three recordings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="lift_derived.h5")
    parser.add_argument("--only", choices=RECORDINGS, help="one of the three recordings")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/fibre"))
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    for name in [args.only] if args.only else RECORDINGS:
        hist, arrivals, legs = legs_in_picture(args.file, name)
        track = read_track(args.file, name)
        distance = np.median(distance_to_legs_px(track, legs))
        print(f"\n{name}: {len(legs)} leg(s), median {distance:.2f} px from the seven-view track")
        for number, leg in enumerate(legs, start=1):
            speed = leg.apparent_speed_px_per_ps * track.cell_px * leg.direction_px
            print(
                f"  leg {number}: {leg.n_pixels} cells, rows {leg.span_ps[0]:.0f} to "
                f"{leg.span_ps[1]:.0f}, apparent speed {speed[0]:+.3f}, {speed[1]:+.3f} px per row"
            )
        print(
            "  no positions in mm: the time per row and the camera's distance are not known; give "
            "bin_width_ps and a camera to go on"
        )
        figure = fiber_figure(
            hist,
            arrivals,
            legs,
            np.column_stack((track.row, track.uv)),
            headline=name,
            track_name="seven-view track",
        )
        figure.savefig(args.output / f"{name}.png", dpi=160)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            path = path_on_assumptions(args.file, name)
        print(
            f"  assuming {ASSUMED_BIN_WIDTH_PS} ps per row and {ASSUMED_DISTANCE_MM:g} mm: "
            f"{path.n_legs} leg(s), {len(path.bends)} bent, "
            + ", ".join(f"{leg.angle_deg:+.0f}°" for leg in path.legs)
            + f", median {np.median(distance_to_path_px(track, path)):.2f} px from the track"
        )
        for statement in path.statements:
            print(f"    {statement}")


if __name__ == "__main__":
    main()
