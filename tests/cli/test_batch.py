"""`lightflight batch`: the whole command, and what it says about wrong input."""

import csv
import json
import shutil
import tomllib

import pytest


@pytest.fixture
def campaign(tmp_path, lab_folder):
    """A folder with a campaign of one good recording, one of another shape and a missing one."""
    for name in ("lab.toml", "calibration.h5", "recording.h5"):
        shutil.copy(lab_folder / name, tmp_path / name)
    (tmp_path / "campaign.toml").write_text(
        '[campaign]\nlab = "lab.toml"\ntiming = "calibration.h5"\ntitle = "Three"\n'
        '[[groups]]\nname = "a"\nrecordings = ["recording.h5", "missing.h5"]\n'
    )
    return tmp_path


def refused(done, code, *words):
    lines = [line for line in done.stderr.splitlines() if not line.endswith(" ...")]
    assert done.exit_code == code, (done.stderr, done.stdout)
    assert len(lines) == 1, done.stderr
    for word in words:
        assert word in lines[0]


def test_dry_run_names_every_recording_and_writes_nothing(run, campaign):
    before = sorted(campaign.iterdir())
    done = run("batch", campaign / "campaign.toml", "--dry-run", "--set", "campaign.leg=2")
    assert done.exit_code == 0, done.stderr
    table = tomllib.loads(done.stdout)
    assert table["campaign"]["leg"] == 2
    assert table["groups"][0]["recordings"][0].endswith("recording.h5")
    assert table["camera"]["shape"] == [32, 32]
    assert sorted(campaign.iterdir()) == before


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_campaign_from_file_to_summary(run, campaign):
    pytest.importorskip("distributed")
    words = ("batch", campaign / "campaign.toml", "--workers", 1, "-o", campaign / "out", "--json")
    done = run(*words, "--page")
    assert done.exit_code == 0, done.stderr
    facts = json.loads(done.stdout, parse_constant=lambda word: pytest.fail(word))
    assert (facts["n_done"], facts["n_failed"]) == (1, 1)
    assert "there is no such file" in facts["failed"]["missing.h5"]
    out = campaign / "out"
    rows = list(csv.DictReader((out / "table.csv").read_text().splitlines()))
    assert [row["status"] for row in rows] == ["done", "failed"]
    assert rows[0]["n_legs"] == "3"
    assert float(rows[0]["true_position_rms_mm"]) < 1.0
    assert (out / "summary.png").read_bytes().startswith(b"\x89PNG")
    assert "recording.h5" in (out / "index.html").read_text()
    assert sorted(file.name for file in (out / "paths").iterdir()) == ["recording.h5"]
    again = run(*words)  # all that can be done is done: only the missing one is looked for
    assert again.exit_code == 0
    assert list(csv.DictReader((out / "table.csv").read_text().splitlines())) == rows


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["batch", "no.toml"], 2, ["no.toml", "no such set-up file"]),
        (["batch"], 2, ["CAMPAIGN_FILE"]),
        (["batch", "campaign.toml", "--workers", "0"], 2, ["workers"]),
        (["batch", "campaign.toml", "--workers", "2", "--scheduler", "tcp://x:1"], 2, ["--sched"]),
        (["batch", "campaign.toml", "-o", "lab.toml"], 2, ["lab.toml", "is a file"]),
        (["batch", "campaign.toml", "-o", "."], 2, ["holds other things"]),
        (["batch", "campaign.toml", "--set", "campaign.timming=x"], 2, ["timming", "'timing'"]),
        (["batch", "campaign.toml", "--set", "campaign.timing=x.h5"], 3, ["x.h5", "no such file"]),
        (["batch", "campaign.toml", "--set", "campaign.timing=lab.toml"], 3, ["lab.toml"]),
    ],
)
def test_wrong_input_is_one_sentence(run, campaign, monkeypatch, words, code, said):
    monkeypatch.chdir(campaign)
    refused(run(*words), code, *said)


def test_without_a_camera_nothing_is_started(run, campaign, monkeypatch):
    monkeypatch.chdir(campaign)
    (campaign / "lab.toml").write_text("[source]\npulse_fwhm_ps = 68.0\n")
    refused(run("batch", "campaign.toml"), 2, "no path without a camera", "distance_mm")


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer(run, campaign, monkeypatch):
    distributed = pytest.importorskip("distributed")
    assert distributed
    monkeypatch.chdir(campaign)
    monkeypatch.setattr("lightflight.batch.cluster._CONNECT_S", 1)
    done = run("batch", "campaign.toml", "--scheduler", "tcp://127.0.0.1:9")
    refused(done, 2, "--scheduler tcp://127.0.0.1:9", "no Dask scheduler answers")
