"""The verdict: a record that files carry, and what a path has that nobody examined."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from lightflight.errors import FileFormatError
from lightflight.files.store import load_record, save_record
from lightflight.path.file import PATH_KIND
from lightflight.path.light_path import LightPath
from lightflight.path.tables import Explained
from lightflight.path.verdict import (
    NOT_EXAMINED,
    BlindSpot,
    Finding,
    FindingName,
    Level,
    Severity,
    Verdict,
    warning_of,
)
from tests.path_fakes import GOOD, make_path
from tools.make_golden_files import FOLDER, PATHS

WORST = Verdict(
    Level.CONTRADICTED,
    (
        Finding(FindingName.INDEX, "index off by 0.01", 12.5, "state it", Severity.CONTRADICTED),
        Finding(FindingName.POSE, "pose off by 2 mm", 11.0, "measure it", Severity.CONTRADICTED),
    ),
    (BlindSpot(FindingName.CLOCK_SCALE, 1e-4, "of itself", 0.7),),
    3e-9,
    14,
)


def test_names_are_those_that_stay():
    assert {str(name) for name in FindingName} == {
        "prior", "source", "unexplained_light", "shape", "trend", "scatter", "unseen_leg",
        "curved_leg", "leg_count", "haze", "halo", "glare", "other_pulse", "index",
        "focal_length", "distortion", "pose", "clock_offset", "clock_scale", "clock_drift", "walk",
        "pile_up", "window", "block", "units", "orientation", "calibration", "alternative",
        "drawn_curve", "not_examined",
    }  # fmt: skip
    assert [str(level) for level in Level] == ["trust", "check", "contradicted"]


def test_json_and_back():
    plain = json.loads(json.dumps(WORST.to_json(), allow_nan=False))
    back = Verdict.from_json(plain)
    assert back == WORST
    assert type(back.findings[0].name) is FindingName
    assert type(back.findings[0].severity) is Severity
    empty = Verdict.from_json(json.loads(json.dumps(NOT_EXAMINED.to_json(), allow_nan=False)))
    assert empty.findings == NOT_EXAMINED.findings
    assert np.isnan(empty.p_value)


def test_reads_like_a_sentence():
    assert str(WORST) == "contradicted: index off by 0.01; pose off by 2 mm"
    assert str(Verdict(Level.TRUST)) == "trust"
    assert str(WORST.blind_to[0]) == (
        "clock_scale up to 0.0001 of itself, which moves a vertex by 0.7 mm"
    )


def test_a_path_made_by_hand_is_not_examined():
    verdict = make_path().verdict
    assert verdict.level == "check"
    assert [finding.name for finding in verdict.findings] == ["not_examined"]


def test_a_file_carries_the_verdict(tmp_path):
    replace(make_path(), verdict=WORST).save(tmp_path / "path.h5")
    assert LightPath.load(tmp_path / "path.h5").verdict == WORST


@pytest.mark.parametrize("name", PATHS)
def test_files_without_one_were_not_examined(name):
    assert LightPath.load(FOLDER / name).verdict is NOT_EXAMINED


@pytest.mark.parametrize(
    "damage",
    [
        {"level": "perhaps"},
        {"findings": [{"name": "ghosts"}]},
        {"findings": [WORST.to_json()["findings"][0] | {"sigma": "much"}]},
        {"blind_to": [WORST.to_json()["blind_to"][0] | {"size": "large"}]},
        {"n_tests": None},
    ],
)
def test_a_damaged_verdict_is_a_damaged_file(tmp_path, damage):
    file = tmp_path / "path.h5"
    replace(make_path(), verdict=WORST).save(file)
    arrays, attributes = load_record(file, kind=PATH_KIND)
    attributes["verdict"] |= damage
    save_record(file, kind=PATH_KIND, arrays=arrays, attributes=attributes)
    with pytest.raises(FileFormatError):
        LightPath.load(file)


def test_the_headline_says_level_meaning_and_chance():
    assert WORST.headline == (
        "contradicted: the recording contradicts this path, its errors do not hold "
        "(p = 3e-09 over 14 tests)"
    )
    assert (
        Verdict(Level.TRUST).headline == "trust: nothing in the recording speaks against this path"
    )
    assert WORST.lines[1] == "1. index (12 σ): index off by 0.01; state it"
    assert WORST.lines[-1].startswith("blind to clock_scale up to 0.0001 of itself")


def test_the_warning_is_one_sentence_by_level():
    assert warning_of(WORST) == (
        "the recording contradicts this path: index off by 0.01, and 1 more in path.verdict"
    )
    assert warning_of(NOT_EXAMINED) == (
        "check this path before you rely on it: no recording was held against this path"
    )


def test_a_printed_path_and_its_card_start_with_the_verdict():
    path = replace(make_path(), verdict=WORST, explained=Explained(79, 222, 40.0, 100.0))
    lines = str(path).splitlines()
    assert lines[0] == WORST.headline
    assert "explains 79 of 222 pulses, 40 % of their photons" in lines
    assert "joint: three legs, " in str(path)
    assert lines[-1].startswith("3  (375.000, 75.0000, 50.0000) mm at ")
    card = path._repr_html_()
    assert card.index("contradicted") < card.index("79 of 222") < card.index("prior")


def test_a_file_carries_what_was_explained_and_both_sums(tmp_path):
    good = replace(GOOD, error_floor_ps=1.0, chi2_with_floor=8.5)
    path = replace(make_path(), goodness=good, explained=Explained(7, 9, 1.5, 2.0))
    path.save(tmp_path / "path.h5")
    again = LightPath.load(tmp_path / "path.h5")
    assert (again.goodness, again.explained) == (good, path.explained)
    _, attributes = load_record(tmp_path / "path.h5", kind=PATH_KIND)
    assert set(attributes["goodness"]) == {
        "chi2",
        "dof",
        "n_pulses",
        "n_rejected",
        "residual_rms_ps",
        "error_floor_ps",
        "converged",
    }  # versions that know no more refuse more


def test_chi2_of_an_older_file_says_that_it_hides_misfit():
    assert GOOD.chi2_in_words == "10.0 / 9"
    assert replace(GOOD, error_floor_ps=1.0).chi2_in_words == "10.0 / 9, extra scatter included"
    new = replace(GOOD, error_floor_ps=1.2, chi2_with_floor=8.0)
    assert new.chi2_in_words == "10.0 / 9"
    assert new.floor_in_words == "1.2 ps beyond the stated errors, it takes 20 % of chi2: misfit"
    old = replace(GOOD, error_floor_ps=1.2)
    assert old.floor_in_words == "1.2 ps beyond the stated errors: misfit"
    assert GOOD.floor_in_words == ""
    assert replace(GOOD, dof=0).chi2_in_words == "–"


@pytest.mark.parametrize("damage", ["many", {"n_pulses": 3}, {"n_pulses": None}])
def test_a_damaged_share_is_a_damaged_file(tmp_path, damage):
    file = tmp_path / "path.h5"
    replace(make_path(), explained=Explained(7, 9, 1.5, 2.0)).save(file)
    arrays, attributes = load_record(file, kind=PATH_KIND)
    attributes["explained"] = damage
    save_record(file, kind=PATH_KIND, arrays=arrays, attributes=attributes)
    with pytest.raises(FileFormatError):
        LightPath.load(file)
