"""`n_legs` told, corners in the picture: another path than untold, or none, in two of three."""

import numpy as np
import pytest

import lightflight as lf
from lightflight.simulate.presets import ideal

SIZES = (32, 48, 64, 96)
HALF_MM, FAR_MM = 122.5, 535.0


def in_picture(points):
    return points[:, :2] / (FAR_MM - points[:, 2:]) * FAR_MM


def turns_deg(points):
    steps = np.diff(points, axis=0)
    units = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip(np.sum(units[1:] * units[:-1], axis=1), -1.0, 1.0)))


def scene_of(seed):
    """2 to 4 legs of 60 mm or more in the picture, source and exit outside, all corners inside."""
    rng = np.random.default_rng([88, seed])
    n_pixels, n_legs = SIZES[seed % 4], 2 + int(rng.integers(3))
    while True:
        drawn = []
        for k in range(n_legs + 1):
            if k in (0, n_legs):
                around, ring = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(1.45, 1.9)
                seen = ring * np.array([np.cos(around), np.sin(around)])
            else:
                seen = rng.uniform(-0.8, 0.8, 2)
            z = rng.uniform(-60.0, 60.0)
            drawn.append([*(seen * HALF_MM * (FAR_MM - z) / FAR_MM), z])
        vertices = np.array(drawn)
        picture = in_picture(vertices)
        turns, seen_turns = turns_deg(vertices), turns_deg(picture)
        apart = np.linalg.norm(np.diff(picture, axis=0), axis=1)
        clear = (turns > 15).all() and (turns < 165).all() and (apart > 60).all()
        if clear and (seen_turns > 10).all() and (seen_turns < 165).all():
            break
    camera = lf.Camera.facing_plane((n_pixels, n_pixels), distance_mm=FAR_MM)
    source = lf.Source(vertices[0], emission_time_ps=2000.0, pulse_fwhm_ps=68.0)
    detector = ideal(psf_std_px=0.35, active_width_px=0.122)
    return lf.Scene(vertices, camera=camera, source=source, detector=detector)


@pytest.mark.parametrize(
    "seed",
    [
        0,  # refused when told
        pytest.param(9, marks=pytest.mark.long),  # another number than told, or another path
        pytest.param(3, marks=pytest.mark.long),  # of 96 x 96 pixels
        # A first leg of 7 pixels, whose light the second one took.
        pytest.param(10, marks=pytest.mark.long),
        # A first leg of 4 pixels, found as one with the second.
        pytest.param(44, marks=pytest.mark.long),
        pytest.param(53, marks=pytest.mark.long),  # one leg found as two that lie in line
        # A line off its pixels, bright by exp(400): "arange: cannot compute length".
        pytest.param(212, marks=pytest.mark.long),
    ],
)  # fmt: skip
# Of eighty paths that are right, one will be "check": that is not asked here.
@pytest.mark.usefixtures("unexamined")
def test_told_is_untold_is_the_truth(seed):
    scene = scene_of(seed)
    hist = lf.simulate(scene, photons_per_pixel=40_000, seed=seed)
    clock = lf.TimingCalibration.nominal(hist)
    n_legs = len(scene.vertices_mm) - 1
    for told in (None, n_legs):
        path = lf.reconstruct(
            hist, camera=scene.camera, source=scene.source, timing=clock, n_legs=told
        )
        assert path.n_legs == n_legs
        # The exit from view lies short of the scene's end.
        miss = np.linalg.norm(path.vertices_mm[:-1] - scene.vertices_mm[:-1], axis=1)
        assert miss.max() < 1.5
