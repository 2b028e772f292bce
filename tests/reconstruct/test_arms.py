"""Both arms of a beam splitter are told, untold and by each estimator that can; no others are.

Scenes of an oracle that shares no line with the package (`tests/oracles/splitter.py`). The full
table is `benchmarks/splitters.py`.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from benchmarks.splitters import arms_of, bound_of, numbers_of, path_of
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.fit import short_pieces
from lightflight.reconstruct.fit.joint import fit_joint
from lightflight.reconstruct.trials.arms import Armed
from lightflight.reconstruct.verdict import arms
from lightflight.reconstruct.ways import joint
from tests.labs import fit_from_truth, one_leg
from tests.oracles.refracted import AIR
from tests.oracles.refracted_border import camera_told
from tests.oracles.splitter import seen_apart, splitter_world

HALF = 300, 0.5
CASES = [HALF, pytest.param(301, 0.1, marks=pytest.mark.long)]
"""Fixed before looking."""
STRAIGHT = 53_041, 0.1
"""A fit of the light that turns takes what goes straight on for the leg before the splitter."""


@cache
def path_at(seed: int, share: float) -> lf.LightPath:
    return path_of(splitter_world(seed, share=share), seed)


@pytest.mark.usefixtures("nothing_twice")
@pytest.mark.parametrize(("seed", "share"), CASES)
def test_both_arms_are_found_and_trusted(seed, share):
    path, world = path_at(seed, share), splitter_world(seed, share=share)
    assert arms_of(path, world) is not None
    assert path.verdict.level is Level.TRUST
    assert {leg.parent for leg in path.legs} == {None, 0}
    # On one clock.
    fork = path.forks[0][1]
    assert path.vertex_times_ps[fork] == pytest.approx(world.arms[1].emission_time_ps, abs=5.0)


@pytest.mark.usefixtures("nothing_twice")
@pytest.mark.parametrize(("seed", "share"), CASES)
def test_they_are_right_in_stated_errors(seed, share):
    """Splitter (3 numbers) and the direction of each arm (2): chi-square with 7 degrees of freedom,
    each tail cut at 5e-5; rms pull about 1 +- 0.27."""
    path, world = path_at(seed, share), splitter_world(seed, share=share)
    off, covariance = numbers_of(
        path.vertices_mm, path.covariance, arms_of(path, world), world.vertices_mm
    )
    low, high = chi2.ppf(np.array([5e-5, 1 - 5e-5]), 7)
    assert low < off @ np.linalg.solve(covariance, off) < high


@pytest.mark.parametrize("shown", [False, True])
def test_lines_are_fitted_anew_without_light_of_a_piece_that_one_camera_shows(monkeypatch, shown):
    lab = one_leg()
    fit, _, setting = fit_from_truth(lab, lab.recording(1))
    lit = np.zeros(lab.camera.shape, bool)
    lit[16, 14:17] = shown
    monkeypatch.setattr(short_pieces, "_lit_by_pieces", lambda *_: lit)
    anew = Mock()
    monkeypatch.setattr(short_pieces, "fit_joint", anew)
    found = short_pieces.without_short_pieces(fit, replace(setting, others=(lab.camera,)))
    assert anew.called == shown
    assert (found is anew.return_value) == shown
    if shown:
        ((sighting,), *_), _ = anew.call_args
        used = sighting.usable_pulses
        assert len(used)
        assert not lit[sighting.arrivals.row[used], sighting.arrivals.col[used]].any()


@pytest.mark.long
@pytest.mark.parametrize(("seed", "arm_first"), [(13, False), (10, True)])
def test_an_arm_that_one_of_two_cameras_shows_is_found(seed, arm_first, monkeypatch):
    """Its light in three pixels of the other picture was called unexplained, and pulled the leg
    that goes on by five stated errors. By pulses alone; chi-square of seven numbers, tail cut at
    1e-5."""
    monkeypatch.setattr(joint, "_why_all_counts", lambda fit, setting: "")
    lines_anew = Mock(wraps=fit_joint)
    monkeypatch.setattr(short_pieces, "fit_joint", lines_anew)
    made = seen_apart(seed, arm_first=arm_first)
    clock = made[0][0].base.clock
    hists = [
        lf.Histograms(counts, bin_width_ps=clock.width, laser_period_ps=clock.period)
        for _, counts in made
    ]
    world = made[0][0]
    path = lf.reconstruct(
        hists,
        camera=[camera_told(one.base) for one, _ in made],
        source=lf.Source(
            tuple(world.source_mm.tolist()), emission_time_ps=world.base.emission_time_ps
        ),
        medium=lf.Medium(AIR),
        timing=[lf.TimingCalibration.nominal(hist) for hist in hists],
    )
    assert path.verdict.level is Level.TRUST
    found = arms_of(path, world)
    assert found is not None
    off, covariance = numbers_of(path.vertices_mm, path.covariance, found, world.vertices_mm)
    assert off @ np.linalg.solve(covariance, off) < chi2.ppf(1 - 1e-5, 7)
    assert lines_anew.called


@pytest.mark.long
def test_light_that_goes_straight_on_is_an_arm():
    seed, share = STRAIGHT
    world = splitter_world(seed, share=share)
    path = path_of(world, seed)
    assert arms_of(path, world) is not None
    assert path.verdict.level is Level.TRUST


@pytest.mark.long
def test_all_counts_fit_both_arms_at_their_bound():
    """What `photon` states and what `bounds` says of the true scene are two computations of one
    number; strength and spot along the legs are fitted in one and known in the other. Across arms
    that run between rows of pixels, the width of the spot says where: a third of the error."""
    seed, share = HALF
    world = splitter_world(seed, share=share)
    path = path_of(world, seed, "photon")
    places = arms_of(path, world)
    assert places is not None
    assert path.method == "photon"
    off, stated = numbers_of(path.vertices_mm, path.covariance, places, world.vertices_mm)
    bound = bound_of(share, 4000.0, seed).path
    _, least = numbers_of(bound.vertices_mm, bound.covariance, (1, 2, 3), world.vertices_mm)
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), np.sqrt(np.diag(least)), rtol=0.4)
    # Along and in depth the spot has no say.
    ratio = np.sqrt(np.diag(stated) / np.diag(least))
    np.testing.assert_allclose(ratio[[0, 2, 4, 5, 6]], 1.0, atol=0.15)
    # Seven numbers: chance passes this 5e-5 of the time.
    assert off @ np.linalg.solve(stated, off) < chi2.ppf(1 - 5e-5, 7)


@pytest.mark.usefixtures("nothing_twice")
def test_a_start_that_forks_is_fitted_as_it_is():
    seed, share = HALF
    path = path_at(seed, share)
    again = path_of(splitter_world(seed, share=share), seed, start=path)
    assert again.forks == path.forks
    np.testing.assert_allclose(again.vertices_mm[1], path.vertices_mm[1], atol=0.05)


@pytest.mark.long
def test_legs_are_counted_on_all_branches():
    seed, share = HALF
    path, untold = (
        path_of(splitter_world(seed, share=share), seed, n_legs=3),
        path_at(seed, share),
    )
    assert path.forks == untold.forks
    np.testing.assert_allclose(path.vertices_mm, untold.vertices_mm, atol=0.05)


@pytest.mark.usefixtures("nothing_twice")
def test_an_estimator_of_one_way_names_the_arm():
    seed, share = HALF
    world = splitter_world(seed, share=share)
    path = path_of(world, seed, "paper")
    assert path.forks == ()
    assert path.verdict.level is Level.CONTRADICTED
    said = [re.search(r"an arm that leaves the path at \((.*?)\) mm at (\S+) ps", one.sentence)
            for one in path.verdict.findings]  # fmt: skip
    (found,) = [one for one in said if one]
    place = np.array([float(x) for x in found[1].split(",")])
    assert np.linalg.norm(place - world.splitter_mm) < 5.0
    assert float(found[2]) == pytest.approx(world.arms[1].emission_time_ps, abs=20.0)


def test_light_that_is_no_arm_is_not_called_one():
    """Where none of the light turns off there is one leg, and nothing to name."""
    world = splitter_world(300, share=0.0)
    path = path_of(world, 300)
    assert path.n_legs == 1
    assert path.verdict.level is Level.TRUST


def test_arms_that_explain_nothing_are_not_taken(monkeypatch):
    """The trial is the path itself: it costs the same, as much as 500 pulses do by chance, and pays
    for its parameters besides."""
    state = SimpleNamespace(n_legs=1, has_legs=lambda _: True)
    fit = SimpleNamespace(solution=SimpleNamespace(converged=True, state=state))
    sightings = [SimpleNamespace(usable_pulses=range(500))]
    monkeypatch.setattr(arms, "fits_with_arm", lambda *_: [Armed(fit)])
    monkeypatch.setattr(arms, "has_weak_leg", lambda *_: False)
    monkeypatch.setattr(arms, "_up_to_weak_leg", lambda *_: ())
    monkeypatch.setattr(arms, "cost_of_pulses", lambda *_: 500.0)
    monkeypatch.setattr(arms, "price_of", lambda *_: 40.0)
    assert arms.with_arms(fit, sightings, None, None) is None


@pytest.mark.parametrize(
    ("level", "name", "asked"),
    [
        (Level.CONTRADICTED, FindingName.UNEXPLAINED_LIGHT, True),
        (Level.CONTRADICTED, FindingName.INDEX, False),
        (Level.CHECK, FindingName.UNEXPLAINED_LIGHT, False),
    ],
)
def test_arms_are_asked_for_where_light_is_left(level, name, asked):
    finding = Finding(name, "light is left", 9.0, "look", Severity.CHECK)
    assert arms.leaves_light(Verdict(level, (finding,))) is asked
