"""`lightflight init`: a set-up file that is what was answered, and never half of one."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from lightflight.cli import main
from lightflight.cli.commands import init
from lightflight.lab import lab_from_toml

PAPER = ["--distance", "535", "--field-of-view", "245", "245", "--center", "187.5", "37.5"]


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words, text=None: CliRunner().invoke(main, ["init", *words], input=text)


def test_options_are_answers(run):
    done = run(*PAPER, "--source", "0", "1", "2", "--pulse-fwhm", "70", "--medium", "water",
               "--known-by", "tape", "--shape", "16", "64")  # fmt: skip
    assert done.exit_code == 0, done.output
    lab = lab_from_toml("lab.toml")
    assert lab.camera.shape == (16, 64)
    np.testing.assert_allclose(lab.camera.center_mm, (187.5, 37.5, 535.0))
    np.testing.assert_allclose(np.sqrt(np.diag(lab.camera.pose_covariance))[3:], (3, 3, 10))
    assert lab.source.position_mm == (0.0, 1.0, 2.0)
    assert lab.source.position_std_mm == 1.0
    assert lab.source.pulse_fwhm_ps == 70.0
    assert lab.medium.path_group_index == lab.medium.return_group_index == 1.35
    assert "not square" in done.output


def test_a_person_is_asked_for_the_rest_and_again_after_a_slip(run, monkeypatch, tmp_path):
    monkeypatch.setattr(init, "_somebody_is_there", lambda: True)
    answers = ["", "0.6 km", "-5", "600", "300", "300 200", "", "none", "", "ice", "silica", ""]
    done = run(text="\n".join(answers) + "\n")
    assert done.exit_code == 0, done.output
    for slip in ("numbers, please", "above zero", "2 finite numbers", "one of air"):
        assert slip in done.output
    lab = lab_from_toml("lab.toml")
    assert lab.camera.center_mm[2] == 600.0
    assert lab.source.position_mm is None
    assert lab.medium.path_group_index == 1.47
    assert (tmp_path / "lab.png").stat().st_size > 10_000


def test_nobody_there_to_ask(run, tmp_path):
    done = run("--distance", "535")
    assert done.exit_code == 2
    assert "--field-of-view" in done.output
    assert "--defaults" in done.output
    assert not list(tmp_path.iterdir())
    assert run("--defaults", "--no-plot").exit_code == 0
    assert [one.name for one in tmp_path.iterdir()] == ["lab.toml"]


def test_what_is_there_stays_unless_told(run, tmp_path):
    (tmp_path / "lab.toml").write_text("# mine")
    refused = run("--defaults")
    assert refused.exit_code == 2
    assert "--force" in refused.output
    assert (tmp_path / "lab.toml").read_text() == "# mine"
    assert run("--defaults", "--force").exit_code == 0
    assert "mine" not in (tmp_path / "lab.toml").read_text()


@pytest.mark.parametrize(
    "words",
    [
        ["--defaults", "--no-source", "--source", "0", "0", "0"],
        ["--defaults", "-o", "lab.txt"],
        ["--defaults", "--distance", "0"],
        ["--defaults", "--distance", "nan"],
        ["--defaults", "--field-of-view", "inf", "1"],
        ["--defaults", "--source", "nan", "0", "0"],
        ["--defaults", "--shape", "0", "5"],
        ["--defaults", "--shape", "2000000000", "2000000000"],
        ["--defaults", "--medium", "ice"],
        ["--defaults", "-o", "no/where/lab.toml"],
    ],
)
def test_wrong_answers_end_in_a_sentence(run, tmp_path, words):
    done = run(*words)
    assert done.exit_code in (1, 2, 3)
    assert "internal error" not in done.output
    assert not list(tmp_path.iterdir())


def test_for_programs(run):
    done = run("--defaults", "--json", "--no-plot")
    told = json.loads(done.stdout)
    assert told["written"] == ["lab.toml"]
    assert math.isclose(told["pixel_mm"][0], 245 / 32)


def test_errors_are_those_of_the_page(run, tmp_path):
    """docs/how-to/describe-lab.md lists what each way of measuring is worth."""
    for by, (_, place, rotation, share, _) in init._KNOWN_BY.items():
        done = run("--defaults", "--force", "--no-plot", "--known-by", by)
        assert done.exit_code == 0
        text = (tmp_path / "lab.toml").read_text()
        assert f"rotation_std_deg = {rotation}" in text
        assert f"position_std_mm = {list(place)}" in text
        assert math.isclose(share * 245, {"tape": 5, "ruler": 2, "points": 0.2}[by])
