"""Files that c76c0a6 wrote open today, mean the same and work (tools/make_golden_files.py)."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.batch import job
from lightflight.cli import main
from tools.make_golden_files import (
    CALIBRATIONS,
    FOLDER,
    METHODS,
    PATHS,
    RECORDINGS,
    SET_UPS,
    SHOT_TIME_NS,
    SHOTS,
    derived_from,
    open_record,
    payload_of_page,
    plain,
    set_up_meaning,
)

DERIVED_RTOL = 1e-9
"""What is worked out from stored numbers goes through sums whose order is the machine's."""

REFIT = 1e-3
"""Share of a stated error by which a fit done again may differ. The optimum is the same, but a
kernel stops within its own tolerance of it: far below this, and this far below what matters."""


def run(*words: object) -> str:
    done = CliRunner().invoke(main, [str(word) for word in words], prog_name="lightflight")
    assert done.exit_code == 0, done.stderr
    return done.stdout


def golden(name: str) -> Any:
    return json.loads((FOLDER / name).read_text("utf-8"))


def differences(old: Any, new: Any, where: str = "", rtol: float = 0.0) -> list[str]:
    """Where a record differs from what was written of it; what is new in it may be anything."""
    if isinstance(old, dict) and "sha256" not in old:
        return [
            line
            for name, value in old.items()
            for line in differences(value, member(new, name), f"{where}.{name}", rtol)
        ]
    if isinstance(old, list) and isinstance(new, list | tuple) and len(old) == len(new):
        return [
            line
            for k, (one, other) in enumerate(zip(old, new, strict=True))
            for line in differences(one, other, f"{where}[{k}]", rtol)
        ]
    found = plain(new)
    if isinstance(old, list) and isinstance(found, list) and not isinstance(new, list | tuple):
        return differences(old, found, where, rtol)
    return [] if same(old, found, rtol) else [f"{where}: {old!r:.80} became {found!r:.80}"]


def member(record: Any, name: str) -> Any:
    if isinstance(record, Mapping) or getattr(getattr(record, "dtype", None), "names", None):
        return record[name]
    return getattr(record, name)


def same(old: Any, new: Any, rtol: float) -> bool:
    if not isinstance(old, float) or not isinstance(new, int | float):
        return bool(old == new)
    return math.isclose(old, new, rel_tol=rtol, abs_tol=rtol) or (
        math.isnan(old) and math.isnan(new)
    )


def check_meaning(old: dict[str, Any], file: Path) -> None:
    record = open_record(file)
    assert not differences(old["exact"], record)
    assert not differences(old["derived"], derived_from(record), rtol=DERIVED_RTOL)
    info = json.loads(run("info", file, "--json"))
    assert not differences(old["info"], info, rtol=DERIVED_RTOL)


@pytest.mark.parametrize("name", [*RECORDINGS, *CALIBRATIONS, *PATHS])
def test_a_file_means_what_it_meant(name):
    check_meaning(golden(f"{name}.json"), FOLDER / name)


def test_a_difference_is_seen():
    """The comparison itself: a number, a length, a missing part and a changed text."""
    path = open_record(FOLDER / "path_joint.h5")
    old = golden("path_joint.h5.json")["exact"]
    old["vertices_mm"][1][2] += 1e-12
    old["covariance"]["sha256"] = "0" * 64
    old["statements"] = ["another"]
    old["goodness"]["dof"] += 1
    assert [line.partition(":")[0] for line in differences(old, path)] == [
        ".vertices_mm[1][2]", ".covariance", ".goodness.dof", ".statements",
    ]  # fmt: skip
    with pytest.raises(AttributeError):
        differences({"vertex_mm": []}, path)


@pytest.mark.parametrize("name", SET_UPS)
def test_a_set_up_gives_the_same_records(name):
    assert not differences(golden(f"{name}.json"), set_up_meaning(FOLDER / name))


def test_a_set_up_is_spelled_out_as_before():
    spelled_out = run("simulate", "--lab", FOLDER / "lab.toml", "-o", "none.h5", "--dry-run")
    assert spelled_out == (FOLDER / "lab_spelled_out.toml").read_text("utf-8")


EXACT_POSE = ("--set", "camera.position_std_mm=0.0", "--set", "camera.rotation_std_deg=0.0")
"""What `photon` took as exact before shared errors were every estimator's."""


@pytest.mark.parametrize("method", METHODS)
def test_the_same_recording_gives_the_same_path(method, tmp_path):
    words: tuple[str | Path, ...] = (
        "--lab",
        FOLDER / "lab.toml",
        "--timing",
        FOLDER / "calibration_full.h5",
    )
    recording = FOLDER / "histograms.h5"
    words += EXACT_POSE if method == "photon" else ()
    run("reconstruct", recording, *words, "--method", method, "-o", tmp_path / "path.h5")
    new = lf.LightPath.load(tmp_path / "path.h5")
    old = lf.LightPath.load(FOLDER / f"path_{method}.h5")
    # `paper` states the errors of its angles alone: all three are held to those of `joint`.
    std = lf.LightPath.load(FOLDER / "path_joint.h5").vertex_std
    # `joint` and `photon` leave room for diffuse light and for a spot that varies along a leg: what
    # is zero within its errors moves a path within its own, most where a line runs between two rows
    # of pixels and the spot's width says how far. `paper` leaves none.
    refit = REFIT if method == "paper" else 1000 * REFIT
    assert (np.abs(new.vertices_mm - old.vertices_mm) < refit * std[:, :3]).all()
    assert (np.abs(new.vertex_times_ps - old.vertex_times_ps) < refit * std[:, 3]).all()
    # What `paper` stated before it stated shared errors too.
    stated = new.covariance_parts["photon"] if method == "paper" else new.covariance
    old_std = old.vertex_std.ravel()
    # Room for diffuse light costs up to 2 % of the stated errors. Room for the spot costs more
    # across the legs, where 4,000 photons say how wide it is: 12 % by `joint`, 51 % by `photon`.
    rtol = {"paper": REFIT, "joint": 150 * REFIT, "photon": 550 * REFIT}[method]
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), old_std, rtol=rtol, atol=1e-9)
    for name in ("row", "col", "leg", "used", "flags"):
        np.testing.assert_array_equal(new.residuals[name], old.residuals[name], name)
    for name in ("method", "prior", "source", "medium"):
        assert getattr(new, name) == getattr(old, name), name


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_the_same_recordings_give_the_same_calibration(name, tmp_path):
    bright = ("--code-density", FOLDER / "bright.h5") if "full" in name else ()
    words = ("--lab", FOLDER / "lab.toml", "--flat", FOLDER / "flat.h5", *bright)
    run("calibrate", *words, "-o", tmp_path / name)
    new, old = (lf.TimingCalibration.load(folder / name) for folder in (tmp_path, FOLDER))
    np.testing.assert_array_equal(new.flags, old.flags)
    np.testing.assert_array_equal(new.code_widths == 0, old.code_widths == 0)
    for value, std in (("gain", "gain_std"), ("phases", "phase_std"), ("skew_ps", "skew_std_ps")):
        moved = np.abs(getattr(new, value) - getattr(old, value))
        assert (moved <= REFIT * getattr(old, std)).all(), value
    assert new.bin_width_ps == pytest.approx(old.bin_width_ps, rel=1e-9)
    assert new.notes == old.notes


# --- a campaign --------------------------------------------------------------------------------


@pytest.fixture
def campaign(tmp_path, monkeypatch):
    """The campaign's folder, as the version that made it would find it."""
    shutil.copytree(FOLDER, tmp_path / "golden")
    folder = tmp_path / "golden" / "campaign"
    for name in SHOTS:
        os.utime(folder / name, ns=(SHOT_TIME_NS, SHOT_TIME_NS))
    # A new version makes all paths again, on purpose: here another layout of the same version.
    monkeypatch.setattr(job, "__version__", golden("campaign.json")["version"])
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {str(file): file.read_bytes() for file in sorted(folder.rglob("*.h5"))}


def test_a_finished_campaign_is_found_finished(campaign):
    results = campaign / "results"
    before, table = contents(results), columns_of(results / "table.csv")
    assert len(before) == len(SHOTS)
    (results / "table.csv").unlink()
    said = json.loads(run("batch", campaign / "campaign.toml", "--workers", 1, "--json"))
    assert (said["n_recordings"], said["n_done"], said["n_failed"]) == (3, 3, 0)
    assert contents(results) == before
    new = columns_of(results / "table.csv")
    # What is new to the table stands behind all that was there.
    assert list(new.items())[: len(table)] == list(table.items())
    assert new["verdict"] == ["check"] * 3
    assert new["findings"] == ["not_examined"] * 3


def columns_of(table: Path) -> dict[str, list[str]]:
    header, *rows = csv.reader(table.read_text("utf-8").splitlines())
    return {name: [row[k] for row in rows] for k, name in enumerate(header)}


def test_the_columns_of_its_parquet_are_those_written_today(campaign):
    parquet = pytest.importorskip("pyarrow.parquet")
    old = parquet.read_table(campaign / "results" / "table.parquet")
    run("batch", campaign / "campaign.toml", "--workers", 1)
    new = parquet.read_table(campaign / "results" / "table.parquet")
    assert [new.schema.field(k) for k in range(len(old.schema))] == list(old.schema)
    texts = new.select([field.name for field in old.schema if str(field.type) == "string"])
    assert texts.equals(old.select(texts.column_names))


def test_a_campaign_is_understood_as_before(campaign):
    words = run("batch", campaign / "campaign.toml", "--dry-run").replace(str(campaign), ".")
    assert words == golden("campaign.json")["dry_run"]


@pytest.mark.parametrize("name", sorted(golden("campaign.json")["files"]))
def test_a_file_of_a_campaign_means_what_it_meant(name):
    check_meaning(golden("campaign.json")["files"][name], FOLDER / "campaign" / name)


def test_a_changed_recording_is_not_taken_for_finished(campaign):
    """What the campaign tests rest on: were nothing compared, they would pass as well."""
    pytest.importorskip("distributed")
    (campaign / SHOTS[0]).touch()
    (campaign / SHOTS[0]).write_bytes(b"no recording")
    run("batch", campaign / "campaign.toml", "--workers", 1)
    table = (campaign / "results" / "table.csv").read_text("utf-8").splitlines()
    assert sum(",failed," in line for line in table) == 1


# --- a page ------------------------------------------------------------------------------------


def kinds(part: Any) -> Any:
    """What a payload is made of: keys, and the kinds of its packed arrays."""
    if isinstance(part, dict):
        return {k: v if k == "kind" else kinds(v) for k, v in part.items() if k != "base64"}
    return "list" if isinstance(part, list) else "value"


def within(new: Any, old: Any) -> Any:
    """What a payload still has of an older one."""
    if isinstance(old, dict) and isinstance(new, dict):
        return {k: within(new[k], old[k]) for k in old if k in new}
    return new


def test_a_page_holds_what_a_page_holds_today(tmp_path):
    words = (
        "--recording", FOLDER / "histograms.h5", "--timing", FOLDER / "calibration_full.h5",
        "--viewpoint", 900, 40, 30, "-o", tmp_path / "page.html",
    )  # fmt: skip
    run("view", FOLDER / "path_joint.h5", *words)
    old = payload_of_page((FOLDER / "page.html").read_text("utf-8"))
    new = payload_of_page((tmp_path / "page.html").read_text("utf-8"))
    assert old["schema"] == new["schema"] == 1
    assert within(kinds(new), kinds(old)) == kinds(old)
    for part in ("title", "path", "truth", "camera", "flags", "words", "clock", "missing"):
        assert not differences(old[part], new[part], part, rtol=1e-6)


# --- a plug-in ---------------------------------------------------------------------------------


def test_a_reader_of_before_is_found_by_its_entry_point(tmp_path):
    """An installed package with the reader of `examples/own_format.py` as it stood."""
    shutil.copy(FOLDER / "own_format.py", tmp_path)
    meta = tmp_path / "own_format-1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: own-format\nVersion: 1.0\n")
    (meta / "entry_points.txt").write_text("[lightflight.formats]\nlab = own_format:FORMAT\n")
    script = f"""
        import sys
        sys.path.insert(0, {str(tmp_path)!r})
        import lightflight as lf
        file = {str(FOLDER / "own.labtext")!r}
        for hints in ({{}}, {{"bin_width_ps": 40.0}}, {{"format": "lab-text"}}):
            hist = lf.read(file, **hints)
            print(hist.shape, int(hist.counts.sum()), hist.bin_width_ps)
        from lightflight.cli import main
        main(["info", file, "--json"])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True
    )
    lines = done.stdout.splitlines()
    assert lines[:3] == ["(2, 3) 240 50.0", "(2, 3) 240 40.0", "(2, 3) 240 50.0"]
    info = json.loads("\n".join(lines[3:]))
    assert (info["shape"], info["photons"], info["bin_width_ps"]) == ([2, 3], 240, 50.0)
