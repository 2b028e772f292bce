"""`init --defaults`, "as in the paper", looked elsewhere: no recording of the twin went with it."""

import numpy as np
import pytest
from click.testing import CliRunner

from lightflight.cli import main
from lightflight.lab import lab_from_toml
from lightflight.simulate.presets import paper_scene


def test_defaults_are_the_camera_and_source_that_the_twin_has(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(main, ["init", "--defaults", "--no-plot"]).exit_code == 0
    lab, scene = lab_from_toml("lab.toml"), paper_scene()
    assert lab.camera.shape == scene.camera.shape
    np.testing.assert_allclose(lab.camera.world_from_camera, scene.camera.world_from_camera)
    np.testing.assert_allclose(lab.camera.matrix, scene.camera.matrix)
    assert lab.source.position_mm == pytest.approx(scene.source.position_mm)
    assert lab.source.pulse_fwhm_ps == pytest.approx(scene.source.pulse_fwhm_ps)


def test_a_lab_of_ones_own_has_its_origin_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["init", "--distance", "535", "--field-of-view", "245", "245", "--no-plot"]
    assert CliRunner().invoke(main, words).exit_code == 0
    assert lab_from_toml("lab.toml").camera.center_mm[:2] == pytest.approx((0.0, 0.0))
