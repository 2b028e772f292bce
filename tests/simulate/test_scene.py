"""Scenes: brightness, scattering, beam, mirrors, and the ready-made ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2 as chi2_law

from lightflight import Camera, Source
from lightflight.errors import GeometryError
from lightflight.lab.scene import scene_arguments
from lightflight.simulate import Scene, angle_scene, ideal, paper_scene, simulate
from lightflight.simulate.light import expected_light, segments_from_scene
from lightflight.simulate.mirrors import Mirror, dust, reflected, vertices_from_mirrors
from lightflight.simulate.scattering import (
    polarizations_from_vertices,
    rayleigh_from_directions,
    rim_of_camera,
    vignetting_from_directions,
)

CAMERA = Camera.facing_plane((16, 16), distance_mm=300.0, field_of_view_mm=(245.0, 245.0))
LEG = [(-200.0, 3.0, 0.0), (200.0, 3.0, 30.0)]
CENTER = np.array([0.0, 0.0, 300.0])


def expected(scene) -> np.ndarray:
    """Relative expected counts, all legs together."""
    efficiency = np.ones(scene.shape)
    return expected_light(scene, segments_from_scene(scene), efficiency).counts.sum(axis=0)


def seen_points(scene):
    """Mean point of the path in every lit pixel of the row of a leg, by light."""
    parts = segments_from_scene(scene)
    col = parts.col + 0.5 * parts.col_step
    start, end = np.asarray(scene.vertices_mm)
    step = (end - start) / np.linalg.norm(end - start)
    points = start + parts.length_mm[:, None] * step
    return points, col, step


# --- how bright ---------------------------------------------------------------------------


def test_forms_of_brightness_agree():
    by_function = Scene(LEG, camera=CAMERA, brightness=lambda length: 1.0 + length / 100.0)
    table = (np.array([0.0, 500.0]), np.array([1.0, 6.0]))
    by_table = Scene(LEG, camera=CAMERA, brightness=table)
    np.testing.assert_allclose(expected(by_function), expected(by_table), rtol=1e-12)
    per_leg = Scene(
        [*LEG, (200, -60, 0), (-200, -60, 0)], camera=CAMERA, brightness=[1.0, 0.0, 3.0]
    )
    alone = Scene(LEG, camera=CAMERA)
    third = Scene([(200, -60, 0), (-200, -60, 0)], camera=CAMERA)
    np.testing.assert_allclose(expected(per_leg), expected(alone) + 3.0 * expected(third))


@pytest.mark.parametrize(
    "brightness",
    [[1.0, 2.0], "bright", ([0.0, 1.0], [1.0]), ([1.0, 0.0], [1.0, 1.0]), []],
)
def test_brightness_of_no_known_form_is_refused(brightness):
    with pytest.raises(ValueError, match="brightness must be"):
        Scene(LEG, camera=CAMERA, brightness=brightness)


def test_negative_brightness_is_refused():
    scene = Scene(LEG, camera=CAMERA, brightness=lambda length: length - 200.0)
    with pytest.raises(ValueError, match="brightness must be finite and >= 0"):
        simulate(scene)


def test_inverse_square_and_rim_fall_off_go_by_the_point_seen():
    plain = Scene(LEG, camera=CAMERA, inverse_square=False)
    points, col, _ = seen_points(plain)
    near = np.array([np.average(points, axis=0, weights=np.abs(col - k) < 0.5) for k in range(16)])
    separation = CENTER - near
    distance = np.linalg.norm(separation, axis=1)
    base = expected(plain).sum(axis=0)
    square = expected(Scene(LEG, camera=CAMERA)).sum(axis=0)
    np.testing.assert_allclose(square / base, distance**-2.0, rtol=2e-3)
    dark = expected(Scene(LEG, camera=CAMERA, inverse_square=False, cos4_falloff=True)).sum(axis=0)
    np.testing.assert_allclose(dark / base, (separation[:, 2] / distance) ** 4, rtol=4e-3)


def test_rayleigh_s_law():
    angle = np.linspace(0, np.pi, 7)
    towards = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(
        rayleigh_from_directions([1.0, 0, 0], towards), 0.75 * (1 + np.cos(angle) ** 2)
    )
    np.testing.assert_allclose(
        rayleigh_from_directions([1.0, 0, 0], towards, polarization=[0, 1.0, 0]),
        1.5 * np.cos(angle) ** 2,
        atol=1e-12,
    )


@pytest.mark.parametrize("polarization", [None, [0.0, 1.0, 0.0]])
def test_rayleigh_s_law_has_mean_one(polarization):
    # Gauss-Legendre in the cosine, even steps around: exact for a quadratic
    cosine, weight = np.polynomial.legendre.leggauss(8)
    around = np.arange(8) * np.pi / 4
    sine = np.sqrt(1 - cosine**2)
    sphere = np.stack(
        [
            np.outer(cosine, np.ones(8)),
            np.outer(sine, np.cos(around)),
            np.outer(sine, np.sin(around)),
        ],
        axis=-1,
    )
    law = rayleigh_from_directions([1.0, 0, 0], sphere, polarization=polarization)
    assert (weight @ law.mean(axis=1)) / 2 == pytest.approx(1.0)


def test_rayleigh_scattering_changes_the_picture_by_its_law():
    plain = Scene(LEG, camera=CAMERA, inverse_square=False)
    points, col, step = seen_points(plain)
    near = np.array([np.average(points, axis=0, weights=np.abs(col - k) < 0.5) for k in range(16)])
    towards = (CENTER - near) / np.linalg.norm(CENTER - near, axis=1)[:, None]
    base = expected(plain).sum(axis=0)
    scene = Scene(LEG, camera=CAMERA, inverse_square=False, scattering="rayleigh")
    np.testing.assert_allclose(
        expected(scene).sum(axis=0) / base, 0.75 * (1 + (towards @ step) ** 2), rtol=3e-3
    )
    scene = Scene(
        LEG, camera=CAMERA, inverse_square=False, scattering="rayleigh", polarization=[0, 0, 2.0]
    )
    field = np.array([0, 0, 1.0]) - step[2] * step
    field /= np.linalg.norm(field)
    np.testing.assert_allclose(
        expected(scene).sum(axis=0) / base, 1.5 * (1 - (towards @ field) ** 2), rtol=0, atol=1e-3
    )


def test_polarization_is_carried_round_corners():
    fields = polarizations_from_vertices([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)], [0, 0, 1])
    directions = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    np.testing.assert_allclose(np.sum(fields * directions, axis=1), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(fields, axis=1), 1)
    np.testing.assert_allclose(fields[1], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(np.abs(fields[2]), [0, 1, 0], atol=1e-12)
    with pytest.raises(ValueError, match="along the first leg"):
        Scene(LEG, camera=CAMERA, polarization=np.subtract(LEG[1], LEG[0]))


# --- the beam -----------------------------------------------------------------------------


def test_wide_beam_looks_as_blurred_as_it_is_wide():
    # beam of 30 mm (1/e^2), camera at 300 mm from a leg at z = 0: blur and beam add in squares
    leg = [(-150.0, 0.0, 0.0), (150.0, 0.0, 0.0)]
    scene = Scene(leg, camera=CAMERA, beam_diameter_mm=30.0, detector=ideal(active_width_px=1.0))
    row = expected(scene)[:, 4:12].sum(axis=1)
    place = np.arange(16) - 7.5
    std = np.sqrt(np.average(place**2, weights=row))
    pitch = 245.0 / 16
    # depth of the beam changes its scale by 2.5 % rms: second order
    wanted = np.sqrt((30.0 / 4 / pitch) ** 2 + 0.35**2 + 1 / 12)
    assert std == pytest.approx(wanted, rel=5e-3)


@pytest.mark.parametrize("diameter", [2.0, 30.0])
def test_photons_of_a_wide_beam_follow_its_expected_light(diameter):
    scene = Scene(LEG, camera=CAMERA, beam_diameter_mm=diameter, detector=ideal())
    hist = simulate(scene, photons_per_pixel=3000.0, seed=8)
    mean = hist.truth.expected_counts
    lit = mean > 5
    chi2 = ((hist.photons - mean)[lit] ** 2 / mean[lit]).sum()
    assert chi2_law.ppf(1e-6, lit.sum()) < chi2 < chi2_law.isf(1e-6, lit.sum())
    times = np.arange(909) * 55.0 + 27.5
    bright = mean > 1000
    found = (hist.counts[bright] @ times) / hist.photons[bright]
    wanted = hist.truth.mean_arrival_ps[0][bright]
    # 1000 photons of about 75 ps: 2.4 ps
    z = (found - wanted) / (80.0 / np.sqrt(hist.photons[bright]))
    assert np.abs(z).max() < 6


def test_narrow_beam_is_a_line():
    line, thin = (Scene(LEG, camera=CAMERA, beam_diameter_mm=d) for d in (0.0, 1e-4))
    np.testing.assert_allclose(expected(line), expected(thin), rtol=1e-6, atol=1e-12)


# --- mirrors ------------------------------------------------------------------------------


def test_reflection_keeps_the_angle_to_the_normal():
    out = reflected([0.6, -0.8, 0.0], [0, 5.0, 0])
    np.testing.assert_allclose(out, [0.6, 0.8, 0.0])


def test_mirrors_of_the_paper_s_scene_give_its_path():
    vertices = np.asarray(paper_scene().vertices_mm)
    steps = np.diff(vertices, axis=0)
    directions = steps / np.linalg.norm(steps, axis=1)[:, None]
    mirrors = [
        Mirror(vertices[k + 1], directions[k + 1] - directions[k], diameter_mm=12.7) for k in (1, 0)
    ]
    traced = vertices_from_mirrors(
        vertices[0],
        direction=3.0 * directions[0],
        mirrors=mirrors,
        exit_length_mm=float(np.linalg.norm(steps[2])),
    )
    np.testing.assert_allclose(traced, vertices, atol=1e-9)


def test_pulse_in_a_cavity_goes_back_and_forth():
    mirrors = [Mirror((0, 0, 0), (1, 0, 0)), Mirror((100, 0, 0), (1, 0, 0))]
    traced = vertices_from_mirrors(
        (50, 0, 0), direction=(1, 0.1, 0), mirrors=mirrors, exit_length_mm=10.0, most_reflections=4
    )
    np.testing.assert_allclose(traced[1:5, 0], [100, 0, 100, 0], atol=1e-9)
    np.testing.assert_allclose(traced[1:5, 1], [5, 15, 25, 35], atol=1e-9)
    assert np.linalg.norm(traced[5] - traced[4]) == pytest.approx(10.0)


def test_small_mirror_is_missed():
    small = Mirror((100, 0, 0), (1, 0, 0), diameter_mm=5.0)
    with pytest.raises(GeometryError, match="meets none of the mirrors"):
        vertices_from_mirrors((0, 20, 0), direction=(1, 0, 0), mirrors=[small], exit_length_mm=5.0)
    straight = vertices_from_mirrors((0, 0, 0), direction=(0, 2, 0), mirrors=[], exit_length_mm=5.0)
    np.testing.assert_allclose(straight, [(0, 0, 0), (0, 5, 0)])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Mirror((0, 0, 0), (0, 0, 0)), "normal must be"),
        (lambda: Mirror((0, 0), (0, 0, 1)), "point_mm must be"),
        (lambda: Mirror((0, 0, 0), (0, 0, 1), diameter_mm=0.0), "diameter_mm must be"),
        (lambda: vertices_from_mirrors((0, 0, 0), direction=(0, 0, 0), mirrors=[],
                                       exit_length_mm=1.0), "direction must be"),
        (lambda: vertices_from_mirrors((0, 0, 0), direction=(1, 0, 0), mirrors=[],
                                       exit_length_mm=-1.0), "exit_length_mm must be"),
        (lambda: dust(0, contrast=-1.0), "dust needs"),
    ],
)  # fmt: skip
def test_mirrors_that_cannot_be(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_dust_wanders_as_much_as_asked_and_is_repeatable():
    # 20 km of path hold 1000 correlation lengths of 20 mm: 3 % on the spread, 6 % allowed twice
    length = np.arange(0.0, 20_000.0, 5.0)
    log = np.log(dust(3, contrast=0.3, correlation_mm=20.0)(length))
    assert log.std() == pytest.approx(0.3, rel=0.12)
    np.testing.assert_array_equal(log, np.log(dust(3, contrast=0.3, correlation_mm=20.0)(length)))
    assert (np.log(dust(4, contrast=0.3, correlation_mm=20.0)(length)) != log).any()
    centred = (log - log.mean()) / log.std()
    assert np.mean(centred[:-4] * centred[4:]) == pytest.approx(np.exp(-0.5), abs=0.15)


# --- ready-made scenes --------------------------------------------------------------------


def test_paper_scene_has_the_stated_rms_of_arrival_against_propagation_time():
    # 174 to 176 ps over the whole path, arrival times from zero (the paper: 174.80)
    scene = paper_scene()
    vertices, times = np.asarray(scene.vertices_mm), scene.vertex_times_ps
    t = np.linspace(times[0], times[-1], 20_001)
    points = np.stack([np.interp(t, times, vertices[:, k]) for k in range(3)], axis=1)
    separation = np.linalg.norm(points - [187.5, 37.5, 535.0], axis=1)
    arrival = t + 1.00027 * separation / 0.299792458
    difference = (arrival - arrival[0]) - (t - t[0])
    assert 174.0 < np.sqrt(np.mean(difference**2)) < 176.0


def test_vertices_of_the_paper_s_scene_lie_outside_the_field():
    scene = paper_scene()
    assert not scene.camera.sees(np.asarray(scene.vertices_mm)).any()


@pytest.mark.parametrize("angle_deg", [-80.0, -10.0, 0.0, 10.0, 60.0, 85.0])
def test_angle_scene_is_at_its_angle_through_the_middle(angle_deg):
    scene = angle_scene(angle_deg)
    start, end = np.asarray(scene.vertices_mm)
    step = (end - start) / np.linalg.norm(end - start)
    assert np.rad2deg(np.arcsin(step @ scene.camera.backward_axis)) == pytest.approx(angle_deg)
    np.testing.assert_allclose(start, [-65.0, 0.0, 0.0])
    assert scene.source.position_mm == (-65.0, 0.0, 0.0)
    row, _ = scene.camera.pixels_from_points(np.linspace(start, end, 5))
    np.testing.assert_allclose(row, 15.5)


def test_angle_of_ninety_degrees_is_refused():
    with pytest.raises(ValueError, match="angle_deg must lie between"):
        angle_scene(90.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"vertices_mm": [(0, 0, 0)]}, "vertices_mm must have shape"),
        (
            {"vertices_mm": [(0, 0, 0), (0, np.nan, 1)]},
            "vertices_mm must be positions in mm",
        ),
        ({"vertices_mm": [(0, 0, 0), (0, 0, 1), (0, 0, 1)]}, "vertices 1 and 2 are the same"),
        ({"background": np.ones((3, 3))}, "background has shape"),
        ({"background": -1.0}, "background must be finite and >= 0"),
        ({"scattering": "mie"}, "scattering must be"),
        ({"beam_diameter_mm": -1.0}, "beam_diameter_mm must be"),
        ({"true_emission_time_ps": np.nan}, "true_emission_time_ps must be"),
    ],
)
def test_scenes_that_cannot_be_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        Scene(**({"vertices_mm": LEG, "camera": CAMERA} | changes))


def test_source_may_be_known_worse_than_the_truth():
    guess = Source((1.0, 2.0, 3.0), position_std_mm=2.0)
    known, guessed = (
        simulate(Scene(LEG, camera=CAMERA, source=s), photons_per_pixel=50.0, seed=1)
        for s in (Source(), guess)
    )
    np.testing.assert_array_equal(known.counts, guessed.counts)


def test_vignetting_holds_back_its_share_in_the_corner_and_nothing_on_the_axis():
    rim = rim_of_camera(CAMERA)
    corner = -CAMERA.rays_from_pixels(-0.5, -0.5)
    axis = CAMERA.backward_axis
    half = axis + 0.5 * (corner / (corner @ axis) - axis)
    towards = np.array([axis, half / np.linalg.norm(half), corner])
    found = vignetting_from_directions(towards, axis, rim=rim, loss=0.4)
    np.testing.assert_allclose(found, [1.0, 1.0 - 0.4 / 16, 0.6], atol=1e-12)


def test_vignetting_darkens_the_picture_by_its_law():
    plain = Scene(LEG, camera=CAMERA, inverse_square=False)
    points, col, _ = seen_points(plain)
    near = np.array([np.average(points, axis=0, weights=np.abs(col - k) < 0.5) for k in range(16)])
    towards = (CENTER - near) / np.linalg.norm(CENTER - near, axis=1)[:, None]
    base = expected(plain).sum(axis=0)
    dark = expected(Scene(LEG, camera=CAMERA, inverse_square=False, vignetting=0.8)).sum(axis=0)
    wanted = vignetting_from_directions(
        towards, CAMERA.backward_axis, rim=rim_of_camera(CAMERA), loss=0.8
    )
    assert wanted.min() < 0.9
    np.testing.assert_allclose(dark / base, wanted, rtol=4e-3)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"mirrors": [[0, 0, 0, 1, 0, 0, 0]], "vertices_mm": [[0, 0, 0], [1, 0, 0]]}, "either"),
        ({"mirrors": [[0, 0, 0, 1, 0, 0, 0]]}, "source_direction and exit_length_mm"),
        ({"source_direction": [1, 0, 0], "exit_length_mm": 5.0}, "position_mm"),
        ({"dust_seed": 3}, "dust_contrast"),
        ({"dust_contrast": 0.3, "brightness": [1.0]}, "not both"),
    ],
)
def test_scene_tables_that_do_not_go_together(table, message):
    with pytest.raises(ValueError, match=message):
        scene_arguments(table, Source())


def test_dust_of_a_table_is_the_dust_of_the_function():
    brightness = scene_arguments({"dust_contrast": 0.4, "dust_seed": 5}, Source())["brightness"]
    length = np.linspace(0.0, 100.0, 7)
    np.testing.assert_array_equal(brightness(length), dust(5, contrast=0.4)(length))
