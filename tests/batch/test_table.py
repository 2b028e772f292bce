"""batch.table: rows from paths, repeats and their pulls, CSV and Parquet."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from lightflight.batch.campaign import Shot
from lightflight.batch.table import (
    CampaignTable,
    Repeats,
    row_from_failure,
    write_table_csv,
    write_table_parquet,
)
from lightflight.errors import MissingExtraError

SHOTS = [Shot(Path(f"{name}.h5"), f"{name}.h5", name, "g", 2.0) for name in "abc"]


def row(shot: Shot, angle: float, n_legs: int = 1) -> dict:
    legs = {
        f"leg{k + 1}_{name}": angle
        for k in range(n_legs)
        for name in ("angle_deg", "angle_std_deg", "angle_photon_std_deg")
    }
    return {
        "recording": shot.label, "group": shot.group, "set_point_deg": shot.set_point_deg,
        "status": "done", "n_legs": n_legs, "converged": True, "flags": "outlier=1", **legs,
    }  # fmt: skip


TABLE = CampaignTable(
    (
        row(SHOTS[0], 1.25),
        row_from_failure(SHOTS[1], 'is "empty", alas'),
        row(SHOTS[2], float("nan"), n_legs=2),
    )
)


def test_csv_holds_every_row_and_the_columns_of_the_longest_path(tmp_path):
    write_table_csv(TABLE, tmp_path / "t.csv")
    rows = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert [r["status"] for r in rows] == ["done", "failed", "done"]
    assert rows[1]["reason"] == 'is "empty", alas'
    assert (rows[0]["leg1_angle_deg"], rows[0]["converged"]) == ("1.25", "1")
    assert rows[0]["leg2_angle_deg"] == rows[2]["leg2_angle_deg"] == ""
    assert TABLE.n_failed == 1


def test_legs_that_nobody_saw_have_a_column_where_there_are_any(tmp_path):
    assert "n_legs_unseen" not in TABLE.columns
    more = CampaignTable((*TABLE.rows, row(SHOTS[0], 2.5, n_legs=3) | {"n_legs_unseen": 1}))
    assert more.columns[-1] == "n_legs_unseen"
    write_table_csv(more, tmp_path / "t.csv")
    lines = (tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()
    assert [line.rpartition(",")[2] for line in lines] == ["n_legs_unseen", "", "", "", "1"]


def test_a_path_that_forks_has_columns_of_its_own_behind_all_others():
    assert "n_branches" not in TABLE.columns
    more = {"n_branches": 2, "forks": "leg3=vertex1"}
    table = CampaignTable((*TABLE.rows, row(SHOTS[0], 2.5, n_legs=3) | more))
    assert table.columns[-2:] == ("n_branches", "forks")


def test_parquet_says_the_same_with_types(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    write_table_parquet(TABLE, tmp_path / "t.parquet")
    table = parquet.read_table(tmp_path / "t.parquet")
    assert tuple(table.column_names) == TABLE.columns
    assert table["leg1_angle_deg"].to_pylist() == [1.25, None, None]
    assert table["converged"].to_pylist() == [True, None, True]
    assert table["n_legs"].to_pylist() == [1, None, 2]


def test_without_pyarrow_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"lightflight\[batch\]"):
        write_table_parquet(TABLE, tmp_path / "t.parquet")


def test_a_failed_recording_is_in_no_mean():
    (group,) = TABLE.repeats()
    assert group.angle_deg.size == 2
    assert (group.name, group.set_point_deg) == ("g", 2.0)
    assert TABLE.repeats(leg=3)[0].angle_deg.size == 0
    assert np.isnan(TABLE.repeats(leg=3)[0].mean_deg)


def test_pulls_of_repeats_are_unit_normal_whatever_their_errors(rng):
    """4,000 groups of 3: the variance of 12,000 pulls (8,000 free) is 1 within 5 sigma = 8 %."""
    pulls = []
    for _ in range(4000):
        photon = rng.uniform(0.1, 0.5, 3)
        shared = rng.normal(0, 2.0)
        angle = 7.0 + shared + rng.normal(0, photon)
        pulls.append(Repeats("", None, angle, np.hypot(photon, 2.0), photon).pulls)
    assert np.mean(np.concatenate(pulls) ** 2) == pytest.approx(1.0, abs=0.08)


def test_what_repeats_share_does_not_average_out():
    photon, total = np.full(100, 0.3), np.full(100, 0.5)
    group = Repeats("", 1.0, np.linspace(0, 1, 100), total, photon)
    assert group.mean_deg == pytest.approx(0.5)
    assert group.mean_std_deg == pytest.approx(np.hypot(0.03, 0.4))
    alone = Repeats("", 1.0, np.array([2.0]), np.array([0.5]), np.array([0.3]))
    assert alone.mean_std_deg == pytest.approx(0.5)
    assert alone.pulls.size == 0
