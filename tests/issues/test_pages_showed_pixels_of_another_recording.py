"""`view --recording` took any recording, of another flight or another camera, without a word."""

from dataclasses import replace

import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from lightflight.provenance import provenance_record
from tests.view import fakes


def write_recording(rng, shape, name):
    lf.write(lf.Histograms(rng.poisson(3.0, (*shape, 64)), bin_width_ps=55.0), name)


@pytest.fixture
def view(rng, tmp_path, monkeypatch):
    """`lightflight view` of a path that was made from its.h5."""
    monkeypatch.chdir(tmp_path)
    path = fakes.fake_path()
    write_recording(rng, path.camera.shape, "its.h5")
    write_recording(rng, path.camera.shape, "another.h5")
    write_recording(rng, (8, 16), "small.h5")
    made = provenance_record(command="lightflight reconstruct", inputs=["its.h5"])
    replace(path, provenance=made).save("path.h5")
    return lambda *words: CliRunner().invoke(main, ["view", "path.h5", *words])


def test_a_recording_that_the_path_was_not_made_from_is_told(view):
    done = view("--recording", "another.h5")
    assert done.exit_code == 0
    assert "another.h5: the path was not made from it, but from its.h5" in done.stderr


def test_its_own_by_another_name_is_not(view, tmp_path):
    (tmp_path / "its.h5").rename("moved.h5")
    done = view("--recording", "moved.h5")
    assert done.exit_code == 0
    assert "not made from" not in done.stderr


def test_a_recording_of_another_camera_is_refused(view, tmp_path):
    done = view("--recording", "small.h5")
    assert done.exit_code == 5
    assert "the recording has 8 x 16 pixels, the path's camera has" in done.stderr
    assert not list(tmp_path.glob("*.html"))
