"""Legs that only one of several cameras sees, and clocks that are apart: an oracle's recordings.

Full tables: benchmarks/several_cameras.py.
"""

import importlib

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.lab import lab_from_table, lab_from_toml, toml_from_lab
from lightflight.path.verdict import Level
from lightflight.reconstruct.trials.images import _orders
from tests.oracles import several_views
from tests.oracles.refracted_bound import bound, emission_freedom

RUNS = 1
FALSE_ALARM = 1e-5


def inner(path, scenes):
    """Squared distance of both corners from the truth by the stated covariance; that, (6, 6)."""
    off = (path.vertices_mm - scenes[0].vertices_mm)[1:3].ravel()
    at = np.r_[4:7, 8:11]
    stated = path.covariance[np.ix_(at, at)]
    return float(off @ np.linalg.solve(stated, off)), stated


def between(degrees):
    """What a chi-square passes on either side with the chance of a false alarm."""
    return chi2.ppf(FALSE_ALARM, degrees), chi2.ppf(1.0 - FALSE_ALARM, degrees)


def found(scenes, seed, *, offsets=(0.0, 0.0), std_ps=0.0, **options):
    recordings = several_views.recorded(several_views.late(scenes, offsets), seed)
    call = several_views.told(scenes, recordings, emission_known=False, offset_std_ps=std_ps)
    return lf.reconstruct(recordings, **call, **options)


@pytest.mark.usefixtures("nothing_twice")
class TestLegsThatOneCameraSees:
    @pytest.mark.parametrize(
        "turned", [False, pytest.param(True, marks=pytest.mark.long)], ids=["as told", "turned"]
    )
    @pytest.mark.parametrize("scenes_of", [several_views.parted, several_views.beside])
    def test_errors_are_those_stated(self, scenes_of, turned, unexamined):
        """Squared distance of both corners from the truth by the stated covariance: chi-square of
        6 per recording; either side is passed by chance 1e-5, 8e-5 over the four cells.
        """
        scenes = scenes_of(turned=turned)
        total = 0.0
        for seed in range(71, 71 + RUNS):
            path = found(scenes, seed)
            assert path.n_legs == 3
            total += inner(path, scenes)[0]
        low, high = between(6 * RUNS)
        assert low < total < high

    def test_the_order_of_cameras_does_not_change_the_path(self, unexamined):
        """The same recordings, told in either order: within a tenth of an error."""
        scenes = several_views.parted()
        recordings = several_views.recorded(scenes, 75)
        paths = []
        for order in (slice(None), slice(None, None, -1)):
            call = several_views.told(scenes[order], recordings[order], emission_known=False)
            paths.append(lf.reconstruct(recordings[order], **call))
        one, other = paths
        off = (one.vertices_mm - other.vertices_mm)[1:3] / one.vertex_std[1:3, :3]
        assert np.abs(off).max() < 0.1
        np.testing.assert_allclose(one.vertices_mm[-1], other.vertices_mm[-1], atol=0.1)

    def test_all_counts_take_them_too(self, unexamined):
        """One recording: chi-square of 6, passed by chance 1e-5 on either side; stated is what such
        counts can tell at best, not less and hardly more.
        """
        scenes = several_views.parted(photons=4_000.0)
        squared, stated = inner(found(scenes, 76, method="photon"), scenes)
        low, high = between(6)
        assert low < squared < high
        least = bound(scenes[0], others=scenes[1:], also=(emission_freedom(),)).block(
            ["x1", "y1", "z1", "x2", "y2", "z2"]
        )
        assert 0.9 < np.sqrt(np.trace(stated) / np.trace(least)) < 1.15


@pytest.mark.usefixtures("nothing_twice")
class TestClocksThatAreApart:
    @pytest.mark.parametrize(("method", "std_ps"), [("joint", 50.0), ("photon", np.inf)])
    def test_errors_are_those_stated(self, method, std_ps, unexamined):
        """Offsets drawn from the prior (500 ps where nothing is known): chi-square of 6 per
        recording; either side is passed by chance 1e-5, 4e-5 over both cells.
        """
        scenes = several_views.parted()
        rng, total = np.random.default_rng(7), 0.0
        for seed in range(81, 81 + RUNS):
            late = (0.0, float(rng.normal(0.0, min(std_ps, 500.0))))
            path = found(scenes, seed, offsets=late, std_ps=std_ps, method=method)
            assert path.n_legs == 3
            total += inner(path, scenes)[0]
        low, high = between(6 * RUNS)
        assert low < total < high

    def test_not_knowing_costs_something(self, unexamined):
        scenes = several_views.parted()
        sizes = [found(scenes, 85, std_ps=std).vertex_std[1:3].mean() for std in (0.0, 1.0, np.inf)]
        assert sizes[0] < sizes[1] < sizes[2]

    def test_an_offset_that_is_told_is_taken_off(self, unexamined):
        scenes = several_views.parted()
        recordings = several_views.recorded(several_views.late(scenes, (0.0, 3200.0)), 86)
        call = several_views.told(scenes, recordings, emission_known=False)
        plain = [camera.to_arrays() for camera in call["camera"]]
        call["camera"] = [
            lf.Camera.from_arrays(arrays | {"clock_offset_ps": late})
            for arrays, late in zip(plain, (0.0, 3200.0), strict=True)
        ]
        squared, _ = inner(lf.reconstruct(recordings, **call), scenes)
        assert squared < chi2.ppf(1.0 - FALSE_ALARM, 6)

    def test_a_wrong_one_is_named(self, as_found, monkeypatch):
        """20 ps on a clock told as exact: many sigmas, so that chance plays no part.

        Most of the time would go to paths that begin with what one camera shows.
        """
        answer = importlib.import_module("lightflight.reconstruct.answer")
        monkeypatch.setattr(answer, "_begun_by_one_camera", lambda found, *_: found)
        scenes = several_views.parted(photons=4_000.0)
        with pytest.warns(SuspectDataWarning, match="clock of camera 2"):
            path = found(scenes, 87, offsets=(0.0, 20.0))
        assert path.verdict.level is Level.CONTRADICTED
        assert path.verdict.findings[0].name == "clock_offset"

    def test_freed_it_comes_out(self, unexamined):
        scenes = several_views.parted(photons=4_000.0)
        path = found(scenes, 88, offsets=(0.0, 20.0), free="clock_offset")
        assert inner(path, scenes)[0] < chi2.ppf(1.0 - FALSE_ALARM, 6)


def test_orders_keep_those_of_every_picture():
    assert list(_orders(((0, 1), (1, 2)))) == [(0, 1, 2)]
    assert sorted(_orders(((0, 1), (2,)))) == [(0, 1, 2), (0, 2, 1), (2, 0, 1)]
    assert list(_orders(((0, 1), (1, 0)))) == []


class TestCamera:
    def test_what_is_told_of_its_clock_is_kept(self):
        camera = lf.Camera.facing_plane()
        late = lf.Camera.from_arrays(
            camera.to_arrays() | {"clock_offset_ps": 12.5, "clock_offset_std_ps": np.inf}
        )
        again = lf.Camera.from_arrays(late.to_arrays())
        assert (again.clock_offset_ps, again.clock_offset_std_ps) == (12.5, np.inf)
        assert "clock_offset_ps" not in camera.to_arrays()

    def test_light_arrives_later_on_its_clock(self):
        camera = lf.Camera.facing_plane()
        late = lf.Camera.from_arrays(camera.to_arrays() | {"clock_offset_ps": 12.5})
        times = [one.return_times_ps([[0.0, 0.0, 0.0]], return_group_index=1.0)
                 for one in (camera, late)]  # fmt: skip
        assert times[1] - times[0] == pytest.approx(12.5, abs=1e-9)

    @pytest.mark.parametrize("std", [-1.0, np.nan, -np.inf])
    def test_an_error_that_is_none_is_refused(self, std):
        with pytest.raises(ValueError, match="clock_offset_std_ps"):
            lf.Camera.from_arrays(
                lf.Camera.facing_plane().to_arrays() | {"clock_offset_std_ps": std}
            )

    def test_the_set_up_says_it(self, tmp_path):
        table = {"camera": {"distance_mm": 500.0, "field_of_view_mm": [200.0, 200.0],
                            "clock_offset_ps": -30.0, "clock_offset_std_ps": np.inf}}  # fmt: skip
        lab = lab_from_table(table)
        assert lab.camera.clock_offset_ps == -30.0
        path = tmp_path / "lab.toml"
        path.write_text(toml_from_lab(lab))
        again = lab_from_toml(path)
        assert again.camera.clock_offset_ps == -30.0
        assert again.camera.clock_offset_std_ps == np.inf
