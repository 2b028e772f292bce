"""Without `flat_arrival_ps` Python put the clock's zero elsewhere than the command line does."""

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from lightflight.formats.registry import write
from lightflight.simulate.presets import paper_scene

pytestmark = pytest.mark.filterwarnings("ignore::lightflight.errors.UncalibratedWarning")


@pytest.fixture(scope="module")
def flat():
    small = lf.Camera.facing_plane((12, 12), center_mm=(187.5, 37.5))
    scene = paper_scene(camera=small)
    return lf.simulate(scene, photons_per_pixel=40_000, seed=2, kind="flat")


def test_both_take_what_a_simulated_flat_says(flat, tmp_path):
    write(flat, tmp_path / "flat.h5")
    args = ["calibrate", "--flat", str(tmp_path / "flat.h5"), "-o", str(tmp_path / "clock.h5")]
    args += ["--flat-pulse", "gaussian"]  # no search for a tail: where the zero lies does not ask
    assert CliRunner().invoke(main, args).exit_code == 0
    by_command = lf.TimingCalibration.load(tmp_path / "clock.h5")
    in_python = lf.calibrate_timing(
        flat=lf.histogram(lf.read(tmp_path / "flat.h5")), flat_pulse="gaussian"
    )
    np.testing.assert_array_equal(in_python.skew_ps, by_command.skew_ps)
    assert any("its light arrived at 5600 ps" in note for note in in_python.notes)


def test_what_is_told_stands_over_it(flat):
    known, zero = (
        lf.calibrate_timing(flat=flat, flat_arrival_ps=at, flat_pulse="gaussian")
        for at in (None, 0.0)
    )
    np.testing.assert_allclose(zero.skew_ps - known.skew_ps, 5600.0, atol=1e-6)
