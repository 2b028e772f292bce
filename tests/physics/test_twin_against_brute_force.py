"""The twin and the reconstruction's geometry against light marched step by step.

Twin, reconstruction and package flight share code; the oracle shares none with any of them.
"""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.flight import Medium, Source
from lightflight.reconstruct.model.geometry import PathState, footprints
from lightflight.simulate import Detector, Scene, simulate
from lightflight.simulate.light import expected_light, segments_from_scene
from tests.oracles.brute_force import (
    BruteCamera,
    BruteClock,
    BruteScene,
    camera_looking_at,
    camera_over_plane,
    collect,
    expected_counts,
    mean_arrivals,
)

PAPER = np.array([[0, 0, 0], [375, 25, 50], [0, 50, 10], [375, 75, 50]], dtype=float)


def package_camera(brute: BruteCamera) -> Camera:
    """The same camera in the package's (OpenCV's) words."""
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([brute.right, brute.down, brute.forward])
    pose[:3, 3] = brute.center
    matrix = np.array(
        [
            [brute.px_per_slope_col, 0.0, brute.col_of_axis],
            [0.0, brute.px_per_slope_row, brute.row_of_axis],
            [0.0, 0.0, 1.0],
        ]
    )
    return Camera(matrix, np.array([*brute.radial, 0.0, 0.0]), pose, (brute.rows, brute.cols))


def tent(length: float) -> float:
    """Brightness that rises and falls along the path, 30 % per pixel where it is steepest."""
    return float(np.exp(-(((length - 200.0) / 60.0) ** 2))) + 0.1


SETTINGS = {
    "paper, facing": (PAPER, camera_over_plane(center=(187.5, 37.5)), Medium()),
    "oblique, rolled, distorted": (
        PAPER,
        camera_looking_at(
            (420.0, 260.0, 500.0), (187.5, 37.5, 20.0), roll=0.4, radial=(-0.15, 0.03)
        ),
        Medium(),
    ),
    "fibre from behind": (
        np.array([[-150, -40, 0], [60, 80, 90], [150, -60, -80]], dtype=float),
        camera_looking_at((0.0, 50.0, -600.0), (0.0, 0.0, 0.0), roll=-1.0),
        Medium(1.47, 1.00027),
    ),
}


@pytest.mark.parametrize("name", SETTINGS)
@pytest.mark.parametrize("uneven", [False, True])
def test_light_and_time_of_every_pixel(name: str, uneven: bool) -> None:
    """Expected counts to 2e-3 of the brightest pixel, mean arrival times to 0.002 ps."""
    vertices, brute_camera, medium = SETTINGS[name]
    trial = BruteScene(
        vertices,
        brute_camera,
        BruteClock(909, 55.0, 50_000.0),
        path_index=medium.path_group_index,
        return_index=medium.return_group_index,
        blur_std_px=0.35,
        brightness=tent if uneven else None,
    )
    cube, first = collect(trial, stride=0.1, fine=0.5, nodes=7)
    scene = Scene(
        vertices,
        camera=package_camera(brute_camera),
        medium=medium,
        detector=Detector(psf_std_px=0.35, active_width_px=0.122),
        brightness=np.vectorize(tent) if uneven else None,
    )
    light = expected_light(scene, segments_from_scene(scene), np.ones((32, 32)))
    ours, theirs = light.counts.sum(axis=0), cube.sum(axis=2)
    np.testing.assert_allclose(ours / ours.max(), theirs / theirs.max(), atol=2e-3)
    moment = np.nansum(light.counts * np.nan_to_num(light.mean_arrival_ps), axis=0)
    bright = theirs > 0.02 * theirs.max()
    assert bright.sum() > 20
    gap = moment[bright] / ours[bright] - mean_arrivals(cube, first, 0.5)[bright]
    # Where two legs share a pixel, 1e-5 of either's light moves the mean by 0.01 ps.
    alone = (light.counts.max(axis=0) > 0.9999 * ours)[bright]
    assert alone.sum() > 20
    assert np.abs(gap[alone]).max() < 2e-3
    assert np.abs(gap).max() < 0.1


@pytest.mark.parametrize("reverse", [False, True])
def test_drawn_histograms_follow_the_marched_cube(reverse: bool) -> None:
    """Pearson's chi-square of the twin's counts, all codes expecting 5 or more.

    400,000 photons in the brightest pixel would show a 0.5 ps shift as 3 standard errors per
    pixel; false alarm of the bound (5 sigma of the chi-square): 6e-7.
    """
    vertices, brute_camera, medium = SETTINGS["oblique, rolled, distorted"]
    clock = BruteClock(909, 55.0, 50_000.0, reversed=reverse)
    pulse_fwhm, response_fwhm = 68.0, 150.0
    std = float(np.hypot(pulse_fwhm, response_fwhm)) / 2.3548200450309493
    trial = BruteScene(
        vertices, brute_camera, clock, emission_time=1500.0, pulse_std=std, blur_std_px=0.35
    )
    expected = expected_counts(trial, brightest=20_000.0, stride=0.1, nodes=7)
    scene = Scene(
        vertices,
        camera=package_camera(brute_camera),
        medium=medium,
        source=Source(pulse_fwhm_ps=pulse_fwhm),
        detector=Detector(
            n_codes=909, bin_width_ps=55.0, reversed_codes=reverse, response_fwhm_ps=response_fwhm
        ),
        true_emission_time_ps=1500.0,
    )
    drawn = simulate(scene, photons_per_pixel=20_000, seed=3)
    counts = np.asarray(drawn.counts, dtype=float)
    tested = expected >= 5.0
    chi2 = float(np.sum((counts[tested] - expected[tested]) ** 2 / expected[tested]))
    dof = int(tested.sum())
    assert dof > 1000
    assert abs(chi2 - dof) < 5.0 * np.sqrt(2.0 * dof)


@pytest.mark.parametrize("name", SETTINGS)
def test_footprints_of_the_fit_lie_where_light_was_marched(name: str) -> None:
    """A narrow spot: the mean arrival time of the light is that of the footprint.

    The fit's `arrival_ps` belongs to the foot; light within a tenth of a pixel of it averages
    to the same time but for curvature (< 0.1 ps) and the slant of dim outer pixels.
    """
    vertices, brute_camera, medium = SETTINGS[name]
    trial = BruteScene(
        vertices,
        brute_camera,
        BruteClock(909, 55.0, 50_000.0),
        path_index=medium.path_group_index,
        return_index=medium.return_group_index,
        blur_std_px=0.15,
        active_side_px=0.05,
        inverse_square=False,
    )
    for leg in range(len(vertices) - 1):
        alone = BruteScene(
            **{
                **trial.__dict__,
                "vertices": vertices[leg : leg + 2],
                "emission_time": trial.emission_time
                + trial.path_index
                * float(np.sum(np.linalg.norm(np.diff(vertices[: leg + 1], axis=0), axis=1)))
                / 0.299792458,
            }
        )
        cube, first = collect(alone, stride=0.05, fine=0.25, nodes=3)
        total = cube.sum(axis=2)
        # Away from corners and borders, where the spot is cut.
        rows, cols = np.nonzero(total > 0.2 * total.max())
        state = PathState(vertices, trial.emission_time)
        foot = footprints(
            state,
            camera=package_camera(brute_camera),
            medium=medium,
            legs=np.full(len(rows), leg),
            rows=rows.astype(float),
            cols=cols.astype(float),
        )
        edge = 1.5 / foot.px_per_leg
        inner = (foot.fraction > edge) & (foot.fraction < 1.0 - edge)
        assert inner.sum() >= 4
        gap = foot.arrival_ps - mean_arrivals(cube, first, 0.25)[rows, cols]
        assert np.abs(gap[inner]).max() < 0.25
