"""The verdict: first in what commands print, in their JSON, and under --strict their exit code."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import click
import pytest

import lightflight as lf
from lightflight.cli.errors import sentence_and_code
from lightflight.cli.paths import truth_facts
from lightflight.path.verdict import Level, Verdict
from tests.path.test_verdict import WORST
from tests.path_fakes import make_path, truth_of
from tools.make_golden_files import FOLDER
from tools.make_schema_files import known_path_with_an_alternative

TOLD = ("--lab", FOLDER / "lab.toml", "--timing", FOLDER / "calibration_full.h5")
RECORDING = FOLDER / "histograms.h5"


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """A path file for each level."""
    folder = tmp_path_factory.mktemp("paths")
    verdicts = (Verdict(Level.TRUST, n_tests=9, p_value=0.4), None, WORST)
    for level, verdict in zip(Level, verdicts, strict=True):
        path = make_path() if verdict is None else replace(make_path(), verdict=verdict)
        path.save(folder / f"{level}.h5")
    return folder


def test_reconstruct_says_it_first(run):
    done = run("reconstruct", RECORDING, *TOLD)
    assert done.exit_code == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("trust: nothing in the recording speaks against this path (p = ")
    said = done.stdout
    places = [said.index(w) for w in ("70 of 70 pulses", "blind to", "taken as exact", "corner  ")]
    assert places == sorted(places)
    assert "focal length: 1 % moves corner 1 by" in said


def test_programs_get_all_of_it(run, tmp_path):
    done = run("reconstruct", RECORDING, *TOLD, "--json", "-o", tmp_path / "path.h5")
    facts = json.loads(done.stdout)
    path = lf.LightPath.load(tmp_path / "path.h5")
    assert next(iter(facts)) == "verdict"
    assert Verdict.from_json(facts["verdict"]) == path.verdict
    assert facts["explained"]["n_found"] == path.explained.n_found == 70
    assert tuple(facts["prices"]) == path.prices
    assert facts["chi2_with_floor"] == pytest.approx(facts["chi2"])
    again = json.loads(run("info", tmp_path / "path.h5", "--json").stdout)
    assert {name: again[name] for name in ("verdict", "explained", "prices")} == {
        name: facts[name] for name in ("verdict", "explained", "prices")
    }


def test_other_answers_are_told(run, tmp_path):
    path = known_path_with_an_alternative()
    path.save(tmp_path / "path.h5")
    said = run("info", tmp_path / "path.h5").stdout
    assert re.search(r"other answers +leg 1 turned in depth \(3 times less likely\): elev", said)
    (other,) = json.loads(run("info", tmp_path / "path.h5", "--json").stdout)["alternatives"]
    assert (other["says"], other["log_evidence"]) == ("leg 1 turned in depth", -1.25)
    assert other["vertices_mm"] == path.alternatives[0].path.vertices_mm.tolist()
    assert other["vertices_mm"] != path.vertices_mm.tolist()


@pytest.mark.parametrize("level", Level)
@pytest.mark.parametrize("words", [("info",), ("plot", "--what", "times"), ("export",), ("view",)])
def test_every_command_about_a_path_says_it_first(run, paths, tmp_path, level, words):
    suffix = {"info": "", "plot": "png", "export": "csv", "view": "html"}[words[0]]
    output = ("-o", tmp_path / f"p.{suffix}") if suffix else ()
    done = run(words[0], paths / f"{level}.h5", *words[1:], *output)
    assert done.exit_code == 0, done.stderr
    assert done.stdout.splitlines()[0].startswith(f"{level}: ")


def test_findings_stand_in_their_order_with_what_to_do(run, paths):
    lines = run("info", paths / "contradicted.h5").stdout.splitlines()
    rows = [line for line in lines if line.startswith(("  1  ", "  2  "))]
    assert "index off by 0.01" in rows[0]
    assert "state it" in rows[0]
    assert "12.5" in rows[0]
    assert "pose off by 2 mm" in rows[1]


def test_strict_ends_well_where_the_path_is_to_be_trusted(run):
    assert run("reconstruct", RECORDING, *TOLD, "--strict").exit_code == 0


@pytest.mark.parametrize("as_json", [(), ("--json",)])
def test_strict_ends_with_6_and_all_is_written(run, tmp_path, as_json):
    words = ("--set", "medium.path_group_index=1.2", "--n-legs", 2, "-o", tmp_path / "p.h5")
    done = run("reconstruct", RECORDING, *TOLD, *words, "--strict", *as_json)
    assert done.exit_code == 6, done.stderr
    assert done.stderr.splitlines()[-1].startswith("lightflight: --strict: contradicted: ")
    assert lf.LightPath.load(tmp_path / "p.h5").verdict.level == "contradicted"
    assert "contradicted" in done.stdout
    warned = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
    assert any("the recording contradicts this path" in line for line in warned)


def test_strict_is_not_content_with_legs_in_the_picture(run):
    done = run("reconstruct", RECORDING, "--timing", FOLDER / "calibration_full.h5", "--strict")
    assert done.exit_code == 6
    assert "Legs in the picture" in done.stdout
    assert "there is no path" in done.stderr.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_campaign_counts_its_verdicts(run, lab_folder, tmp_path):
    pytest.importorskip("distributed")
    (tmp_path / "campaign.toml").write_text(
        f'[campaign]\nlab = "{lab_folder / "lab.toml"}"\n'
        f'timing = "{lab_folder / "calibration.h5"}"\n'
        f'[[groups]]\nname = "a"\nrecordings = ["{lab_folder / "recording.h5"}"]\n'
    )
    words = ("batch", tmp_path / "campaign.toml", "--workers", 1, "-o", tmp_path / "out")
    done = run(*words, "--strict", "--json", "--set", "medium.path_group_index=1.02")
    assert done.exit_code == 6, done.stderr
    facts = json.loads(done.stdout)
    assert (facts["n_trust"], facts["n_check"], facts["n_contradicted"]) == (0, 0, 1)
    (row,) = csv.DictReader((tmp_path / "out" / "table.csv").read_text().splitlines())
    (said,) = facts["not_trusted"].values()
    assert said == {name: row[name] for name in ("verdict", "findings")}
    assert float(row["verdict_p_value"]) < 1e-4
    # A path file that was damaged since is told of, not only made again.
    (kept,) = (tmp_path / "out" / "paths").iterdir()
    kept.write_bytes(kept.read_bytes()[:999])
    done = run(*words, "--set", "medium.path_group_index=1.02")
    assert done.exit_code == 0
    (warned,) = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
    assert kept.name in warned
    assert warned.endswith("; it is made again")
    assert "not to be trusted" in done.stdout


def test_a_bare_error_of_click_is_no_fault_of_ours():
    assert sentence_and_code(click.ClickException("a word")) == ("a word", 2)
    assert sentence_and_code(click.FileError("x.h5", "gone"))[1] == 3


@pytest.mark.parametrize(
    ("truth", "said"),
    [
        (SimpleNamespace(flat_arrival_ps=3.0), "knows no path to compare with"),
        (truth_of([(0, 0, 900), (9, 0, 900)]), "the camera sees no part of the true path"),
    ],
)
def test_a_truth_that_cannot_be_compared_is_not_dropped_in_silence(truth, said):
    (fact,) = truth_facts(replace(make_path(), truth=truth))
    assert said in str(fact.text)
