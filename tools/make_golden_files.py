"""Write the golden files: what the version before the restructuring made, and what it meant.

Run once, with the code of commit c76c0a6 and never again; `tests/contracts/test_golden_files.py`
holds every later version against what was written then. Only the public names and the command
line are used here, so that the same words still run:

    git worktree add ../before c76c0a6
    PYTHONPATH=../before/src python tools/make_golden_files.py

Beside each file lies a JSON of its meaning. Numbers a file holds are `exact`; what is worked out
from them is `derived`; `info` is what `lightflight info --json` says.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import runpy
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main as command_line

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "data" / "golden"
SET_UPS = ("lab.toml", "lab_spelled_out.toml", "lab_mirrors.toml", "campaign/lab.toml")
RECORDINGS = (
    "histograms.h5", "histograms.npz", "frames.h5", "events.h5", "bright.h5", "flat.h5",
)  # fmt: skip
CALIBRATIONS = ("calibration_full.h5", "calibration_flat.h5")
METHODS = ("joint", "photon", "paper")
PATHS = tuple(f"path_{method}.h5" for method in METHODS)
SHOTS = ("angle_-4/run1.h5", "angle_4/run1.h5", "angle_4/run2.h5")

SHOT_TIME_NS = 1_600_000_000_000_000_000
"""When the recordings of the campaign were last changed: a campaign tells them apart by that,
and a checkout does not keep it."""

_MOST_NUMBERS = 100
"""Longer arrays are kept as their digest and sum."""


def run(*words: object) -> str:
    """What a command prints."""
    done = CliRunner().invoke(command_line, [str(word) for word in words], prog_name="lightflight")
    if done.exit_code:
        raise RuntimeError(f"lightflight {' '.join(map(str, words))}: {done.stderr}")
    return done.stdout


def open_record(file: Path) -> Any:
    """Recording, histograms, calibration or path, as a program opens it."""
    if file.name.startswith("calibration"):
        return lf.TimingCalibration.load(file)
    if file.name.startswith("path") or file.parent.name == "paths":
        return lf.LightPath.load(file)
    return lf.read(file)


# --- meaning ---------------------------------------------------------------------------------


def meaning_of(file: Path) -> dict[str, Any]:
    """Everything a file says, as JSON can hold it."""
    record = open_record(file)
    return {
        "exact": plain(record),
        "derived": plain(derived_from(record)),
        "info": json.loads(run("info", file, "--json")),
    }


def derived_from(record: Any) -> dict[str, Any]:
    """A few numbers that the package works out from a record."""
    if isinstance(record, lf.LightPath):
        first, last = record.vertex_times_ps[[0, -1]]
        return {
            "legs": record.legs,
            "vertex_std": record.vertex_std,
            "position": record.position_at(np.linspace(first, last, 7)),
            "sample": record.sample(9),
            "camera_center_mm": record.camera.center_mm,
        }
    if isinstance(record, lf.TimingCalibration):
        rows, cols = np.array([2, 9, 14]), np.array([3, 8, 12])
        lower, upper = record.code_intervals_ps(rows, cols)
        pixel_std, modes, names = record.arrival_errors_ps(rows, cols, np.full(3, 4000.0))
        return {
            "edges_ps": [lower[:, ::10], upper[:, ::10]],
            "arrival_errors_ps": [pixel_std, modes, names],
            "end_delay_ps": record.end_delay_ps,
        }
    hist = lf.histogram(record)
    return {"photons": hist.photons, "counts": hist.counts, "per_code": hist.counts.sum((0, 1))}


def columns_of(table: Any) -> dict[str, Any]:
    """Columns of a structured array, by name."""
    return {name: np.ascontiguousarray(table[name]) for name in table.dtype.names}


def plain(value: Any) -> Any:
    """A record, with all that lies in it, as JSON can hold it."""
    if hasattr(value, "shape") and hasattr(value, "dtype"):
        return plain_array(np.asarray(value[()] if value.shape == () else value[:]))
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, SimpleNamespace) or type(value).__name__ == "TruePath":
        return plain(vars(value))
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def plain_array(array: Any) -> Any:
    """A small array as nested lists, a large one as shape, sum and SHA-256; tables by column."""
    if array.dtype.names:
        return plain(columns_of(array))
    if 0 < array.size <= _MOST_NUMBERS:
        return array.tolist()
    kind = "<f8" if array.dtype.kind == "f" else "<i8"
    values = np.ascontiguousarray(array, dtype=kind)
    return {
        "shape": list(array.shape),
        "sum": np.nansum(values).item(),
        "sha256": hashlib.sha256(values.tobytes()).hexdigest(),
    }


def set_up_meaning(file: Path) -> dict[str, Any]:
    """Every key of a set-up, defaults spelled out."""
    from lightflight.lab import lab_from_toml, table_from_lab

    return plain(table_from_lab(lab_from_toml(file)))  # type: ignore[no-any-return]


def payload_of_page(text: str) -> dict[str, Any]:
    """The data in a page."""
    found = re.search(r'<script id="payload" type="application/json">(.*?)</script>', text, re.S)
    assert found
    return json.loads(found[1])  # type: ignore[no-any-return]


def campaign_meaning(folder: Path) -> dict[str, Any]:
    """What a campaign says it would do, and what it made."""
    return {
        "version": lf.__version__,
        "dry_run": run("batch", folder / "campaign.toml", "--dry-run").replace(str(folder), "."),
        "table": (folder / "results" / "table.csv").read_text("utf-8"),
        "files": {
            str(file.relative_to(folder)): meaning_of(file) for file in sorted(folder.rglob("*.h5"))
        },
    }


def write_json(value: Any, file: Path) -> None:
    """Keep a meaning beside its file."""
    file.write_text(json.dumps(value, ensure_ascii=False, separators=(",", ":")) + "\n", "utf-8")


# --- files -----------------------------------------------------------------------------------


def make_recordings(lab: Path) -> None:
    """The twin's recordings, of every kind."""
    for seed, (name, kind, photons) in enumerate(
        (
            ("histograms", "histograms", 4000),
            ("frames", "frames", 30),
            ("events", "events", 30),
            ("bright", "code_density", 60_000),
            ("flat", "flat", 10_000),
        ),
        start=1,
    ):
        output = lab.parent / f"{name}.h5"
        words = ("--kind", kind, "--photons", photons, "--seed", seed)
        run("simulate", "--lab", lab, *words, "-o", output)
    run("convert", lab.parent / "events.h5", "-o", lab.parent / "histograms.npz")


def make_results(lab: Path) -> None:
    """Calibrations, paths by each estimator, and a page."""
    folder = lab.parent
    full, flat = (folder / name for name in CALIBRATIONS)
    run("calibrate", "--lab", lab, "--flat", folder / "flat.h5", "-o", flat)
    bright = ("--code-density", folder / "bright.h5")
    run("calibrate", "--lab", lab, *bright, "--flat", folder / "flat.h5", "-o", full)
    recording = folder / "histograms.h5"
    for method in METHODS:
        words = ("--lab", lab, "--timing", full, "--method", method)
        run("reconstruct", recording, *words, "-o", folder / f"path_{method}.h5")
    page = folder / "page.html"
    shown = ("--recording", recording, "--timing", full, "--viewpoint", 900, 40, 30)
    run("view", folder / "path_joint.h5", *shown, "-o", page)


def make_campaign(lab: Path) -> None:
    """Three recordings of one leg, and what `lightflight batch` makes of them."""
    folder = lab.parent / "campaign"
    for seed, name in enumerate(SHOTS, start=11):
        shot = folder / name
        shot.parent.mkdir(exist_ok=True)
        rise = 290.0 * np.tan(np.deg2rad(int(shot.parent.name.removeprefix("angle_"))))
        vertices = f"scene.vertices_mm=[[0, 10, 0], [290, 30, {rise:.3f}]]"
        words = ("--photons", 1000, "--seed", seed)
        run("simulate", "--lab", lab, "--set", vertices, *words, "-o", shot)
        os.utime(shot, ns=(SHOT_TIME_NS, SHOT_TIME_NS))
    run("batch", folder / "campaign.toml", "--workers", 1)
    (folder / "results" / "summary.png").unlink()  # large, and says what the table says


def make_own_format() -> None:
    """A file of the format that a plug-in of that time reads."""
    write = runpy.run_path(str(FOLDER / "own_format.py"))["write_lab_text"]
    counts = (np.arange(2 * 3 * 20) * 7 % 5).reshape(2, 3, 20)
    write(lf.Histograms(counts, bin_width_ps=50.0), FOLDER / "own.labtext")


def main() -> None:
    """Make all files, then write down what they mean."""
    lab = FOLDER / "lab.toml"
    dry = ("simulate", "--lab", lab, "-o", "none.h5", "--dry-run")
    (FOLDER / "lab_spelled_out.toml").write_text(run(*dry), "utf-8")
    make_recordings(lab)
    make_results(lab)
    make_campaign(lab)
    make_own_format()
    for name in SET_UPS:
        write_json(set_up_meaning(FOLDER / name), FOLDER / f"{name}.json")
    for name in (*RECORDINGS, *CALIBRATIONS, *PATHS):
        write_json(meaning_of(FOLDER / name), FOLDER / f"{name}.json")
    write_json(campaign_meaning(FOLDER / "campaign"), FOLDER / "campaign.json")


if __name__ == "__main__":
    main()
