"""path.tree: paths that fork, written down by hand, in closed form."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError, LimitError
from lightflight.path.error import path_error
from lightflight.path.trace import parted, trace_from_path, traces_of_branches
from lightflight.path.tree import checked_forks, corners_of, leg_starts, outline_mm, ways
from lightflight.reconstruct.model.geometry import PathState, state_of_path
from tests.files.unsealed import unsealed
from tests.path_fakes import PAPER_CAMERA, make_path, random_covariance

C = 0.299792458
VERTICES = np.array(
    [(0, 30, 0), (100, 30, 10), (200, 40, 20), (360, 60, 40), (200, 150, 0), (260, 155, 5)],
    dtype=float,
)
"""Source, a mirror, a splitter; where light that goes on leaves; a mirror on the arm, its end."""
FORKS = ((3, 2),)


def forked(**changes):
    """Five legs: to a splitter over one mirror, one on, two aside."""
    state = PathState(VERTICES, 2000.0, forks=FORKS)
    times = state.vertex_times_ps(lf.Medium())
    covariance = random_covariance(np.random.default_rng(5), 6, scale=0.3)
    given = {"vertex_times_ps": times, "covariance": covariance, "forks": FORKS}
    return make_path(VERTICES, **(given | changes))


class TestShape:
    def test_every_leg_knows_where_it_comes_from(self):
        legs = forked().legs
        assert [leg.number for leg in legs] == [0, 1, 2, 3, 4]
        assert [leg.parent for leg in legs] == [None, 0, 1, 1, 3]
        assert [leg.start_vertex for leg in legs] == [0, 1, 2, 2, 4]
        assert [leg.end_vertex for leg in legs] == [1, 2, 3, 4, 5]
        np.testing.assert_array_equal(legs[3].start_mm, VERTICES[2])
        assert legs[3].start_time_ps == forked().vertex_times_ps[2]
        chain = make_path()
        assert [leg.parent for leg in chain.legs] == [None, 0, 1]
        assert [leg.start_vertex for leg in chain.legs] == [0, 1, 2]

    def test_ends_and_branches(self):
        path = forked()
        assert path.ends == (0, 3, 5)
        assert make_path().ends == (0, 3)
        one, other = path.branches
        np.testing.assert_array_equal(one.vertices_mm, VERTICES[[0, 1, 2, 3]])
        np.testing.assert_array_equal(other.vertices_mm, VERTICES[[0, 1, 2, 4, 5]])
        assert one.forks == other.forks == ()
        rows = np.r_[0:12, 16:24]
        np.testing.assert_array_equal(other.covariance, path.covariance[np.ix_(rows, rows)])
        chain = make_path()
        assert chain.branches == (chain,)

    def test_the_angle_has_the_error_of_the_legs_own_two_ends(self):
        path = forked()
        leg, alone = path.legs[3], path.branches[1].legs[2]
        assert leg.angle_deg == alone.angle_deg
        assert leg.angle_std_deg == alone.angle_std_deg
        assert leg.angle_std_deg > 0

    def test_pulses_go_with_their_leg(self):
        table = np.zeros(5, lf.path.RESIDUAL_DTYPE)
        table["leg"], table["row"] = np.arange(5), np.arange(5)
        one, other = forked(residuals=table).branches
        assert one.residuals["row"].tolist() == [0, 1, 2]
        assert other.residuals["row"].tolist() == [0, 1, 3, 4]
        assert other.residuals["leg"].tolist() == [0, 1, 2, 3]

    def test_an_unseen_leg_keeps_its_place_on_its_branch(self):
        vertices = np.vstack((VERTICES, (300, 160, 5)))
        times = PathState(vertices, 0.0, forks=FORKS).vertex_times_ps(lf.Medium())
        path = make_path(vertices, vertex_times_ps=times, forks=FORKS, unseen_legs=(4,))
        one, other = path.branches
        assert one.unseen_legs == ()
        assert other.unseen_legs == (3,)
        assert path.gaps[0].after_leg == 3
        assert path.gaps[0].delay_ps == pytest.approx(other.gaps[0].delay_ps)

    def test_three_ways_from_one_splitter(self):
        starts = leg_starts(4, ((2, 1), (3, 1)))
        assert ways(starts) == ((0, 1), (0, 2), (0, 3))

    def test_the_state_of_a_path_forks_as_it_does(self):
        state = state_of_path(forked())
        assert state.forks == FORKS
        np.testing.assert_allclose(state.vertex_times_ps(lf.Medium()), forked().vertex_times_ps)

    @pytest.mark.parametrize(
        "forks",
        [
            ((3, 3),),
            ((3, 4),),
            ((3, -1),),
            ((3, 0),),
            ((5, 1),),
            ((-1, 1),),
            ((3, 1), (3, 2)),
            ((3, 1.5),),
            ((3,),),
            3,
            ((3, np.nan),),
            ((True, 1),),
        ],
    )
    def test_what_is_no_fork_is_refused(self, forks):
        with pytest.raises(ValueError, match=r"forks must be pairs \(leg, vertex\)"):
            forked(forks=forks)

    def test_times_ascend_along_each_leg(self):
        times = forked().vertex_times_ps.copy()
        times[4] = times[2] - 1.0
        with pytest.raises(ValueError, match="ascend along each leg"):
            forked(vertex_times_ps=times)
        times[4] = times[3] - 100.0
        # An arm may end before the other one does.
        assert forked(vertex_times_ps=times).ends == (0, 3, 5)

    def test_no_unseen_leg_at_a_fork(self):
        with pytest.raises(ValueError, match="cannot begin or end at a fork"):
            forked(unseen_legs=(1,))


class TestClock:
    def test_before_the_split_no_branch_is_asked_for(self):
        path = forked()
        times = np.linspace(path.vertex_times_ps[0], path.vertex_times_ps[2], 9)
        np.testing.assert_allclose(path.position_at(times), path.branches[0].position_at(times))
        assert path.leg_at(times[:-1]).tolist() == [0, 0, 0, 0, 1, 1, 1, 1]
        np.testing.assert_allclose(
            path.position_covariance_at(times[:-1]),
            path.branches[1].position_covariance_at(times[:-1]),
        )

    def test_where_two_are_alight_one_must_be_named(self):
        path = forked()
        when = [path.vertex_times_ps[2] + 50.0]
        for ask in (path.position_at, path.leg_at, path.is_seen_at, path.position_covariance_at):
            with pytest.raises(ValueError, match=r"several legs at once.*branch=0 to 1"):
                ask(when)
        for branch, leg in ((0, 2), (1, 3)):
            own = path.legs[leg]
            share = 50.0 / (own.end_time_ps - own.start_time_ps)
            expected = own.start_mm + share * (own.end_mm - own.start_mm)
            np.testing.assert_allclose(path.position_at(when, branch=branch)[0], expected)
            assert path.leg_at(when, branch=branch).tolist() == [leg]
            assert path.is_seen_at(when, branch=branch).tolist() == [True]
            np.testing.assert_allclose(
                path.position_covariance_at(when, branch=branch),
                path.branches[branch].position_covariance_at(when),
            )

    def test_a_corner_of_one_arm_is_no_fork(self):
        """At that very moment the other arm is alight, too."""
        path = forked()
        assert path.vertex_times_ps[4] < path.vertex_times_ps[3]
        with pytest.raises(ValueError, match="several legs at once"):
            path.position_at([path.vertex_times_ps[4]])

    def test_alone_again_it_needs_no_name_and_beyond_the_end_it_is_nowhere(self):
        path = forked()
        assert path.vertex_times_ps[5] > path.vertex_times_ps[3]
        late = 0.5 * (path.vertex_times_ps[5] + path.vertex_times_ps[3])
        np.testing.assert_allclose(path.position_at([late]), path.position_at([late], branch=1))
        assert np.isnan(path.position_at([path.vertex_times_ps[5] + 1.0])).all()
        assert np.isnan(path.position_at([late], branch=0)).all()

    @pytest.mark.parametrize("branch", [2, -1, 1.5, "one"])
    def test_other_branches_are_refused(self, branch):
        with pytest.raises((ValueError, TypeError), match="branch"):
            forked().position_at([2000.0], branch=branch)

    def test_samples_pass_each_leg_once(self):
        path = forked()
        table = path.sample(2001)
        assert (np.diff(table["leg"]) >= 0).all()
        lasting = np.array([leg.end_time_ps - leg.start_time_ps for leg in path.legs])
        counted = np.bincount(table["leg"])
        np.testing.assert_allclose(counted / 2001, lasting / lasting.sum(), atol=1e-3)
        for k, branch in enumerate(path.branches):
            own = np.isin(table["leg"], ways(leg_starts(5, FORKS))[k])
            place = branch.position_at(table["event_time_ps"][own])
            for axis, name in enumerate(("x_mm", "y_mm", "z_mm")):
                np.testing.assert_allclose(table[name][own], place[:, axis], atol=1e-9)
            std = np.sqrt(
                branch.position_covariance_at(table["event_time_ps"][own])[:, [0, 1, 2], [0, 1, 2]]
            )
            np.testing.assert_allclose(table["x_std_mm"][own], std[:, 0], atol=1e-9)


class TestTraces:
    def test_an_arm_is_drawn_from_its_fork(self):
        path = forked()
        trace = trace_from_path(path, per_leg=5)
        first = np.flatnonzero(trace.leg == 3)[0]
        np.testing.assert_allclose(trace.points_mm[first], VERTICES[2])
        assert trace.event_time_ps[first] == path.vertex_times_ps[2]
        before = sum(path.legs[k].length_mm for k in (0, 1))
        assert trace.length_mm[first] == pytest.approx(before)
        straight = parted(trace, trace.points_mm)
        assert np.flatnonzero(np.isnan(straight).all(axis=1)).tolist() == [first]
        chain = trace_from_path(make_path(), per_leg=5)
        np.testing.assert_array_equal(parted(chain, chain.points_mm), chain.points_mm)

    def test_both_times_ascend_on_every_branch(self):
        path = forked()
        trace = trace_from_path(path)
        branches = traces_of_branches(trace, path)
        assert [sorted(set(one.leg)) for one in branches] == [[0, 1, 2], [0, 1, 3, 4]]
        for one in branches:
            assert (np.diff(one.event_time_ps) >= 0).all()
            assert (np.diff(one.arrival_ps) >= 0).all()

    def test_an_outline_breaks_at_a_fork(self):
        outline = outline_mm(forked())
        np.testing.assert_array_equal(outline[:4], VERTICES[:4])
        assert np.isnan(outline[4]).all()
        np.testing.assert_array_equal(outline[5:], VERTICES[[2, 4, 5]])
        np.testing.assert_array_equal(outline_mm(make_path()), make_path().vertices_mm)

    def test_a_splitter_turns_light_by_the_arm_that_turns_most(self):
        places = {number: after for number, _, _, after in corners_of(forked())}
        assert sorted(places) == [1, 2, 4]
        np.testing.assert_array_equal(places[2], VERTICES[4])

    def test_another_camera_sees_both_arms(self):
        seen = lf.observe(forked(), PAPER_CAMERA)
        assert set(seen.leg) == {0, 1, 2, 3, 4}
        arm = seen.leg == 3
        assert seen.event_time_ps[arm].min() == pytest.approx(forked().vertex_times_ps[2], abs=2.0)


class TestError:
    def truth(self, shift=0.0):
        path = forked()
        vertices = VERTICES.copy()
        vertices[4:, 2] += shift
        return SimpleNamespace(
            vertices_mm=vertices, vertex_times_ps=path.vertex_times_ps, forks=FORKS
        )

    def test_nothing_is_off_from_itself(self):
        error = path_error(forked(), self.truth(), PAPER_CAMERA)
        assert error.position_rms_mm == pytest.approx(0.0, abs=1e-9)
        assert error.event_time_rms_ps == pytest.approx(0.0, abs=1e-6)

    def test_the_order_of_the_arms_does_not_matter(self):
        order = [0, 1, 2, 4, 5, 3]
        path = forked()
        other = make_path(
            VERTICES[order], vertex_times_ps=path.vertex_times_ps[order], forks=((4, 2),)
        )
        assert path_error(other, self.truth(), PAPER_CAMERA).position_rms_mm < 1e-9

    def test_one_arm_off_counts_by_its_share_of_the_way(self):
        """Of branch 1 in view that share which the arm takes is off, by up to 6 mm."""
        path, truth = forked(), self.truth(shift=6.0)
        error = path_error(path, truth, PAPER_CAMERA)
        branches = [
            path_error(one, SimpleNamespace(vertices_mm=truth.vertices_mm[chain],
                                            vertex_times_ps=truth.vertex_times_ps[chain]),
                       PAPER_CAMERA, whole=False).position_rms_mm
            for one, chain in zip(path.branches, ([0, 1, 2, 3], [0, 1, 2, 4, 5]), strict=True)
        ]  # fmt: skip
        assert branches[0] == pytest.approx(0.0, abs=1e-9)
        assert 2.0 < branches[1] < 6.0
        assert branches[1] / np.sqrt(2.0) == pytest.approx(error.position_rms_mm, rel=0.15)

    def test_an_arm_that_was_missed_counts_and_one_too_many_as_well(self):
        path = forked()
        missed = path_error(path.branches[0], self.truth(), PAPER_CAMERA).position_rms_mm
        chain = SimpleNamespace(vertices_mm=VERTICES[:4], vertex_times_ps=path.vertex_times_ps[:4])
        invented = path_error(path, chain, PAPER_CAMERA).position_rms_mm
        assert missed > 20.0
        assert invented > 20.0


class TestFile:
    def test_a_path_that_forks_comes_back(self, tmp_path):
        truth = SimpleNamespace(
            vertices_mm=VERTICES, vertex_times_ps=forked().vertex_times_ps, forks=FORKS
        )
        forked(truth=truth).save(tmp_path / "path.h5")
        found = lf.LightPath.load(tmp_path / "path.h5")
        assert found.forks == found.truth.forks == FORKS
        np.testing.assert_array_equal(found.covariance, forked().covariance)
        assert schema_of(tmp_path / "path.h5") == 3

    def test_only_what_forks_needs_a_newer_reader(self, tmp_path):
        make_path().save(tmp_path / "chain.h5")
        assert schema_of(tmp_path / "chain.h5") == 1
        truth = SimpleNamespace(
            vertices_mm=VERTICES, vertex_times_ps=forked().vertex_times_ps, forks=FORKS
        )
        # An older reader would draw its truth from the wrong vertex.
        make_path(truth=truth).save(tmp_path / "truth.h5")
        assert schema_of(tmp_path / "truth.h5") == 3

    @pytest.mark.parametrize(
        "forks",
        [
            [[3, -2]],
            [[3, 3]],
            [[3, 4]],
            [[99, 2]],
            [[3, 2], [3, 1]],
            [[3.0, 2.0]],
            [[3, 2, 1]],
            [["3", 2]],
            [[True, 1]],
            "32",
            {"3": 2},
            [[3, 2]] * 20_000,
            [[k, 1] for k in range(2, 5000)],
        ],
    )
    @pytest.mark.parametrize("name", ["forks", "truth_forks"])
    def test_hostile_forks_are_refused(self, tmp_path, forks, name):
        truth = SimpleNamespace(
            vertices_mm=VERTICES, vertex_times_ps=forked().vertex_times_ps, forks=FORKS
        )
        forked(truth=truth).save(tmp_path / "path.h5")
        rewrite_attribute(tmp_path / "path.h5", name, [[3, 2]])
        assert lf.LightPath.load(tmp_path / "path.h5").forks == FORKS
        rewrite_attribute(tmp_path / "path.h5", name, forks)
        with pytest.raises((FileFormatError, LimitError), match="forks"):
            lf.LightPath.load(tmp_path / "path.h5")

    def test_of_a_hundred_legs_at_most_all_may_fork(self):
        forks = tuple((leg, 1) for leg in range(2, 100))
        assert checked_forks(forks, 100) == forks
        vertices = np.vstack(([(0.0, 0.0, 0.0), (50.0, 0.0, 0.0)],
                              [(60.0, k, 0.0) for k in range(99)]))  # fmt: skip
        times = PathState(vertices, 0.0, forks=forks).vertex_times_ps(lf.Medium())
        assert len(make_path(vertices, vertex_times_ps=times, forks=forks).branches) == 99


def schema_of(file):
    with h5py.File(file) as opened:
        return int(opened.attrs["schema_version"])


def rewrite_attribute(file, name, value):
    with unsealed(file) as opened:
        attributes = json.loads(opened["attributes"][()])
        attributes[name] = value
        del opened["attributes"]
        text = json.dumps(attributes).encode()
        opened["attributes"] = np.array(text, h5py.string_dtype("utf-8", len(text)))


def test_a_chain_with_every_option_is_what_it_was():
    """One that names no fork: same record, by value, as one that was made before there were any."""
    path = make_path(covariance=random_covariance(np.random.default_rng(1), 4, scale=0.2))
    again = replace(path, forks=())
    np.testing.assert_array_equal(path.sample(50), again.sample(50))
    times = np.linspace(2000.0, path.vertex_times_ps[-1], 77)
    np.testing.assert_array_equal(path.position_at(times), path.position_at(times, branch=0))
