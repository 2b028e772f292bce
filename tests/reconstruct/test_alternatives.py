"""Recordings that two paths explain: the true one is told, and how likely each is comes out right.

The evidence of a path, Laplace's approximation in the package, is held against nested sampling
(dynesty: Speagle 2020, MNRAS 493, 3132) of a likelihood that the tests work out by themselves.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import dynesty
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.flight import Medium, twin_from_direction
from lightflight.path.verdict import FindingName, Level
from lightflight.reconstruct.fit.ends import freedom_at
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.least_squares import fit_path
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import mean_focal_px
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.reconstruct.trials.marginal import ANYWHERE_MM
from lightflight.reconstruct.trials.rivals import Rival, rivals_of
from lightflight.reconstruct.ways.joint import fit_of_request
from lightflight.reconstruct.ways.request import Request
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from tests.labs import known_path, one_leg, three_legs
from tests.oracles.other_answers import (
    FIBRE,
    Measured,
    cornered_scene,
    fibre_scene,
    light_seems_to_run,
)
from tests.oracles.refracted import AIR, RefractedScene
from tests.oracles.refracted_border import histograms, what_the_user_tells


@cache
def told(scene: RefractedScene, seed: int) -> lf.LightPath:
    """What a user gets who knows where the light of a fibre starts, and not when."""
    hist = histograms(scene, seed)
    fibre = scene.path_group_index != AIR
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        return lf.reconstruct(hist, **what_the_user_tells(scene, hist, emission_known=not fibre))


def is_true(path: lf.LightPath, scene: RefractedScene) -> bool:
    """Whether the elevation is within four stated errors of the truth."""
    step = np.diff(scene.vertices_mm, axis=0)[0]
    true = np.rad2deg(np.arcsin(step[2] / np.linalg.norm(step)))
    leg = path.legs[0]
    return bool(abs(leg.angle_deg - true) < 4.0 * leg.angle_std_deg)


class TestTheTwinOfADirection:
    @pytest.mark.parametrize("seed", range(20))
    def test_it_seems_as_fast_and_is_its_twin_s_twin(self, seed):
        rng = np.random.default_rng([seed, 3])
        direction, towards = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        medium = Medium(FIBRE, AIR)
        twin = twin_from_direction(direction, towards, medium=medium)
        seems = [light_seems_to_run(one, towards, FIBRE) for one in (direction, twin)]
        assert seems[1] == pytest.approx(seems[0], rel=1e-12)
        assert np.linalg.norm(twin) == pytest.approx(1.0)
        assert abs(twin @ towards - direction @ towards) > 1e-3
        back = twin_from_direction(twin, towards, medium=medium)
        np.testing.assert_allclose(back, direction, atol=1e-12)

    def test_in_one_medium_there_is_none(self):
        assert np.isnan(twin_from_direction([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])).all()


@pytest.mark.parametrize("out", [AIR, 1.33, FIBRE, 3.0])
def test_slope_and_bend_of_an_arrival_curve_are_those_of_one_direction(out):
    """With nothing told of depth a leg fixes the ratio of the two: no two directions share it."""
    angle, step = np.linspace(-1.45, 1.45, 2001), 1e-4

    def arrival(psi: Any) -> Any:
        return out * np.tan(psi) + AIR / np.cos(psi)

    ahead, here, behind = (arrival(angle + k * step) for k in (1, 0, -1))
    slope, bend = (ahead - behind) / (2.0 * step), (ahead - 2.0 * here + behind) / step**2
    assert (np.diff(bend / slope) > 0.0).all()


N = 5


class TestALegTurnedInDepth:
    """Five recordings of each direction, seeds 100 to 104, 100 photons in the brightest pixel.

    Of two answers within a factor of 100 the truth is missed at most once in a hundred; that more
    than two of five are, has a chance of 1e-5.
    """

    @pytest.mark.parametrize(
        "elevation_deg",
        [pytest.param(30.0, marks=pytest.mark.long), pytest.param(57.0, marks=pytest.mark.long)],
    )
    def test_the_true_direction_is_told(self, elevation_deg):
        scene = scene_of_fibre(elevation_deg)
        paths = [told(scene, 100 + seed) for seed in range(N)]
        hit = [is_true(p, scene) or any(is_true(a.path, scene) for a in p.alternatives)
               for p in paths]  # fmt: skip
        assert sum(hit) >= N - 2
        listed = [path for path in paths if path.alternatives]
        assert len(listed) >= N // 2
        for path in listed:
            ((other,), (*_, finding)) = path.alternatives, path.verdict.findings
            assert path.verdict.level is Level.CHECK
            assert finding.name is FindingName.ALTERNATIVE
            assert other.says == "leg 1 turned in depth"
            assert other.log_evidence >= -np.log(100.0)
            # They are on either side of the direction that seems the fastest.
            angles = [one.legs[0].angle_deg for one in (path, other.path)]
            assert min(angles) < np.rad2deg(np.arcsin(AIR / FIBRE)) + 3.0 < max(angles) + 6.0

    def test_it_can_be_chosen(self):
        scene = scene_of_fibre(30.0)
        seed = next(100 + k for k in range(N) if told(scene, 100 + k).alternatives)
        hist, other = histograms(scene, seed), told(scene, seed).alternatives[0].path
        call = what_the_user_tells(scene, hist, emission_known=False)
        chosen = lf.reconstruct(hist, start=other, **call)
        assert chosen.legs[0].angle_deg == pytest.approx(other.legs[0].angle_deg, abs=0.2)
        assert chosen.alternatives == ()

    def test_with_nothing_told_there_is_one_answer(self):
        scene = fibre_scene(30.0, 1000.0, 245.0)
        hist = histograms(scene, 100)
        call = what_the_user_tells(scene, hist) | {"source": lf.Source()}
        path = lf.reconstruct(hist, **call)
        assert is_true(path, scene)
        assert path.alternatives == ()

    def test_bright_light_tells_by_itself(self):
        scene = fibre_scene(30.0, 40_000.0, 245.0)
        assert told(scene, 1).alternatives == ()
        assert told(scene, 1).verdict.level is Level.TRUST


@cache
def scene_of_fibre(elevation_deg: float) -> RefractedScene:
    return fibre_scene(elevation_deg, 100.0)


@cache
def scene_with_corner(turn_deg: float, way: str, photons: float) -> RefractedScene:
    return cornered_scene(turn_deg, way, photons)


class TestStraightOrBent:
    def test_two_legs_that_the_search_takes_for_a_curve_are_the_answer(self):
        """A corner of ten degrees in the picture: the two legs are far likelier, and are told."""
        scene = scene_with_corner(10.0, "picture", 1000.0)
        path = told(scene, 100)
        assert path.n_legs == 2
        assert path.bends == ()
        # A curve that is hardly possible is no other answer.
        assert path.alternatives == ()
        assert path.verdict.level is not Level.CONTRADICTED
        off = path.vertices_mm[1] - scene.vertices_mm[1]
        covariance = path.covariance[4:7, 4:7]
        assert off @ np.linalg.solve(covariance, off) < 21.1  # chi-square of three: 1e-4

    @pytest.mark.parametrize("seed", [100, 101])
    def test_a_clear_corner_has_no_curve_beside_it(self, seed):
        path = told(scene_with_corner(20.0, "picture", 1000.0), seed)
        assert path.n_legs == 2
        assert path.alternatives == ()


@pytest.mark.long
def test_clean_recordings_have_no_other_answer():
    for lab in (one_leg(), three_legs()):
        for method in ("joint", "photon"):
            path = known_path(lab, method)
            assert path.verdict.level is Level.TRUST
            assert path.alternatives == ()


# --- evidence -----------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Compared:
    """A fit, its one rival, and what both rest on."""

    fit: JointFit
    rival: Rival
    setting: Setting
    scene: RefractedScene

    def measured(self, leg: Any, anchor_leg: Any) -> Measured:
        times, lines = self.fit.times, self.fit.lines
        of_time = np.sqrt(times.weights(self.fit.floor_ps**2))
        modes = np.vstack((of_time[:, None] * times.modes_ps,
                           np.zeros((len(lines.leg), times.modes_ps.shape[1]))))  # fmt: skip
        if lines.modes is not None:
            modes[len(times.leg) :, -lines.modes.shape[1] :] = lines.modes
        whitening = np.zeros((len(modes), len(modes)))
        n = len(times.leg)
        whitening[:n, :n], whitening[n:, n:] = np.diag(of_time), -lines.whitening
        within = np.linalg.inv(np.eye(len(modes)) + modes @ modes.T)
        seen = self.scene.camera
        focal = mean_focal_px(self.setting.camera)
        return Measured(
            np.column_stack(((times.col - seen.col_of_axis) / seen.px_per_slope_col,
                             (times.row - seen.row_of_axis) / seen.px_per_slope_row, np.ones(n))),
            leg, times.arrival_ps - times.footprint_ps,
            np.column_stack((lines.anchors / focal, np.ones(len(lines.leg)))), anchor_leg,
            np.linalg.cholesky(within).T @ whitening, focal,
        )  # fmt: skip

    def curves(self, state: PathState) -> Any:
        """Places and times of arrival along each leg, in the camera's axes."""
        seen, medium = self.scene.camera, self.setting.medium
        axes = np.stack((seen.right, seen.down, seen.forward))
        share = np.linspace(0.0, 1.0, 400)

        def of_leg(leg: int) -> tuple[np.ndarray, np.ndarray]:
            places = state.points_mm(leg, share)
            ways = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
            event = state.vertex_times_ps(medium)[leg] + medium.path_group_index * (
                ways / SPEED_OF_LIGHT_MM_PER_PS
            )
            back = np.linalg.norm(places - seen.center, axis=1)
            back *= medium.return_group_index / SPEED_OF_LIGHT_MM_PER_PS
            return (places - seen.center) @ axes.T, event + back

        return of_leg


def compared(scene: RefractedScene, seed: int) -> Compared:
    hist = histograms(scene, seed)
    call = what_the_user_tells(scene, hist, emission_known=scene.path_group_index == AIR)
    setting = Setting(call["camera"], call["source"], call["medium"])
    seen = sighting_from_histograms(
        hist, setting, timing=call["timing"], background=None, exclude_mask=None,
        least_squares=False,
    )  # fmt: skip
    fit = fit_of_request(Request([seen], setting, call["timing"], None, None))
    rivals = sorted(rivals_of(fit, setting), key=lambda one: -one.log_evidence)
    return Compared(fit, rivals[0], setting, scene)


def sampled(log_likelihood: Any, low: Any, high: Any, n_live: int) -> Any:
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    sampler = dynesty.NestedSampler(
        log_likelihood, lambda u: low + (high - low) * u, len(low), nlive=n_live,
        bound="multi", sample="unif", bootstrap=0, rstate=np.random.default_rng(7),
    )  # fmt: skip
    sampler.run_nested(dlogz=0.1, print_progress=False)
    return sampler.results


def test_nested_sampling_finds_both_directions_as_likely():
    """Three numbers: when it set out, depth and height of the end. Ln ratio good to 0.2."""
    both = compared(scene_of_fibre(30.0), 0)
    fit = both.fit
    state, basis = fit.solution.state, fit.freedom.basis
    data = both.measured(fit.times.leg, fit.lines.leg)
    found = sampled(
        lambda free: data.log_likelihood(both.curves(state.moved(basis @ free))),
        [-25.0, -110.0, -0.13], [20.0, 60.0, 0.15], 100,
    )  # fmt: skip
    weight = np.exp(found.logwt - found.logz[-1])
    depth = found.samples[:, 1]
    rival = np.linalg.lstsq(basis[:6], (both.rival.state.vertices_mm - state.vertices_mm).ravel(),
                            rcond=None)[0]  # fmt: skip
    turned = depth < 0.5 * rival[1]
    ratio = float(np.log(weight[turned].sum() / weight[~turned].sum()))
    assert both.rival.log_evidence == pytest.approx(ratio, abs=0.6)
    for mode, place in ((turned, rival[1]), (~turned, 0.0)):
        mean = np.average(depth[mode], weights=weight[mode])
        std = np.sqrt(np.average((depth[mode] - mean) ** 2, weights=weight[mode]))
        assert abs(mean - place) < 1.5 * std


def log_evidence_by_sampling(both: Compared, state: PathState, joined: bool, n_live: int) -> float:
    """Of one path: the integral of likelihood and priors over six standard errors each way."""
    times, lines = both.fit.times, both.fit.lines
    leg, anchor_leg = (one * (not joined) for one in (times.leg, lines.leg))
    freedom = freedom_at(state, both.setting)
    fitted = fit_path(
        state, relegged(times, leg), relegged(lines, anchor_leg), freedom,
        both.setting, floor_var=both.fit.floor_ps**2,
    )  # fmt: skip
    n = freedom.basis.shape[1]
    root = np.linalg.cholesky(fitted.covariance[:n, :n])
    data = both.measured(leg, anchor_leg)
    usual = [20.0 / np.arange(1, bend.orders + 1) ** 2 for bend in state.bends]
    of_bends = sum(np.log(2.0 * np.pi * one**2).sum() for one in usual)

    def log_likelihood(z: Any) -> float:
        at = fitted.state.moved(freedom.basis @ (root @ z))
        # 20 mm of sagitta, and of the further shapes as much curvature.
        shares = [b.coefficients_mm * np.arange(1, b.orders + 1) ** 2 / 20.0 for b in at.bends]
        prior = -0.5 * float(sum(np.sum(share**2) for share in shares)) - of_bends
        return data.log_likelihood(both.curves(at)) + prior

    found = sampled(log_likelihood, -6.0 * np.ones(n), 6.0 * np.ones(n), n_live)
    volume = n * np.log(12.0) + float(np.sum(np.log(np.diag(root))))
    n_untold = n - sum(bend.size for bend in fitted.state.bends)
    untold = -0.5 * n_untold * np.log(2.0 * np.pi * ANYWHERE_MM**2)
    return float(found.logz[-1] + volume + untold)


def relegged(table: Any, leg: Any) -> Any:
    """The same pulses or lines, of other legs."""
    return replace(table, leg=leg)


def test_nested_sampling_weighs_a_bent_leg_as_we_do():
    """Five numbers against four; each log evidence good to 0.3."""
    both = compared(scene_with_corner(10.0, "depth", 1000.0), 1)
    assert both.rival.says == "one bent leg instead of two straight ones"
    straight = log_evidence_by_sampling(both, both.fit.solution.state, False, 80)
    bent = log_evidence_by_sampling(both, both.rival.state, True, 80)
    assert both.rival.log_evidence == pytest.approx(bent - straight, abs=1.2)
