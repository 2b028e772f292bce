"""Names that are no UTF-8: a recording like any other."""

from __future__ import annotations

import csv
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.batch.campaign import campaign_from_toml
from lightflight.cli import main
from lightflight.files.store import load_record, save_record
from tests.batch.conftest import CAMPAIGN, LAB, recording_at

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 elsewhere")
NAME = os.fsdecode(b"caf\xe9.h5")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("names")
    (place / "lab.toml").write_text(LAB)
    (place / "campaign.toml").write_text(CAMPAIGN)
    (place / "angle_4").mkdir()
    lf.write(recording_at(4, seed=16), place / "angle_4" / NAME)
    return place


def test_attributes_keep_any_name(tmp_path):
    save_record(tmp_path / "x.h5", kind="path", arrays={}, attributes={"of": NAME, "µ": "é"})
    assert load_record(tmp_path / "x.h5", kind="path")[1] == {"of": NAME, "µ": "é"}


def test_a_campaign_names_it(folder):
    (shot,) = campaign_from_toml(folder / "campaign.toml").shots
    assert (shot.label, shot.name) == (r"angle_4/caf\xe9.h5", "angle_4_caf_xe9")
    assert shot.path.is_file()


@pytest.mark.parametrize(
    "words",
    [
        ("info", "REC"),
        ("convert", "REC", "-o", "x.npz"),
        ("reconstruct", "REC", "--lab", "lab.toml", "-o", "p.h5"),
        ("reconstruct", "REC", "--lab", "lab.toml", "-o", NAME),
        ("plot", "REC", "-o", "x.png"),
        ("view", "p.h5", "--recording", "REC", "-o", "x.html"),
        ("batch", "campaign.toml", "--dry-run"),
    ],
    ids=" ".join,
)
def test_every_command_takes_it(folder, monkeypatch, words):
    monkeypatch.chdir(folder)
    if "p.h5" in words[1:2] and not Path("p.h5").exists():
        pytest.skip("the path was not made")
    recording = str(Path("angle_4") / NAME)
    done = CliRunner().invoke(main, [recording if word == "REC" else word for word in words])
    assert done.exit_code == 0, done.output


@pytest.mark.slow
def test_a_campaign_with_it_loses_no_row(folder, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(main, ["batch", "campaign.toml", "--workers", "1"])
    assert done.exit_code == 0, done.output
    with Path("results/table.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["recording"], row["status"]) == (r"angle_4/caf\xe9.h5", "done")


HOSTILE = ("a$x_{$.h5", "[red]b.h5", "c\x1b[31m.h5", "-o.h5", "d\nnew.h5", "=1+1.h5")


@pytest.mark.parametrize("name", HOSTILE)
def test_no_name_and_no_setting_is_obeyed(tmp_path, name, monkeypatch):
    """Formulas of figures, markup of tables, commands of terminals: shown as they are."""
    monkeypatch.chdir(tmp_path)
    settings = {"comment": "\x1b]0;owned\x07 [red]x[/b] $\\frac{$", "[/b]": "\x9b2J"}
    hist = lf.Histograms(np.ones((4, 4, 8), np.uint16), bin_width_ps=55.0, settings=settings)
    lf.write(hist, tmp_path / name)
    done = CliRunner().invoke(main, ["info", f"./{name}", "--plot", "x.png"])
    assert done.exit_code == 0, done.output
    assert not {"\x1b", "\x07", "\x9b"} & set(done.output)
    assert r"\x1b]0;owned\x07 [red]x[/b] $\frac{$" in done.output
    (tmp_path / name).write_bytes(b"no recording")
    done = CliRunner().invoke(main, ["info", f"./{name}"])
    assert done.exit_code == 3
    assert "\x1b" not in done.output
    assert len(done.output.splitlines()) == 1
