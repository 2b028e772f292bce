"""formats.tables: counts and photons as CSV and Parquet."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError, MissingExtraError

read: Any = lf.read


def columns_of(path) -> dict[str, np.ndarray]:
    if path.suffix == ".parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
        table = parquet.read_table(path)
        return {name: table[name].to_numpy() for name in table.column_names}
    rows = list(csv.reader(path.read_text().splitlines()))
    values = np.array(rows[1:], float).reshape(-1, len(rows[0]))
    return dict(zip(rows[0], values.T, strict=True))


@pytest.fixture(params=[".csv", ".parquet"])
def target(request, tmp_path):
    return tmp_path / f"table{request.param}"


@pytest.fixture
def frames(rng) -> np.ndarray:
    fired = rng.random((40, 4, 5)) < 0.2
    return np.where(fired, rng.integers(1, 16, fired.shape), 0).astype(np.uint16)


@pytest.mark.parametrize("poisson", [True, False])
def test_every_cell_with_counts_is_a_row(rng, target, poisson):
    counts = rng.poisson(0.3, (4, 5, 16)) * (1 if poisson else 0.25)
    lf.write(lf.Histograms(counts, poisson=poisson), target)
    found = columns_of(target)
    again = np.zeros(counts.shape)
    again[tuple(found[name].astype(int) for name in ("row", "col", "code"))] = found["counts"]
    np.testing.assert_array_equal(again, counts)
    assert len(found["counts"]) == np.count_nonzero(counts)


def test_every_photon_is_a_row_with_its_frame(frames, target):
    recording = lf.Recording.from_frames(frames, n_codes=16, no_photon_code=0)
    lf.write(recording, target)
    found = columns_of(target)
    frame, row, col = np.nonzero(frames)
    np.testing.assert_array_equal(found["frame"], frame)
    np.testing.assert_array_equal(found["row"], row)
    np.testing.assert_array_equal(found["col"], col)
    np.testing.assert_array_equal(found["code"], frames[frame, row, col])


def test_photons_without_frames_and_none_at_all(target):
    events = lf.Recording.from_events([1], [2], [3], shape=(4, 5), n_codes=16)
    lf.write(events, target)
    found = columns_of(target)
    assert {name: values.tolist() for name, values in found.items()} == {
        "row": [1], "col": [2], "code": [3],
    }  # fmt: skip
    nothing = np.empty(0, np.uint16)
    lf.write(replace(events, pixel=nothing, code=nothing), target)
    assert columns_of(target)["code"].size == 0


def test_frames_without_photons_in_the_no_photon_code_are_no_rows(frames, target):
    recording = lf.Recording.from_frames(frames, n_codes=16, no_photon_code=0)
    lf.write(lf.histogram(recording), target)
    found = columns_of(target)
    assert found["code"].min() > 0
    assert found["counts"].sum() == np.count_nonzero(frames)


def test_parquet_keeps_the_metadata(tmp_path, frames):
    parquet = pytest.importorskip("pyarrow.parquet")
    recording = lf.Recording.from_frames(
        frames, n_codes=16, no_photon_code=0, bin_width_ps=55.0, settings={"temperature_c": 21.5}
    )
    for record in (recording, lf.histogram(recording)):
        lf.write(record, tmp_path / "t.parquet")
        told = json.loads(parquet.read_schema(tmp_path / "t.parquet").metadata[b"lightflight"])
        assert told["bin_width_ps"] == 55.0
        assert told["settings"]["temperature_c"] == 21.5


def test_tables_are_written_only(frames, target):
    lf.write(lf.Histograms(np.ones((1, 1, 2), int)), target)
    with pytest.raises(FileFormatError, match="no known format"):
        read(target)
    with pytest.raises(FileFormatError, match="can be written, not read"):
        read(target, format=target.suffix[1:])


def test_without_pyarrow_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"lightflight\[batch\]"):
        lf.write(lf.Histograms(np.ones((1, 1, 2), int)), tmp_path / "x.parquet")
    assert list(tmp_path.iterdir()) == []
