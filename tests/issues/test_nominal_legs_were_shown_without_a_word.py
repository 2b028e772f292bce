"""`reconstruct recording.h5` alone showed legs of 6 pixels (calibrated: 32) without a remark."""

import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from lightflight.formats.registry import write
from lightflight.simulate.presets import paper_scene


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    file = tmp_path_factory.mktemp("legs") / "recording.h5"
    write(lf.simulate(paper_scene(), photons_per_pixel=40_000, seed=0), file)
    return file


def test_what_is_missing_is_named(recording):
    said = CliRunner().invoke(main, ["reconstruct", str(recording)])
    assert said.exit_code == 0
    assert "rest on a nominal clock" in said.stderr
    assert "give --timing" in said.stderr
    assert "this needs the camera" in said.stdout
