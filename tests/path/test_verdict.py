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
from lightflight.path.verdict import (
    NOT_EXAMINED,
    BlindSpot,
    Finding,
    FindingName,
    Level,
    Severity,
    Verdict,
)
from tests.path_fakes import make_path
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
        "pile_up", "units", "orientation", "calibration", "not_examined",
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
    assert str(WORST.blind_to[0]) == "clock_scale 0.0001 of itself: 0.7 mm"


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
    "damage", [{"level": "perhaps"}, {"findings": [{"name": "ghosts"}]}, {"n_tests": None}]
)
def test_a_damaged_verdict_is_a_damaged_file(tmp_path, damage):
    file = tmp_path / "path.h5"
    replace(make_path(), verdict=WORST).save(file)
    arrays, attributes = load_record(file, kind=PATH_KIND)
    attributes["verdict"] |= damage
    save_record(file, kind=PATH_KIND, arrays=arrays, attributes=attributes)
    with pytest.raises(FileFormatError):
        LightPath.load(file)
