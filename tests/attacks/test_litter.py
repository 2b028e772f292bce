"""Kill -9 at any moment: nothing lost, nothing half, and the next writer sweeps up."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.files import litter
from lightflight.files.tables import write_csv
from lightflight.files.whole_file import atomic_path
from tests.attacks.length import at_length

pytestmark = pytest.mark.skipif(os.name == "nt", reason="processes are looked up by POSIX")
read: Any = lf.read

WRITER = """
import sys, numpy as np, lightflight as lf
cube = np.random.default_rng(int(sys.argv[2])).integers(0, 9, (64, 64, 256)).astype(np.uint16)
hist = lf.Histograms(cube)
if sys.argv[1].endswith("zarr"):
    import zarr
lf.write(lf.Histograms(cube[:1, :1]), "warm" + sys.argv[1])
print("ready", flush=True)
for _ in range(100):
    lf.write(hist, sys.argv[1])
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["x.h5", "x.npz", "x.zarr"])
def test_whoever_is_killed_loses_nothing_and_leaves_nothing(tmp_path, name, monkeypatch):
    """Kills at random moments of endless writing (seed 16): 4 of each kind, at length 34."""
    if name == "x.zarr":
        pytest.importorskip("zarr")
    rng = np.random.default_rng(16)
    first = rng.integers(0, 9, (64, 64, 256)).astype(np.uint16)
    lf.write(lf.Histograms(first), tmp_path / name)
    known = {first.tobytes()}
    for number in range(at_length(4, 34)):
        known.add(
            np.random.default_rng(number).integers(0, 9, (64, 64, 256)).astype("u2").tobytes()
        )
        process = subprocess.Popen(
            [sys.executable, "-c", WRITER, name, str(number)], cwd=tmp_path,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        assert process.stdout.readline() == "ready\n"
        time.sleep(rng.uniform(0, 0.4))
        process.send_signal(signal.SIGKILL)
        process.communicate()
        assert read(tmp_path / name).counts.tobytes() in known
    monkeypatch.setattr(litter, "_swept", set())
    lf.write(lf.Histograms(first), tmp_path / name)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted([name, f"warm{name}"])


def _of(folder: Path, process: int, *, machine: str | None = None, more: str = "") -> Path:
    """Something a process would have left."""
    path = folder / f".lightflight-{machine or litter._machine()}-{process}-7-{more}abc.h5"
    path.mkdir() if more else path.write_text("half")
    return path


def test_only_what_the_dead_of_this_machine_left_is_taken_away(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    dead = _of(tmp_path, gone.pid)
    elsewhere = _of(tmp_path, gone.pid, machine="0123abcd")
    unknown = tmp_path / ".lightflight-abc.h5"
    unknown.write_text("of an earlier version")
    old = _of(tmp_path, gone.pid, more="old-")
    (old / "cube.zarr").mkdir()
    with atomic_path(tmp_path / "mine.csv") as fresh:
        assert fresh.name.startswith(f".lightflight-{litter.maker()}-")
        litter._swept.clear()
        with atomic_path(tmp_path / "other.csv"):
            pass
        assert fresh.exists()
    assert not dead.exists()
    assert not old.exists()
    assert (tmp_path / "cube.zarr").is_dir(), "the old folder was the only one: it goes back"
    assert elsewhere.exists()
    assert unknown.exists()


def test_a_process_that_has_the_number_of_a_dead_one_is_not_its_maker():
    if sys.platform != "linux":
        pytest.skip("asks /proc")
    assert litter._is_dead(litter._machine(), os.getpid(), 7)
    assert not litter._is_dead(litter._machine(), os.getpid(), litter._started(os.getpid()))


def test_temporary_folders_of_killed_campaigns_are_taken_away(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(litter, "_swept", set())
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    left = tmp_path / f"lightflight-{litter._machine()}-{gone.pid}-7-abc"
    (left / "scratch").mkdir(parents=True)
    with litter.temporary_folder() as folder:
        assert not left.exists()
        assert folder.parent == tmp_path
    assert list(tmp_path.iterdir()) == []


def test_cells_that_a_spreadsheet_would_run_are_quoted(tmp_path):
    hostile = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1"]
    cells = [*hostile, "-4.5", "+1e-9", "-inf", "a=b"]
    write_csv(["x"], ([cell] for cell in cells), tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        back = [row["x"] for row in csv.DictReader(file)]
    assert back == [*(f"'{cell}" for cell in hostile), *cells[5:]]
