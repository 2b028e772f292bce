"""`reconstruct` passed over [timing] that its calibration was made without, and said nothing."""

from dataclasses import replace

import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main


@pytest.fixture
def reconstruct(rng, tmp_path, monkeypatch):
    """What is said of a set-up with scale_std, before any path is looked for."""
    monkeypatch.chdir(tmp_path)
    hist = lf.Histograms(rng.poisson(3.0, (8, 16, 64)), bin_width_ps=55.0)
    lf.write(hist, "dark.h5")
    clock = lf.TimingCalibration.nominal(hist)

    def said(settings):
        made = {} if settings is None else {"settings": settings}
        replace(clock, provenance=made).save("clock.h5")
        words = ["reconstruct", "dark.h5", "--timing", "clock.h5", "--set", "timing.scale_std=1e-4"]
        return CliRunner().invoke(main, words).stderr

    return said


@pytest.mark.parametrize("made_with", [{}, {"timing": {}}, {"timing": {"scale_std": 1e-3}}])
def test_what_the_calibration_was_made_without_is_told(reconstruct, made_with):
    assert "warning: [timing] scale_std: not used here" in reconstruct(made_with)


@pytest.mark.parametrize("made_with", [None, {"timing": {"scale_std": 1e-4}}])
def test_what_it_was_made_with_or_nobody_knows_is_not(reconstruct, made_with):
    assert "[timing]" not in reconstruct(made_with)
