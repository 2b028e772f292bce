"""Paths and calibrations with a sound digest that say what no program of ours writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files.store import load_record, save_record
from tests.path_fakes import make_path

DEEP: Any = []
for _ in range(400):
    DEEP = [DEEP]


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    file: Path = tmp_path_factory.mktemp("sound") / "path.h5"
    make_path().save(file)
    return file


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ("method", "x" * 3_000_000),
        ("prior", 1e308),
        ("prior", {"a": 1}),
        ("goodness.chi2", None),
        ("goodness.chi2", DEEP),
        ("goodness.dof", "<script>"),
        ("goodness.dof", 10**400),
        ("goodness.n_pulses", "x" * 3_000_000),
        ("goodness.converged", 1),
        ("statements", "x" * 3_000_000),
        ("statements", [[]]),
        ("statements", ["x"] * 100_000),
        ("prices", [DEEP]),
        ("provenance", "x"),
    ],
)
def test_a_path_that_no_fit_makes_is_refused(sound, tmp_path, where, value):
    """They ended in internal errors, and a title of three million letters in minutes."""
    arrays, attributes = load_record(sound, kind="path")
    plain = json.loads(json.dumps(attributes))
    *above, last = where.split(".")
    place = plain
    for name in above:
        place = place[name]
    place[last] = value
    save_record(tmp_path / "x.h5", kind="path", arrays=arrays, attributes=plain)
    with pytest.raises(FileFormatError, match=f"{last} cannot be|it holds") as caught:
        lf.LightPath.load(tmp_path / "x.h5")
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


@pytest.mark.parametrize("value", ["x" * 3_000_000, [DEEP], [1], {"a": 1}])
@pytest.mark.parametrize("name", ["notes", "flat_mode_names", "shape"])
def test_a_calibration_of_other_texts_is_refused(tmp_path, name, value):
    """`info` ended in an internal error, and an error in a sentence of three million letters."""
    hist = lf.Histograms(np.ones((2, 2, 32), np.uint16), bin_width_ps=55.0, laser_period_ps=1500.0)
    timing = lf.TimingCalibration.nominal(hist)
    timing.save(tmp_path / "y.h5")
    arrays, attributes = load_record(tmp_path / "y.h5", kind="calibration")
    value = [None] if name == "shape" and value == [1] else value
    changed = {**attributes, name: value}
    save_record(tmp_path / "x.h5", kind="calibration", arrays=arrays, attributes=changed)
    with pytest.raises(FileFormatError, match=f"{name} cannot be") as caught:
        lf.TimingCalibration.load(tmp_path / "x.h5")
    assert len(str(caught.value)) < 500 + len(str(tmp_path))


def test_no_sentence_is_longer_than_a_page():
    assert len(str(FileFormatError("x" * 3_000_000, path="y.h5"))) < 1000
    assert str(FileFormatError(np.array2string(np.arange(9)))) == "[0 1 2 3 4 5 6 7 8]"
