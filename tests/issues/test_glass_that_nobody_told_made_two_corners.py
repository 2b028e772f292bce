"""Thirty millimetres of glass that nobody told became two corners more, with "trust".

Light behind it is late by 60 ps. So is light that turns by 11 degrees, flies some 50 mm in depth
and turns back: the path came out 10 mm off behind the glass, and only a statement said that the
corners are hardly fixed.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.reconstruct.model.state import PathState
from lightflight.reconstruct.verdict.doubtful import corners_asked_about, legs_that_may_be_none
from lightflight.simulate.presets import ideal, paper_scene
from tests.path_fakes import make_path


@pytest.mark.long
def test_a_leg_that_may_be_none_is_never_trusted():
    vertices_mm = np.array(
        [(0.0, 10.66, -38.3), (375.0, 31.08, 70.28), (0.0, 58.98, 14.35), (375.0, 76.07, 33.89)]
    )
    start, end = vertices_mm[1:3]
    # Light comes out of it 1 mm aside: glass that stands square to the beam is named.
    normal = (end - start) / np.linalg.norm(end - start) + (-0.058, 0.127, 0.129)
    block = lf.Block(
        start + 0.557 * (end - start), normal, thickness_mm=30.0, diameter_mm=30.0,
        glass=lf.Material.named("BK7", wavelength_nm=532.0),
    )  # fmt: skip
    scene = replace(
        paper_scene(ideal(psf_std_px=0.3, active_width_px=0.12)),
        vertices_mm=vertices_mm,
        medium=lf.Medium(blocks=[block]),
    )
    hist = lf.simulate(scene, photons_per_pixel=10_000.0, seed=7)
    source = lf.Source(tuple(vertices_mm[0]), emission_time_ps=2000.0)
    timing = lf.TimingCalibration.nominal(hist)
    with pytest.warns(SuspectDataWarning, match="check this path before you rely on it"):
        path = lf.reconstruct(hist, camera=scene.camera, source=source, timing=timing)
    # Which of the three says it depends on what the counts make of its two corners.
    assert {one.name for one in path.verdict.findings} & {"leg_count", "block", "unseen_leg"}


def test_a_leg_is_one_where_it_is_three_of_its_errors_long():
    vertices_mm = [[0, 0, 0], [100, 0, 0], [130, 0, 0], [300, 0, 0]]
    assert legs_that_may_be_none(make_path(vertices_mm, 6.9**2 * np.eye(16))) == []
    (loose,) = legs_that_may_be_none(make_path(vertices_mm, 7.2**2 * np.eye(16)))
    assert loose == pytest.approx((1, 30.0, 7.2 * np.sqrt(2.0)))


def test_both_corners_of_a_leg_all_but_unseen_are_asked_about():
    """They turn by 40 degrees: of corners as sharp as that no others are."""
    vertices_mm = np.array(
        [[0, 0, 0], [100, 0, 0], [120, 0, 17], [250, 0, 17], [250, 90, 17]], dtype=float
    )

    def asked_about(pulses_of_leg_2: int) -> tuple[tuple[int, ...], ...]:
        leg = np.repeat([0, 1, 2, 3], [30, pulses_of_leg_2, 40, 20])
        fit = SimpleNamespace(
            solution=SimpleNamespace(state=PathState(vertices_mm, 0.0)),
            times=SimpleNamespace(leg=leg, weight=np.ones(len(leg))),
        )
        return corners_asked_about(fit, ())

    assert asked_about(2) == ((1, 2),)
    assert asked_about(20) == ()
