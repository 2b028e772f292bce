"""The worlds of the oracle: closed forms, what is kept, what cancels; then five of them told to
the package with nothing wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lightflight as lf
from tests.oracles import brute_force
from tests.oracles.worlds.border import FLAT_ARRIVAL_PS, calibrated, record, what_the_user_tells
from tests.oracles.worlds.clock import PERFECT, Clock, pf32_clock
from tests.oracles.worlds.counts import expected_counts
from tests.oracles.worlds.defects import DEFECTS, defects
from tests.oracles.worlds.fisher import (
    as_told,
    fisher,
    inseparable,
    light_slope,
    slope,
    window_of,
)
from tests.oracles.worlds.light import mirrored, scaled_to, stations
from tests.oracles.worlds.parameters import causes, nudged, step_of
from tests.oracles.worlds.random_worlds import N_CAMERAS, camera, random_world
from tests.oracles.worlds.view import view_over_plane
from tests.oracles.worlds.world import LAB, Arm, C, Prior, Told, World

LEG = np.array([[-200.0, 10.0, 0.0], [200.0, 20.0, 30.0]])
FINDINGS = {
    "prior", "source", "unexplained_light", "shape", "trend", "scatter", "unseen_leg",
    "curved_leg", "leg_count", "haze", "halo", "glare", "other_pulse", "index", "focal_length",
    "distortion", "pose", "clock_offset", "clock_scale", "clock_drift", "walk", "pile_up", "units",
    "orientation", "calibration",
}  # fmt: skip


VIEW = view_over_plane(shape=(16, 16))


def world(**changes) -> World:
    view = changes.pop("view", VIEW)
    vertices = changes.pop("vertices", LEG)
    plain = World(vertices, view, Told(view, vertices[0], 26_000.0), **changes)
    return scaled_to(plain, 10_000.0)


def times(counts: np.ndarray, clock: Clock = PERFECT) -> tuple[float, float]:
    """Mean and variance of the recorded times, by the middles of equal codes, ps."""
    near, far = clock.intervals()
    middle, weight = (near[0] + far[0]) / 2, counts.sum(axis=(0, 1))
    mean = float(weight @ middle / weight.sum())
    return mean, float(weight @ (middle - mean) ** 2 / weight.sum())


def test_only_the_border_knows_the_package() -> None:
    folder = Path(__file__).parent / "worlds"
    knows = {p.stem for p in folder.glob("*.py") if "import lightflight" in p.read_text()}
    knows |= {p.stem for p in folder.glob("*.py") if "from lightflight" in p.read_text()}
    assert knows == {"border"}


def test_agrees_with_the_marched_oracle() -> None:
    """Two ways to the same counts: bins and error functions there, a Fourier series here."""
    marched = brute_force.BruteScene(
        LEG, brute_force.camera_over_plane(rows=16, cols=16), emission_time=49_000.0,
        clock=brute_force.BruteClock(909, 55.0, 50_000.0, reversed=True), pulse_std=80.0,
    )  # fmt: skip
    there = brute_force.expected_counts(marched, brightest=10_000.0, nodes=25, stride=0.5)
    plain = world(clock=Clock(reversed=True), emission_ps=49_000.0, std_ps=80.0, spot_std_px=0.3)
    np.testing.assert_allclose(expected_counts(plain), there, atol=3e-5 * there.max())


def test_arrival_follows_the_half_angle_law() -> None:
    """t_f + (p / c) tan(pi/4 + psi/2), psi from the foot of the perpendicular, one index."""
    beam = stations(world(path_index=1.0, return_index=1.0))
    centre, ahead = np.array([0.0, 0.0, 535.0]), (LEG[1] - LEG[0]) / np.linalg.norm(LEG[1] - LEG[0])
    along = float((centre - LEG[0]) @ ahead)
    foot = LEG[0] + along * ahead
    p = float(np.linalg.norm(centre - foot))
    psi = np.arctan2((beam.place - foot) @ ahead, p)
    law = 26_000.0 + along / C + p / C * np.tan(np.pi / 4 + psi / 2)
    np.testing.assert_allclose(beam.arrival_ps, law, atol=1e-6)


@pytest.mark.parametrize("share", [0.05, 0.5])
@pytest.mark.parametrize("kind", ["haze", "tail"])
def test_late_light_is_late_by_its_mean(kind: str, share: float) -> None:
    plain, late = world(), world(**{kind: share, f"{kind}_ps": 600.0})
    before, after = expected_counts(plain), expected_counts(late)
    assert after.sum() == pytest.approx(before.sum(), rel=1e-9)
    assert times(after)[0] - times(before)[0] == pytest.approx(share * 600.0, rel=1e-4)
    assert times(after)[1] - times(before)[1] == pytest.approx(
        600.0**2 * share * (2.0 - share), rel=1e-3
    )


def test_drift_moves_by_half_and_widens_by_a_twelfth() -> None:
    before, after = expected_counts(world()), expected_counts(world(drift_ps=240.0))
    assert times(after)[0] - times(before)[0] == pytest.approx(120.0, abs=0.01)
    assert times(after)[1] - times(before)[1] == pytest.approx(240.0**2 / 12, abs=5.0)
    four = [expected_counts(world(drift_ps=240.0, repeats=4), repeat) for repeat in range(4)]
    np.testing.assert_allclose(sum(four), after, atol=1e-6)
    assert times(four[3])[0] - times(four[0])[0] == pytest.approx(180.0, abs=0.01)


def test_second_pulse_brings_its_own_light() -> None:
    before, after = expected_counts(world()), expected_counts(world(second=0.1, second_ps=3000.0))
    assert after.sum() == pytest.approx(1.1 * before.sum(), rel=1e-6)
    assert times(after)[0] - times(before)[0] == pytest.approx(3000.0 * 0.1 / 1.1, abs=0.01)


def test_wall_shows_the_beam_twice_its_distance_farther() -> None:
    """Straight below the camera the way over the wall is longer by twice the gap, there and back
    in the picture by perspective."""
    flat = np.array([[-200.0, 0.0, 0.0], [200.0, 0.0, 0.0]])
    with_wall = world(vertices=flat, wall=0.5, wall_depth_mm=535.0 + 60.0)
    beam = stations(with_wall)
    image = mirrored(with_wall, beam)
    middle = int(np.argmin(np.abs(beam.place[:, 0])))
    extra = image.arrival_ps[middle] - beam.arrival_ps[middle]
    assert extra == pytest.approx(1.00027 * 120.0 / C, abs=1e-3)
    np.testing.assert_allclose(image.place, beam.place - [0.0, 0.0, 120.0], atol=1e-9)
    assert image.light[middle] / beam.light[middle] == pytest.approx(
        0.5 * (535.0 / 655.0) ** 2, rel=1e-6
    )


@pytest.mark.parametrize("kind", ["glare", "crosstalk", "halo", "late_halo"])
def test_scattered_light_is_moved_and_not_made(kind: str) -> None:
    """A short leg in the middle of the picture, pixels without gaps: what is spread stays."""
    short = np.array([[-15.0, 0.0, 0.0], [15.0, 5.0, 0.0]])
    wide = view_over_plane(field=(500.0, 500.0), shape=(32, 32))
    plain = world(vertices=short, view=wide, active_side_px=1.0, late_halo_std_px=2.5)
    before, after = expected_counts(plain), expected_counts(plain.but(**{kind: 0.2}))
    assert after.sum() == pytest.approx(before.sum(), rel=1e-6)
    row, col, _ = np.unravel_index(before.argmax(), before.shape)
    assert 0.79 < after[row, col].sum() / before[row, col].sum() < 0.96


def test_symmetric_things_are_symmetric() -> None:
    level = np.array([[-200.0, 0.0, 0.0], [200.0, 0.0, 0.0]])
    counts = expected_counts(world(vertices=level))
    np.testing.assert_allclose(counts, counts[::-1], atol=1e-8)
    light = expected_counts(world(vertices=level)).sum(axis=2)
    np.testing.assert_allclose(light, light[:, ::-1], rtol=1e-6, atol=1e-6)
    reverse = expected_counts(world(clock=Clock(1000, 50.0, reversed=True)))
    forward = expected_counts(world(clock=Clock(1000, 50.0)))
    np.testing.assert_allclose(reverse[..., ::-1], forward, atol=1e-7)
    half_turn = expected_counts(world(picture="turned 180"))
    np.testing.assert_allclose(half_turn[::-1, ::-1], expected_counts(world()))


def test_sagitta_is_what_the_middle_of_a_leg_is_off_by() -> None:
    bent = stations(world(bends_mm=((3.0, -4.0),)), stride=0.1)
    middle = int(np.argmin(np.abs(bent.walked_mm - bent.walked_mm[-1] / 2)))
    gap = bent.place[middle] - LEG.mean(axis=0)
    assert np.linalg.norm(gap) == pytest.approx(5.0, abs=1e-3)
    assert gap @ (LEG[1] - LEG[0]) == pytest.approx(0.0, abs=40.0)
    arc = np.linalg.norm(LEG[1] - LEG[0]) + 8.0 * 25.0 / 3.0 / np.linalg.norm(LEG[1] - LEG[0])
    assert bent.walked_mm[-1] == pytest.approx(arc, abs=0.1)


def test_first_photons_of_frames() -> None:
    """One period in a frame: a pixel sees frames x (1 - exp(-light)); many frames: all of it."""
    clock = Clock(1000, 50.0)
    plain = world(background_per_ps=1e-3, clock=clock)
    light = expected_counts(plain)
    single = expected_counts(plain.but(frames=20_000.0, periods_per_frame=1))
    seen = 20_000.0 * -np.expm1(-light.sum(axis=2) / 20_000.0)
    np.testing.assert_allclose(single.sum(axis=2), seen, rtol=1e-6)
    assert times(single, clock)[0] < times(light, clock)[0] - 1.0
    many = expected_counts(plain.but(frames=1e9, periods_per_frame=1))
    np.testing.assert_allclose(many, light, rtol=2e-5, atol=1e-9)
    long = expected_counts(plain.but(frames=20_000.0, periods_per_frame=4000))
    np.testing.assert_allclose(long.sum(axis=2), seen, rtol=1e-6)
    shape = long / long.sum(axis=2, keepdims=True) - light / light.sum(axis=2, keepdims=True)
    assert np.abs(shape).max() < 1e-4


def test_a_pulse_is_timed_to_sigma_over_root_n() -> None:
    fine = Clock(5000, 10.0)
    pulse = world(clock=fine, std_ps=300.0, background_per_ps=1e-7)
    window = window_of(pulse)
    mean = window.vector(pulse)
    information = float((slope(pulse, "offset_ps", window) ** 2 / np.maximum(mean, 1e-9)).sum())
    assert information == pytest.approx(mean.sum() / 300.0**2, rel=0.02)


def test_parts_of_the_light_add_up() -> None:
    plain = world()
    window = window_of(plain)
    signal = window.vector(plain)
    whole = light_slope(plain, window, 0.0, 1e4, -1.0)
    np.testing.assert_allclose(whole, signal, atol=1e-9)
    nodes = [light_slope(plain, window, s - 5.0, s + 5.0, s) for s in np.arange(0.0, 410.0, 5.0)]
    np.testing.assert_allclose(sum(nodes), signal, atol=1e-6)


def test_fisher_knows_what_a_late_clock_does() -> None:
    """A clock that is late and a pulse that leaves late are one: with the emission told as exact
    the path takes it up, with the emission free nothing moves and nothing is seen."""
    exact = world(background_per_ps=1e-3)
    late = exact.but(offset_ps=1.0)
    known = fisher(exact)
    found = known.explanations(late, times=10.0)
    assert {"clock_offset", "clock_scale", "source"} <= set(inseparable(found))
    assert not {"haze", "walk", "distortion"} & set(inseparable(found))
    ahead = (LEG[1] - LEG[0]) / np.linalg.norm(LEG[1] - LEG[0])
    off_line = {"x1": -ahead[2], "z1": ahead[0]}
    moved = known.moved_by(late)
    assert abs(sum(moved[n] * v for n, v in off_line.items())) > 3.0 * known.std_along(off_line)
    free = fisher(exact.told_but(prior=Prior(emission_ps=math.inf)))
    assert free.seen_at(late) < 0.01 < known.seen_at(late)
    assert free.moved_by(late)["emission"] == pytest.approx(1.0, abs=1e-3)
    assert free.std_along(off_line) > 1.5 * known.std_along(off_line)


def test_fisher_names_what_it_was_given() -> None:
    exact = world(background_per_ps=1e-3)
    model = fisher(exact)
    for name in ("haze_500ps", "walk", "barrel", "bend_in_depth", "wall_60mm"):
        defect = DEFECTS[name]
        found = model.explanations(defect.applied(exact, defect.strengths[0] / 10), times=20.0)
        assert found[0].cause == defect.finding
    told = DEFECTS["source_off_z"].applied(exact, 10.0)
    assert fisher(as_told(told, exact)).seen_at(told) > 6.0


def test_light_of_uneven_worlds_is_held_by_its_prior() -> None:
    even = world(background_per_ps=1e-3)
    loose = fisher(even, brightness_std=0.2)
    inside = [n for n in loose.names if n.startswith("light_")]
    assert len(inside) > 40
    assert all(0.0 < loose.std(n) <= 0.2001 for n in inside)
    tight = fisher(even)
    assert 0.5 * loose.std("y1") < tight.std("y1") < loose.std("y1")


def test_all_parameters_move_something() -> None:
    plain = random_world(0, 3, uneven=0.0).but(glint_mm=np.zeros(3))
    names = {name for cause in causes(3).values() for name in cause} | {"light_3", "log_flux_1"}
    for name in names:
        step = step_of(name)[0] if not name.startswith(("light", "log")) else 0.1
        moved = nudged(plain, name, step)
        changed = [k for k in vars(plain) if vars(plain)[k] is not vars(moved)[k]]
        assert 1 <= len(changed) <= 2, name


def test_defects_are_many_and_a_third_is_held_out() -> None:
    every = defects()
    assert len(every) >= 40
    assert len(defects(held_out=True)) == math.ceil(len(every) / 3)
    assert {d.finding for d in every} <= FINDINGS
    for n_legs in (1, 3):
        plain = random_world(5, n_legs)
        for defect in every:
            assert len(set(defect.strengths)) == 3
            for strength in defect.strengths:
                made = defect.applied(plain, strength)
                assert any(vars(made)[k] is not vars(plain)[k] for k in vars(plain)), defect.name
                assert made.n_legs >= n_legs


def test_cameras_differ_and_see_every_leg_but_no_corner() -> None:
    places = {tuple(np.round(camera(k)[0].centre, 3)) for k in range(N_CAMERAS)}
    assert len(places) == N_CAMERAS >= 20
    for seed in range(0, 2 * N_CAMERAS, 3):
        made = random_world(seed, 3, photons=400.0)
        assert not made.view.inside(made.vertices).any()
        middles = (made.vertices[1:] + made.vertices[:-1]) / 2
        assert made.view.inside(middles).all()
        assert bool(made.log_brightness.size) == (seed >= N_CAMERAS)
    assert expected_counts(made).sum(axis=2).max() == pytest.approx(410.0, rel=0.01)


def test_truth_is_drawn_from_what_is_told() -> None:
    """Pull of the source's place over 100 worlds; false alarm 1e-4."""
    prior = Prior(source_mm=2.0, position_mm=0.5, offset_ps=3.0)
    off = [
        (w.vertices[0] - w.told.source_mm)[1] / 2.0
        for w in (random_world(s, 1, 100.0, prior, uneven=0.0) for s in range(100))
    ]
    assert abs(np.mean(off)) < 0.39
    assert 0.75 < np.std(off) < 1.3


def test_pf32_is_calibrated_by_its_own_recordings() -> None:
    clock = pf32_clock(3, (8, 8))
    assert clock.skew_ps is not None
    timing = calibrated(clock, (8, 8))
    skew = timing.skew_ps.ravel() - clock.skew_ps
    assert np.std(skew) < 1.0
    near, _ = timing.code_intervals_ps(*np.divmod(np.arange(64), 8))
    true, _ = clock.intervals()
    at = [int(np.argmin(np.abs(row - FLAT_ARRIVAL_PS))) for row in true]
    gap = near[np.arange(64), at] - true[np.arange(64), at]
    assert np.std(gap) < 3.0


@pytest.mark.usefixtures("unexamined")
def test_package_reads_undisturbed_worlds() -> None:
    """Nine angles of five worlds, their errors in stated ones; false alarm below 1e-4."""
    pulls = []
    for seed, n_legs in ((1, 1), (3, 1), (4, 1), (2, 3), (3, 3)):
        made = random_world(seed, n_legs)
        path = lf.reconstruct(record(made, seed), **what_the_user_tells(made))
        assert path.n_legs == n_legs
        steps = np.diff(made.vertices, axis=0)
        up = -steps @ made.view.axes[2] / np.linalg.norm(steps, axis=1)
        for leg, true in zip(path.legs, np.degrees(np.arcsin(up)), strict=True):
            pulls.append((leg.angle_deg - true) / leg.angle_std_deg)
    assert np.abs(pulls).max() < 4.5
    assert 0.3 < np.sqrt(np.mean(np.square(pulls))) < 2.0


def test_what_is_told_is_not_the_truth_where_a_defect_says_so() -> None:
    plain = random_world(0, 1)
    told = what_the_user_tells(DEFECTS["camera_nearer"].applied(plain, 5.0))
    np.testing.assert_allclose(told["camera"].center_mm, plain.view.centre)
    moved = what_the_user_tells(DEFECTS["source_off_x"].applied(plain, 3.0))
    assert moved["source"].position_mm[0] == pytest.approx(plain.vertices[0, 0] + 3.0)
    slow = what_the_user_tells(plain.told_but(prior=replace(LAB, index=1e-3)))
    assert slow["medium"].path_group_index_std == 1e-3


def test_the_arm_of_a_splitter_is_the_same_light_on_another_way() -> None:
    """Both ways cut at the splitter: together they are the beam and its arm, count for count."""
    whole = world()
    place = LEG.mean(axis=0)
    way = place + np.array([[0.0, 0.0, 0.0], [0.0, 150.0, 20.0]])
    late = float(whole.vertex_times_ps().mean())
    split = whole.but(
        vertices=np.insert(LEG, 1, place, axis=0),
        leg_log_flux=(0.0, math.log(0.7)),
        arms=(Arm(way, 0.3, late),),
    )
    alone = whole.but(vertices=way, emission_ps=late, flux=0.3 * whole.flux)
    before = whole.but(vertices=np.array([LEG[0], place]))
    after = whole.but(vertices=np.array([place, LEG[1]]), emission_ps=late, flux=0.7 * whole.flux)
    parts = sum(expected_counts(part) for part in (alone, before, after))
    np.testing.assert_allclose(expected_counts(split), parts, rtol=1e-3, atol=1e-3)


def test_the_ghost_of_a_lens_is_the_picture_turned_about_its_middle():
    """A spark: as much light at the pixel opposite, later; nothing where it was."""
    world = random_world(0, 1, uneven=0.0).but(ghost=0.05, ghost_ps=300.0)
    plain = world.but(ghost=0.0, spot_std_px=world.ghost_std_px)
    more = expected_counts(world) - expected_counts(world.but(ghost=0.0))
    turned = 0.05 * expected_counts(plain, background=False)[::-1, ::-1]
    np.testing.assert_allclose(more.sum(axis=2), turned.sum(axis=2), atol=1e-6 * turned.max())
    bright = np.unravel_index(np.argmax(turned.sum(axis=2)), turned.shape[:2])
    code = np.arange(more.shape[2])
    late = [float(code @ each[bright] / each[bright].sum()) for each in (turned, more)]
    codes = abs(late[1] - late[0])
    assert codes * world.clock.width_ps == pytest.approx(300.0, rel=0.02)
