"""The oracle that looks through plane faces: closed forms, limits, and other oracles' counts."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest

from tests.oracles import brute_force, refracted_bound
from tests.oracles.brute_force import BruteClock, C
from tests.oracles.refracted import (
    AIR,
    BK7,
    WATER,
    Plane,
    RefractedScene,
    Stations,
    block_world,
    caught,
    curve_of_leg,
    expected_counts,
    images,
    in_picture,
    light_scale,
    paper_scene,
    positions_at,
    recording,
    seen_through,
    shot,
    sights,
    signal_counts,
    stations,
    stations_of_leg,
    tank_world,
    window,
    window_world,
)
from tests.oracles.refracted_bound import (
    PULSE,
    bound,
    distance_freedom,
    emission_freedom,
    medium_freedom,
)
from tests.oracles.worlds.fisher import fisher
from tests.oracles.worlds.light import scaled_to
from tests.oracles.worlds.view import view_over_plane
from tests.oracles.worlds.world import Told, World

CAMERA = np.array([3.0, -7.0, 200.0])
TILTED = (
    Plane(np.zeros(3), np.array([0.1, 0.02, 1.0]), *BK7),
    # A normal may be of any length and point either way.
    Plane(np.array([0.0, 0.0, -12.0]), np.array([-0.2, 0.05, -3.0]), *WATER),
    Plane(np.array([0.0, 0.0, -40.0]), np.array([0.0, 0.1, 1.0]), 1.46, 1.48),
)
WORLDS = {
    "window": window_world(),
    "window tilted": window_world(5.0),
    "one leg in a tank": tank_world(1),
    "three legs in a tank": tank_world(3),
    "tank tilted": tank_world(3, 5.0),
}


def some_points(n: int = 200) -> np.ndarray:
    rng = np.random.default_rng(17)
    return rng.uniform([-150.0, -150.0, -300.0], [150.0, 150.0, -90.0], (n, 3))


def small(world: RefractedScene) -> RefractedScene:
    """The same field on 16 x 16 pixels."""
    camera = replace(
        world.camera, rows=16, cols=16, row_of_axis=7.5, col_of_axis=7.5,
        px_per_slope_row=world.camera.px_per_slope_row / 2,
        px_per_slope_col=world.camera.px_per_slope_col / 2,
    )  # fmt: skip
    return replace(world, camera=camera)


def one_leg(**changes) -> RefractedScene:
    plain = small(paper_scene())
    return replace(plain, **{"vertices_mm": plain.vertices_mm[:2], **changes})


@pytest.mark.parametrize("name", ["refracted", "refracted_bound"])
def test_oracle_stands_alone(name: str) -> None:
    text = Path(__file__).with_name(f"{name}.py").read_text()
    assert "import lightflight" not in text
    assert "from lightflight" not in text


class TestRays:
    @pytest.mark.parametrize("angle_deg", [0.5, 20.0, 45.0, 80.0])
    def test_plate_shifts_a_ray(self, angle_deg: float) -> None:
        """By t sin(a) (1 - cos(a) / sqrt(n^2 - sin^2 a)), and leaves its direction."""
        angle, thick, n = math.radians(angle_deg), 10.0, BK7[0] / AIR
        ahead = np.array([[math.sin(angle), 0.0, -math.cos(angle)]])
        plate = window((0.0, 0.0, 0.0), thick, (AIR, AIR))
        hits, last = shot(np.array([0.0, 0.0, 50.0]), ahead, plate, AIR)
        np.testing.assert_allclose(last, ahead, atol=1e-14)
        shift = np.linalg.norm(np.cross(hits[-1] - hits[0], ahead))
        law = 1.0 - math.cos(angle) / math.sqrt(n**2 - math.sin(angle) ** 2)
        assert shift == pytest.approx(thick * math.sin(angle) * law, rel=1e-12)

    def test_paraxial_depth_is_the_true_one_over_the_index(self) -> None:
        above, below, across = 200.0, 150.0, 1e-3
        water = (Plane(np.zeros(3), np.array([0.0, 0.0, 1.0]), *WATER),)
        points = np.array([[across, 0.0, -below], [0.0, 0.0, -below]])
        seen = sights(points, np.array([0.0, 0.0, above]), water)
        apparent = above + below * AIR / WATER[0]
        assert -seen.direction[0, 0] / seen.direction[0, 2] == pytest.approx(
            across / apparent, rel=1e-10
        )
        # As much light as from a point at the apparent distance, but for (n / n')^2.
        assert seen.spreading_mm2[1] == pytest.approx(apparent**2, rel=1e-12)
        assert seen.group_mm[1] == pytest.approx(above * AIR + below * WATER[1], rel=1e-14)

    def test_snells_law_at_each_face(self) -> None:
        """n d x normal is the same before and behind: sines, and one plane of incidence."""
        points = some_points()
        seen = sights(points, CAMERA, TILTED)
        hits, _ = shot(CAMERA, seen.direction, TILTED)
        steps = np.diff(np.concatenate([hits, points[None]]), axis=0)
        ways = steps / np.linalg.norm(steps, axis=2)[..., None]
        indices = [AIR, *(plane.phase_beyond for plane in TILTED)]
        for k, plane in enumerate(TILTED):
            before = indices[k] * np.cross(ways[k], plane.normal)
            behind = indices[k + 1] * np.cross(ways[k + 1], plane.normal)
            np.testing.assert_allclose(before, behind, atol=1e-12)

    @pytest.mark.parametrize("planes", [(), TILTED])
    def test_equal_indices_leave_light_straight(self, planes: tuple[Plane, ...]) -> None:
        air = [replace(plane, phase_beyond=1.1, group_beyond=1.1) for plane in planes]
        points = some_points()
        way = np.linalg.norm(points - CAMERA, axis=1)
        seen = sights(points, CAMERA, air, 1.1, 1.1)
        np.testing.assert_allclose(seen.direction, (points - CAMERA) / way[:, None], atol=1e-14)
        np.testing.assert_allclose(seen.group_mm, 1.1 * way, rtol=1e-14)
        np.testing.assert_allclose(seen.spreading_mm2, way**2, rtol=1e-12)

    @pytest.mark.parametrize("across", [1e-6, 30.0, 400.0, 3000.0])
    def test_parallel_faces_in_thirty_digits(self, across: float) -> None:
        """The offset of a stack is sum t p / sqrt(n^2 - p^2), p the sine times the index."""
        layers = [(200.0, AIR, AIR), (10.0, *BK7), (150.0, *WATER)]
        stack = window((0.0, 0.0, 0.0), 10.0, WATER)
        ahead, group = seen_through(np.array([[across, 0.0, -160.0]]), [0, 0, 200.0], stack)
        with mpmath.workdps(30):
            ways = [(mpmath.mpf(t), mpmath.mpf(n), mpmath.mpf(g)) for t, n, g in layers]
            low, high = mpmath.mpf(0), mpmath.mpf(AIR)
            for _ in range(110):
                p = (low + high) / 2
                reached = sum(t * p / mpmath.sqrt(n**2 - p**2) for t, n, _ in ways)
                low, high = (low, p) if reached > across else (p, high)
            length = sum(g * t * n / mpmath.sqrt(n**2 - p**2) for t, n, g in ways)
            sine = p / AIR
        assert ahead[0, 0] == pytest.approx(float(sine), rel=2e-13)
        assert group[0] == pytest.approx(float(length), rel=1e-13)

    def test_group_length_is_stationary_where_it_is_the_phase_length(self) -> None:
        stack = [replace(plane, group_beyond=plane.phase_beyond) for plane in TILTED]
        points = some_points(20)
        ahead, group = seen_through(points, CAMERA, stack, AIR, AIR)
        hits, _ = shot(CAMERA, ahead, stack)
        indices = np.array([AIR, *(plane.phase_beyond for plane in stack)])

        def length(corners: np.ndarray) -> np.ndarray:
            return indices @ np.linalg.norm(np.diff(corners, axis=0), axis=2)

        found = np.concatenate([hits, points[None]])
        np.testing.assert_allclose(length(found), group, rtol=1e-14)
        for k, plane in enumerate(stack):
            for way in np.linalg.svd(plane.normal[None])[2][1:]:
                ahead_of, behind = found.copy(), found.copy()
                ahead_of[k + 1] += 0.001 * way
                behind[k + 1] -= 0.001 * way
                slope = (length(ahead_of) - length(behind)) / 0.002
                assert np.abs(slope).max() < 1e-8
                assert (length(ahead_of) > group).all()

    def test_path_hangs_on_phase_and_time_on_group(self) -> None:
        slow = [replace(plane, group_beyond=plane.group_beyond + 0.1) for plane in TILTED]
        points = some_points(20)
        ahead, group = seen_through(points, CAMERA, TILTED)
        same, later = seen_through(points, CAMERA, slow)
        np.testing.assert_array_equal(same, ahead)
        hits, _ = shot(CAMERA, ahead, TILTED)
        inside = np.linalg.norm(np.diff(np.concatenate([hits, points[None]]), axis=0), axis=2)[1:]
        np.testing.assert_allclose(later - group, 0.1 * inside.sum(axis=0), rtol=1e-10)
        scene_only = seen_through(points, CAMERA, TILTED, group_scene=1.48 + 0.1)[1]
        np.testing.assert_allclose(scene_only - group, 0.1 * inside[-1], rtol=1e-10)

    def test_rays_into_thinner_media_are_found_beside_total_reflection(self) -> None:
        """A camera under water sees all above it within 48.6 degrees."""
        air = (Plane(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]), 1.0, 1.0),)
        points = np.random.default_rng(1).uniform([-300, -300, 3], [300, 300, 30], (200, 3))
        ahead, _ = seen_through(points, np.zeros(3), air, *WATER)
        hits, last = shot(np.zeros(3), ahead, air, WATER[0])
        gap = points - hits[-1]
        assert np.abs(np.cross(gap, last)).max() < 1e-8
        assert (ahead[:, 2] > math.sqrt(1.0 - 1.0 / WATER[0] ** 2)).all()

    def test_points_before_a_face_are_not_seen_through_it(self) -> None:
        before, between = np.array([[10.0, 0.0, 100.0]]), np.array([[10.0, 0.0, -6.0]])
        for points, n in ((before, 0), (between, 1)):
            through = seen_through(points, CAMERA, TILTED)
            alone = seen_through(points, CAMERA, TILTED[:n])
            np.testing.assert_array_equal(through[0], alone[0])
            np.testing.assert_array_equal(through[1], alone[1])

    def test_stacks_in_another_order_are_refused(self) -> None:
        with pytest.raises(ValueError, match="ordered from the camera"):
            seen_through(np.array([[10.0, 0.0, -6.0]]), CAMERA, TILTED[::-1])
        with pytest.raises(ValueError, match="stands in the plane"):
            seen_through(some_points(), np.zeros(3), TILTED)


class TestCounts:
    @pytest.mark.parametrize("name", WORLDS)
    def test_splines_are_as_good_as_their_points(self, name: str) -> None:
        world = WORLDS[name]
        for leg in range(world.n_legs):
            curve = curve_of_leg(world, leg)
            shares = np.random.default_rng(leg).uniform(curve.low, curve.high, 300)
            start, end = world.vertices_mm[leg : leg + 2]
            image, seen = images(world, start + shares[:, None] * (end - start))
            found = curve.seen(shares)
            assert np.abs(found[:, :2] - image).max() < 1e-8
            assert np.abs(found[:, 2] - seen.group_mm).max() / C < 1e-7

    @pytest.mark.parametrize("backwards", [False, True])
    def test_agrees_with_the_marched_oracle_in_air(self, backwards: bool) -> None:
        """Bins and quadrature there; the laser's next sync comes amid the light."""
        clock = BruteClock(909, 55.0, 50_000.0, reversed=backwards)
        scene = one_leg(clock=clock, emission_time_ps=47_500.0)
        marched = brute_force.BruteScene(
            scene.vertices_mm, scene.camera, clock, emission_time=47_500.0,
            pulse_std=scene.pulse_std_ps, blur_std_px=scene.spot_std_px,
            background_per_ps=scene.background_per_ps,
        )  # fmt: skip
        there = brute_force.expected_counts(marched, brightest=scene.photons, nodes=25, stride=0.5)
        np.testing.assert_allclose(expected_counts(scene), there, atol=3e-5 * there.max())

    def test_panes_that_bend_nothing_change_nothing(self) -> None:
        pane = window((187.5, 37.5, 310.0), 10.0, (AIR, AIR), tilt_deg=5.0)
        air = tuple(replace(plane, phase_beyond=AIR, group_beyond=AIR) for plane in pane)
        np.testing.assert_allclose(
            expected_counts(one_leg(planes=air)), expected_counts(one_leg()), rtol=1e-7
        )

    @pytest.mark.parametrize("name", WORLDS)
    def test_totals(self, name: str) -> None:
        """Codes that tile the period hold all light; the brightest pixel has what it should."""
        world = replace(WORLDS[name], clock=BruteClock(1000, 50.0, 50_000.0))
        pairs = caught(world, stations(world))
        scale = light_scale(world, pairs)
        light = scale * np.bincount(pairs.pixel, pairs.light, minlength=1024)
        counts = expected_counts(world)
        np.testing.assert_allclose(
            counts.sum(axis=2).ravel(), light + 50_000.0 * world.background_per_ps, rtol=1e-12
        )
        assert light.max() == pytest.approx(world.photons, rel=1e-12)
        assert counts.min() > 0.0

    def test_finer_panels_change_nothing(self) -> None:
        world = tank_world(3)
        legs = [stations_of_leg(world, leg, nodes=20) for leg in range(3)]
        names = Stations.__dataclass_fields__
        fine = Stations(*(np.concatenate([getattr(leg, n) for leg in legs]) for n in names))
        scale = light_scale(world)
        np.testing.assert_allclose(
            signal_counts(world, caught(world, stations(world)), scale),
            signal_counts(world, caught(world, fine), scale),
            atol=1e-6,
        )

    @pytest.mark.parametrize("name", WORLDS)
    def test_brightest_pixel_is_met_when_its_light_arrives(self, name: str) -> None:
        """Its light's mean time by a plain sum over points of a leg, each ray solved by itself."""
        world = WORLDS[name]
        counts = expected_counts(replace(world, background_per_ps=0.0))
        row, col = np.unravel_index(counts.sum(axis=2).argmax(), counts.shape[:2])
        light = arrivals = 0.0
        for leg, (start, end) in enumerate(itertools.pairwise(world.vertices_mm)):
            shares = (np.arange(2000) + 0.5) / 2000
            image, seen = images(world, start + shares[:, None] * (end - start))
            area = np.hypot(world.spot_std_px, world.active_side_px / math.sqrt(12.0))
            spot = np.exp(-((image - [row, col]) ** 2).sum(axis=1) / 2.0 / area**2)
            own = spot / seen.spreading_mm2 * np.linalg.norm(end - start)
            index = float(np.broadcast_to(world.path_group_index, world.n_legs)[leg])
            event = world.vertex_times_ps[leg] + shares * index * np.linalg.norm(end - start) / C
            light += own.sum()
            arrivals += own @ (event + seen.group_mm / C)
        middles = 55.0 * (np.arange(909) + 0.5)
        pixel = counts[row, col]
        assert pixel @ middles / pixel.sum() == pytest.approx(arrivals / light, abs=0.01)
        assert abs(middles[pixel.argmax()] - arrivals / light) < 0.75 * 55.0

    def test_recordings_scatter_as_counts_do(self) -> None:
        """20 recordings of 65,536 codes: chi square within 5 sigma."""
        world = replace(one_leg(), background_per_ps=1.0, clock=BruteClock(256, 55.0, 50_000.0))
        mean = expected_counts(world)
        drawn = np.array([recording(world, seed) for seed in range(20)])
        assert drawn.dtype == np.uint32
        np.testing.assert_array_equal(drawn[3], recording(world, 3))
        chi = ((drawn - mean) ** 2 / mean).sum()
        assert abs(chi / drawn.size - 1.0) < 5.0 * math.sqrt(2.1 / drawn.size)

    def test_glass_in_the_beam_makes_it_late(self) -> None:
        block, air = block_world(), replace(block_world(), path_group_index=AIR)
        late = block.vertex_times_ps - air.vertex_times_ps
        delay = 20.0 * (BK7[1] - AIR) / C
        np.testing.assert_allclose(late, [0.0, 0.0, delay, delay], atol=1e-9)
        times = np.linspace(air.vertex_times_ps[2] + delay + 1.0, block.vertex_times_ps[3], 9)
        np.testing.assert_allclose(
            positions_at(block, times), positions_at(air, times - delay), atol=1e-9
        )
        # Clear of the glass, pixels see the same light, later.
        middles = 55.0 * (np.arange(909) + 0.5)

        def mean_ps(world: RefractedScene) -> np.ndarray:
            counts = expected_counts(replace(world, background_per_ps=0.0))
            return np.einsum("rck,k->c", counts, middles) / counts.sum(axis=(0, 2))

        gap = mean_ps(block) - mean_ps(air)
        np.testing.assert_allclose(gap[[0, 5, 26, 31]], [0.0, 0.0, delay, delay], atol=1e-6)

    def test_brightness_goes_by_leg_and_along_it(self) -> None:
        plain = block_world()
        dark = replace(plain, brightness=(1.0, 0.0, lambda mm: np.exp(-mm / 100.0)))
        light, less = stations(plain), stations(dark)
        share = less.light / light.light
        np.testing.assert_allclose(share[light.leg == 0], 1.0)
        np.testing.assert_allclose(share[light.leg == 1], 0.0)
        last = share[light.leg == 2]
        assert (np.diff(last) < 0.0).all()
        assert last[0] == pytest.approx(1.0, abs=0.01)

    def test_legs_through_faces_and_scenes_without_light_are_refused(self) -> None:
        through = replace(tank_world(1), vertices_mm=np.array([[-50.0, 0, 60], [50.0, 0, -90]]))
        with pytest.raises(ValueError, match="leg 0 goes through a plane"):
            expected_counts(through)
        with pytest.raises(ValueError, match="no light"):
            expected_counts(one_leg(vertices_mm=np.array([[900.0, 0, 0], [900.0, 50, 0]])))


class TestBound:
    def test_agrees_with_the_worlds_without_planes(self) -> None:
        """Bins and a Fourier series there; knots of the light apart, which both leave out here."""
        scene = one_leg(vertices_mm=small(paper_scene()).vertices_mm[:3])
        view = view_over_plane(middle=(187.5, 37.5), shape=(16, 16))
        world = World(
            scene.vertices_mm, view, Told(view, scene.vertices_mm[0], 2000.0),
            emission_ps=2000.0, std_ps=scene.pulse_std_ps, spot_std_px=scene.spot_std_px,
            background_per_ps=scene.background_per_ps,
        )  # fmt: skip
        there = fisher(scaled_to(world, scene.photons), brightness_std=0.0)
        here = bound(scene, knot_px=1000.0)
        for name in ("x1", "y1", "z1"):
            assert here.std(name) == pytest.approx(there.std(name), rel=2e-3)

    def test_steps_do_not_matter(self) -> None:
        world = small(tank_world(1))
        also = [medium_freedom([1], 0.005), distance_freedom([0, 1], 1.0)]
        usual = bound(world, fit_emission=True, also=also)
        for share in (0.3, 3.0):
            other = bound(world, fit_emission=True, also=also, step_share=share)
            assert other.position_rms_mm == pytest.approx(usual.position_rms_mm, rel=1e-5)

    def test_what_is_not_known_costs(self) -> None:
        world = small(tank_world(1))
        known = bound(world, knot_px=1000.0, fit_pulse=False)
        assert PULSE.name not in known.names
        unknown = [
            emission_freedom(), medium_freedom([1], 0.005), distance_freedom([0, 1], 1.0)
        ]  # fmt: skip
        for one in unknown:
            freed = bound(world, knot_px=1000.0, also=[one])
            assert freed.position_rms_mm > 1.2 * known.position_rms_mm
        # The width of a symmetric pulse has no say in where it is; nor has what is told exactly.
        told = bound(world, knot_px=1000.0, also=[replace(one, std=1e-9) for one in unknown])
        assert told.position_rms_mm == pytest.approx(known.position_rms_mm, rel=1e-3)
        assert PULSE.name in told.names

    def test_four_times_the_light_halves_it(self) -> None:
        dim = replace(one_leg(), photons=10_000.0, background_per_ps=1e-5)
        bright = replace(dim, photons=40_000.0, background_per_ps=4e-5)
        ratio = bound(dim).position_rms_mm / bound(bright).position_rms_mm
        assert ratio == pytest.approx(2.0, rel=1e-5)

    def test_backgrounds_are_eliminated_as_if_fitted(self) -> None:
        rng = np.random.default_rng(0)
        slopes, mean, width = rng.normal(size=(3, 4, 6)), rng.uniform(1, 9, (4, 6)), np.ones(6)
        pixels = np.einsum("pq,b->pqb", np.eye(4), width)
        every = (np.concatenate([slopes, pixels]) / np.sqrt(mean)).reshape(7, -1)
        found = refracted_bound._information(slopes, mean, width)
        whole = np.linalg.inv(every @ every.T)[:3, :3]
        np.testing.assert_allclose(np.linalg.inv(found), whole, rtol=1e-10)

    def test_scenes_without_background_are_refused(self) -> None:
        with pytest.raises(ValueError, match="give the scene a background"):
            bound(replace(one_leg(), background_per_ps=0.0))


class TestWorlds:
    @pytest.mark.parametrize("name", WORLDS)
    def test_legs_cross_the_picture_and_corners_are_beyond_it(self, name: str) -> None:
        world = WORLDS[name]
        assert not in_picture(world, world.vertices_mm, 2.0).any()
        lit = expected_counts(replace(world, background_per_ps=0.0)).sum(axis=2) > 1000.0
        # Every column sees each leg in a row of its own, or two where legs meet the edge.
        assert (lit.sum(axis=0) >= 1).all()
        for leg in range(world.n_legs):
            alone = replace(world, vertices_mm=world.vertices_mm[leg : leg + 2])
            light = expected_counts(replace(alone, background_per_ps=0.0)).sum(axis=(0, 2))
            assert (light > 0.2 * light.max()).all()

    def test_tank(self) -> None:
        world = tank_world(3)
        back = world.planes[1]
        behind = (world.vertices_mm - back.point_mm) @ back.away_from(world.camera.center)
        assert behind.min() > 100.0
        assert behind.max() < 300.0
        assert world.path_group_index == back.group_beyond
        edge = images(world, np.array([[50.0, 0.0, 0.0]]))[0][0, 1]
        assert edge == pytest.approx(31.5)
        tilted = tank_world(3, 5.0).planes[0].away_from(world.camera.center)
        assert tilted @ [0, 0, -1] == pytest.approx(math.cos(math.radians(5.0)))

    def test_window_moves_the_picture_but_little(self) -> None:
        """A pane brings what is behind nearer by t (1 - 1 / n): 3.4 mm of 535."""
        middle = np.array([[187.5 + 1e-3, 37.5, 0.0]])
        through, air = (sights(middle, s.camera.center, s.planes) for s in
                        (window_world(), paper_scene()))  # fmt: skip
        slope = through.direction[0, 0] / air.direction[0, 0]
        assert 535.0 / slope == pytest.approx(535.0 - 10.0 * (1.0 - AIR / BK7[0]), rel=1e-9)
        late = (through.group_mm - air.group_mm)[0] / C
        assert late == pytest.approx(10.0 * (BK7[1] - AIR) / C, rel=1e-6)
