"""Planning: the bound turned round, places of the camera, arrays, and sharpness by angle."""

from types import SimpleNamespace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import GeometryError
from lightflight.reconstruct.limits.planning import angle_deg_per_ps, moved_to, resized
from lightflight.simulate.presets import paper_scene


@pytest.fixture(scope="module")
def scene():
    return paper_scene()


@pytest.fixture(scope="module")
def planned(scene):
    return lf.plan(scene)


def leg_at(angle_deg, start_mm=-122.5, length_mm=245.0):
    """One leg in the plane of the paper's camera, from the edge of its field."""
    direction = np.array([np.cos(np.radians(angle_deg)), 0.0, np.sin(np.radians(angle_deg))])
    start = np.array([start_mm, 0.0, 0.0])
    return SimpleNamespace(vertices_mm=np.array([start, start + length_mm * direction]))


class TestWhatIsWanted:
    @pytest.mark.parametrize(
        ("name", "value"),
        [("position_rms_mm", 0.3), ("event_time_rms_ps", 0.8), ("angle_std_deg", 0.05)],
    )
    def test_the_photons_it_names_reach_it(self, scene, name, value):
        place = lf.plan(scene, **{name: value}, array_shapes=()).placements[0]
        reached = lf.bounds(scene, photons_per_pixel=place.photons_per_pixel)
        figure = np.max(getattr(reached, name))
        assert figure <= value
        assert figure > 0.98 * value  # no more light than needed, to 1 %

    def test_a_rate_makes_it_a_time(self, scene):
        found = lf.plan(scene, position_rms_mm=0.3, rate_hz=200.0, array_shapes=())
        place = found.placements[0]
        assert place.seconds == pytest.approx(place.photons_per_pixel / 200.0)

    def test_no_light_reaches_below_what_priors_leave(self, scene):
        source = lf.Source((0.0, 0.0, 0.0), position_std_mm=1.0, pulse_fwhm_ps=68.0)
        found = lf.plan(scene, position_rms_mm=1e-3, source=source, array_shapes=())
        assert np.isinf(found.placements[0].photons_per_pixel)
        assert any("No light reaches" in said for said in found.statements)

    @pytest.mark.parametrize("name", ["position_rms_mm", "rate_hz"])
    def test_it_must_be_positive(self, scene, name):
        with pytest.raises(ValueError, match=f"{name} must be positive"):
            lf.plan(scene, **{name: 0.0})


class TestPlaces:
    def test_best_first_and_blind_ones_apart(self, scene):
        away = lf.Camera.facing_plane(center_mm=(5000.0, 0.0))
        found = lf.plan(scene, cameras={"side": (600.0, 37.0, 300.0), "off": away}, array_shapes=())
        errors = [place.bounds.position_rms_mm for place in found.placements]
        assert [place.name for place in found.placements] == ["as given", "side"]
        assert errors == sorted(errors)
        assert "does not see leg" in found.blind["off"]

    def test_no_place_that_sees_the_path_is_an_error(self, scene):
        with pytest.raises(GeometryError, match="does not see"):
            lf.plan(scene, camera=lf.Camera.facing_plane(center_mm=(5000.0, 0.0)))

    def test_a_moved_camera_looks_at_the_target_in_its_middle_and_is_not_rolled(self, scene):
        target = np.array([100.0, 20.0, -30.0])
        moved = moved_to(scene.camera, (600.0, 37.0, 300.0), target)
        row, col = moved.pixels_from_points(target[None])
        assert row == pytest.approx([15.5])
        assert col == pytest.approx([15.5])
        assert moved.center_mm == pytest.approx([600.0, 37.0, 300.0])
        level = moved.world_from_camera[:3, 0]
        assert level[1] == pytest.approx(0.0, abs=1e-12)

    def test_a_place_must_be_three_numbers(self, scene):
        with pytest.raises(ValueError, match="three finite numbers"):
            lf.plan(scene, cameras={"flat": (1.0, 2.0)})


class TestArrays:
    def test_finer_pixels_share_the_same_light_and_edges(self, scene, planned):
        fine = resized(scene.camera, (64, 64))
        corner = [
            camera.rays_from_pixels(*([np.array([-0.5])] * 2)) for camera in (scene.camera, fine)
        ]
        assert corner[0] == pytest.approx(corner[1], abs=1e-12)
        photons = [choice.bounds.photons for choice in planned.arrays]
        assert photons == pytest.approx([photons[0]] * len(photons), rel=1e-3)

    def test_coarse_pixels_lose_and_fine_ones_hardly_gain(self, planned):
        coarse, usual, *_, finest = (choice.bounds.position_rms_mm for choice in planned.arrays)
        assert coarse > 1.2 * usual
        assert finest == pytest.approx(usual, rel=0.1)


class TestSharpness:
    """Against design figures: 0.019 deg/ps at 0 deg with 32 pixels; away sharp, towards not."""

    camera = lf.Camera.facing_plane()

    def test_flat_leg(self):
        assert angle_deg_per_ps(leg_at(0.0), self.camera)[0] == pytest.approx(0.019, rel=0.01)

    def test_steep_towards_is_blunt_and_steep_away_is_sharp(self):
        towards = angle_deg_per_ps(leg_at(60.0, length_mm=490.0), self.camera)[0]
        away = angle_deg_per_ps(leg_at(-60.0, length_mm=2000.0), self.camera)[0]
        assert towards == pytest.approx(0.039, rel=0.02)
        assert away < 0.004

    @pytest.mark.parametrize("angle_deg", [-50.0, -10.0, 0.0, 35.0])
    def test_against_arrival_times_marched_along_tilted_legs(self, angle_deg):
        """The same slope from points on tilted legs, by nothing but distances."""
        scene = leg_at(angle_deg)
        start, end = scene.vertices_mm
        center = self.camera.center_mm
        fractions = np.linspace(0.0, 1.0, 20_001)[:, None]

        def arrival_at_columns(angle):
            direction = np.array([np.cos(np.radians(angle)), 0.0, np.sin(np.radians(angle))])
            length = 1.2 * np.linalg.norm(end - start) * fractions
            points = start + length * direction
            flight = (
                1.00027 * (length[:, 0] + np.linalg.norm(points - center, axis=1)) / 0.299792458
            )
            _, col = self.camera.pixels_from_points(points)
            seen = self.camera.sees(start + fractions * (end - start))
            _, wanted = self.camera.pixels_from_points((start + fractions * (end - start))[seen])
            columns = np.arange(wanted.min() + 0.5, wanted.max(), 1.0)
            return np.interp(columns, col, flight)

        slope = (arrival_at_columns(angle_deg + 0.05) - arrival_at_columns(angle_deg - 0.05)) / 0.1
        expected = 1.0 / np.sqrt(np.sum(slope[1:] ** 2))
        found = angle_deg_per_ps(scene, self.camera)[0]
        assert found == pytest.approx(expected, rel=0.05)

    def test_it_says_so(self, scene):
        camera = moved_to(scene.camera, (900.0, 37.0, 100.0), (187.5, 37.5, 30.0))
        said = " ".join(lf.plan(scene, camera=camera, array_shapes=()).statements)
        assert "steeply towards" in said
        assert "blunt" in said
        assert "sharp" in said
