"""What the twin draws, against integrals written out here from the design of the method.

Nothing of the package's geometry is used for the reference: a pinhole that faces the plane z = 0
is three lines, and light from a path of straight legs is a sum over short steps.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.signal import fftconvolve
from scipy.special import ndtr
from scipy.stats import chi2 as chi2_law

from lightflight import Camera, Medium, Source
from lightflight.simulate import Scene, angle_scene, ideal, paper_scene, pf32, simulate

C = 0.299792458
FALSE_ALARM = 1e-6


def steps_along(vertices, size_mm=0.02):
    """Middles of short steps along a path: (leg, path length, step length, position)."""
    leg, length, size, point = [], [], [], []
    start = 0.0
    vertices = np.asarray(vertices, float)
    for k, (a, b) in enumerate(itertools.pairwise(vertices)):
        total = np.linalg.norm(b - a)
        n = int(np.ceil(total / size_mm))
        at = (np.arange(n) + 0.5) * total / n
        leg.append(np.full(n, k))
        length.append(start + at)
        size.append(np.full(n, total / n))
        point.append(a + at[:, None] * (b - a) / total)
        start += float(total)
    return tuple(np.concatenate(part) for part in (leg, length, size, point))


def facing_pixels(point, *, center, distance, field, shape):
    """(row, col) of points for a pinhole at `distance` that looks down -z at the plane z = 0."""
    magnified = distance / (distance - point[:, 2])
    col = (shape[1] - 1) / 2 + (point[:, 0] - center[0]) * magnified * shape[1] / field
    row = (shape[0] - 1) / 2 - (point[:, 1] - center[1]) * magnified * shape[0] / field
    return row, col


def share(distance, std, width):
    return ndtr((distance + width / 2) / std) - ndtr((distance - width / 2) / std)


def reference_light(scene, *, center, distance=535.0, field=245.0, strength=np.ones_like):
    """(steps' weights per pixel as a function, arrival times of the steps, legs)."""
    leg, length, size, point = steps_along(scene.vertices_mm)
    row, col = facing_pixels(
        point, center=center, distance=distance, field=field, shape=scene.camera.shape
    )
    towards = np.array([*center, distance]) - point
    r = np.linalg.norm(towards, axis=1)
    medium = scene.medium
    arrival = (
        scene.emission_time_ps
        + (medium.path_group_index * length + medium.return_group_index * r) / C
    )
    light = strength(length) * size / r**2
    std, width = scene.detector.psf_std_px, scene.detector.active_width_px

    def weights(pixel_row, pixel_col):
        return light * share(row - pixel_row, std, width) * share(col - pixel_col, std, width)

    return weights, arrival, leg


def bright_pixels(hist, n=12):
    """A spread of pixels from dim to bright."""
    order = np.argsort(hist.truth.expected_counts, axis=None)
    lit = order[hist.truth.expected_counts.ravel()[order] > 1e-3 * hist.truth.expected_counts.max()]
    picks = lit[np.linspace(0, len(lit) - 1, n).astype(int)]
    return [divmod(int(k), hist.shape[1]) for k in picks]


def uneven(length):
    return 1.0 + 0.5 * np.sin(length / 17.0)


@pytest.mark.parametrize("brightness", [None, uneven])
def test_expected_counts_and_mean_arrivals_are_the_integrals(brightness):
    scene = paper_scene(ideal(), brightness=brightness, medium=Medium(1.3, 1.0003))
    truth = simulate(scene, photons_per_pixel=50.0).truth
    weights, arrival, leg = reference_light(
        scene, center=(187.5, 37.5), strength=brightness or np.ones_like
    )
    hist_like = type("H", (), {"truth": truth, "shape": (32, 32)})
    pixels = bright_pixels(hist_like, 20)
    brightest = divmod(int(np.argmax(truth.expected_counts)), 32)
    top = weights(*brightest).sum()
    assert truth.expected_counts.max() == pytest.approx(50.0, rel=1e-12)
    for row, col in pixels:
        w = weights(row, col)
        assert truth.expected_counts[row, col] == pytest.approx(50.0 * w.sum() / top, rel=2e-4)
        for k in range(3):
            own = np.where(leg == k, w, 0.0)
            if own.sum() > 1e-6 * top:
                mean = (own * arrival).sum() / own.sum()
                assert truth.mean_arrival_ps[k, row, col] == pytest.approx(mean, abs=2e-3)


def test_counts_are_poisson_about_the_expected_ones():
    hist = simulate(paper_scene(ideal()), photons_per_pixel=5000.0, seed=3)
    expected = hist.truth.expected_counts
    lit = expected > 5.0
    chi2 = ((hist.photons[lit] - expected[lit]) ** 2 / expected[lit]).sum()
    dof = int(lit.sum())
    assert dof > 150
    assert chi2_law.ppf(FALSE_ALARM, dof) < chi2 < chi2_law.isf(FALSE_ALARM, dof)
    dim = expected < 1e-9
    assert hist.photons[dim].sum() == 0


DETECTORS = {
    "ideal": ideal(),
    "skew": ideal(skew_range_ps=300.0),
    "reversed": pf32(seed=1, dark_rate_hz=0, screaming_fraction=0, first_photon_only=False),
    "lost": pf32(
        seed=1, dark_rate_hz=0, screaming_fraction=0, first_photon_only=False, dead_codes="lost"
    ),
    "tail": ideal(response_tail_fraction=0.3, response_tail_ps=200.0),
    "drift": ideal(drift_ps=400.0, trigger_jitter_fwhm_ps=90.0),
}


def reference_histogram(scene, pixel, *, center):
    """Relative mean counts per code of one pixel (equation 3.7), folds included."""
    detector = scene.detector
    weights, arrival, _ = reference_light(scene, center=center)
    w = weights(*pixel)
    keep = w > 1e-9 * w.max()
    w, arrival = w[keep], arrival[keep] + detector.pixels(scene.camera.shape).skew_ps[pixel]
    lower, upper = (edge[pixel] for edge in detector.true_code_intervals_ps(scene.camera.shape))
    fwhm = (scene.pulse_fwhm_ps, detector.response_fwhm_ps, detector.trigger_jitter_fwhm_ps)
    std = np.sqrt(np.sum(np.square(fwhm))) / 2.3548200450309493
    # everything on one grid of 0.5 ps; lateness as probabilities on it, put together by folding
    step = 0.5
    lateness = np.arange(-9 * std, 9 * std, step)
    parts = [(lateness, np.diff(ndtr(np.append(lateness, lateness[-1] + step) / std)))]
    if detector.response_tail_fraction:
        f, tail = detector.response_tail_fraction, detector.response_tail_ps
        late = np.arange(0.0, 20 * tail, step)
        odds = f * -np.diff(np.exp(-np.append(late, 20 * tail) / tail))
        odds[0] += 1 - f
        parts.append((late, odds))
    if detector.drift_ps:
        moments = np.arange(-detector.drift_ps / 2, detector.drift_ps / 2, step)
        parts.append((moments, np.full(len(moments), 1 / len(moments))))
    start = arrival.min() - 1
    edges = np.arange(start, arrival.max() + 1, step)
    light = np.histogram(arrival, edges, weights=w)[0]
    start += step / 2
    for grid, odds in parts:
        light, start = fftconvolve(light, odds), start + grid[0] + step / 2
    times = start + step * (np.arange(len(light) + 1) - 0.5)
    cumulative = np.append(0.0, np.cumsum(light))
    total = np.zeros(len(lower))
    for fold in (-50_000.0, 0.0, 50_000.0):
        below = np.interp(lower - fold, times, cumulative, left=0.0, right=light.sum())
        above = np.interp(upper - fold, times, cumulative, left=0.0, right=light.sum())
        total += above - below
    return total / w.sum()


def compare(counts, mean):
    """Chi-square of counts against means, bins below 10 counts put together; (chi2, dof)."""
    order = np.argsort(mean)
    dim = order[np.cumsum(mean[order]) < 10.0]
    bright = np.setdiff1d(np.arange(len(mean)), dim)
    c = np.append(counts[bright], counts[dim].sum())
    m = np.append(mean[bright], mean[dim].sum())
    return ((c - m) ** 2 / np.maximum(m, 1e-9))[m > 1.0].sum(), int((m > 1.0).sum())


@pytest.mark.parametrize("name", DETECTORS)
def test_codes_of_a_pixel_follow_the_forward_formula(name):
    # about 4 pixels of 20,000 photons, 10 to 40 codes each
    scene = angle_scene(20.0, DETECTORS[name], true_emission_time_ps=48_500.0)
    hist = simulate(scene, photons_per_pixel=20_000.0, seed=11)
    chi2, dof = 0.0, 0
    for pixel in ((15, 2), (15, 11), (16, 20), (16, 31)):
        mean = hist.truth.expected_counts[pixel] * reference_histogram(
            scene, pixel, center=(122.5, 0.0)
        )
        counts = hist.counts[pixel].astype(float)
        if hist.no_photon_code is not None:
            counts[hist.no_photon_code] = 0.0
        part, bins = compare(counts, mean)
        chi2, dof = chi2 + part, dof + bins
    assert dof > 40
    assert chi2 < chi2_law.isf(FALSE_ALARM, dof)
    assert chi2 > chi2_law.ppf(FALSE_ALARM, dof)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.3, -0.2), (0.5, 0.5)])
def test_light_of_a_point_spreads_as_blur_and_active_area(offset):
    pitch = 245.0 / 32
    x, y = (0.5 + offset[1]) * pitch, -(0.5 + offset[0]) * pitch
    camera = Camera.facing_plane((32, 32))
    scene = Scene([(x - 1e-4, y, 0), (x + 1e-4, y, 0)], camera=camera, detector=ideal())
    # 100,000 photons in the brightest pixel; row 16 + offset, col 16 + offset
    hist = simulate(scene, photons_per_pixel=100_000.0, seed=5)
    rows = share(16 + offset[0] - np.arange(32), 0.35, 0.122)
    cols = share(16 + offset[1] - np.arange(32), 0.35, 0.122)
    expected = np.outer(rows, cols)
    expected *= 100_000.0 / expected.max()
    np.testing.assert_allclose(hist.truth.expected_counts, expected, rtol=1e-4, atol=1e-3)
    lit = expected > 5
    chi2 = ((hist.photons - expected)[lit] ** 2 / expected[lit]).sum()
    assert chi2_law.ppf(FALSE_ALARM, lit.sum()) < chi2 < chi2_law.isf(FALSE_ALARM, lit.sum())


@pytest.mark.parametrize("angle_deg", [-60.0, 0.0, 45.0])
def test_pulse_is_as_wide_as_laser_response_transit_and_code_together(angle_deg):
    scene = angle_scene(angle_deg, ideal(bin_width_ps=5.0, n_codes=10_000))
    hist = simulate(scene, photons_per_pixel=40_000.0, seed=2)
    pixel = divmod(int(np.argmax(hist.truth.expected_counts)), 32)
    weights, arrival, _ = reference_light(scene, center=(122.5, 0.0))
    w = weights(*pixel)
    mean = (w * arrival).sum() / w.sum()
    transit = (w * (arrival - mean) ** 2).sum() / w.sum()
    std = np.sqrt(transit + (68.0**2 + 150.0**2) / 2.3548200450309493**2 + 25.0 / 12)
    times = np.arange(10_000) * 5.0 + 2.5
    counts = hist.counts[pixel].astype(float)
    found = np.sqrt(np.average((times - np.average(times, weights=counts)) ** 2, weights=counts))
    # 40,000 photons: 0.35 % standard error, 5.5 of them
    assert found == pytest.approx(std, rel=0.02)


def test_light_through_a_moved_and_turned_laboratory_is_the_same():
    vertices = np.array([(-60, 10, 0), (180, 30, 40), (-60, 60, 10)], float)
    camera = Camera.facing_plane((32, 32), center_mm=(60.0, 30.0))
    angle = 0.7
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    pose = np.eye(4)
    pose[:3, :3] = turn @ camera.world_from_camera[:3, :3]
    pose[:3, 3] = turn @ camera.world_from_camera[:3, 3] + [5.0, -300.0, 1000.0]
    moved = Camera(camera.matrix, camera.distortion, pose, camera.shape)
    a = Scene(vertices, camera=camera, cos4_falloff=True, scattering="rayleigh")
    b = Scene(
        vertices @ turn.T + [5.0, -300.0, 1000.0],
        camera=moved, cos4_falloff=True, scattering="rayleigh",
    )  # fmt: skip
    one, other = (simulate(scene, photons_per_pixel=10.0).truth for scene in (a, b))
    np.testing.assert_allclose(one.expected_counts, other.expected_counts, rtol=1e-5, atol=1e-9)
    lit = one.expected_leg_counts > 1e-3
    np.testing.assert_allclose(
        one.mean_arrival_ps[lit], other.mean_arrival_ps[lit], rtol=0, atol=1e-4
    )


def test_a_later_pulse_is_the_same_pulse_later():
    early = simulate(paper_scene(ideal()), photons_per_pixel=20.0)
    late = simulate(
        paper_scene(ideal(), true_emission_time_ps=2000.0 + 5500.0), photons_per_pixel=20
    )
    np.testing.assert_array_equal(early.counts[..., 50:600], late.counts[..., 150:700])
    np.testing.assert_allclose(
        late.truth.vertex_times_ps - early.truth.vertex_times_ps, 5500.0, rtol=0, atol=1e-9
    )


def test_pulse_on_the_fold_of_the_period_loses_nothing():
    source = Source((-65.0, 0.0, 0.0), emission_time_ps=47_300.0, pulse_fwhm_ps=68.0)
    detector = ideal(bin_width_ps=50.0, n_codes=1000)
    folded = simulate(angle_scene(0.0, detector, source=source), photons_per_pixel=500.0, seed=1)
    plain = simulate(angle_scene(0.0, detector), photons_per_pixel=500.0, seed=1)
    np.testing.assert_array_equal(folded.photons, plain.photons)
    assert folded.counts[..., :100].sum() > 1000
    assert folded.counts[..., -100:].sum() > 1000
