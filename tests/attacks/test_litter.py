"""Kill -9 at any moment: nothing lost, nothing half, and the next writer sweeps up."""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from lightflight.files import litter
from lightflight.files.tables import write_csv
from lightflight.files.whole_file import atomic_path
from tests.attacks.length import at_length

pytestmark = pytest.mark.skipif(os.name == "nt", reason="processes are looked up by POSIX")


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_whoever_is_killed_loses_nothing_and_leaves_nothing(tmp_path):
    """Two kills of two commands; at length 100 of each command that writes, and a table."""
    words = [f"--kills={at_length(2, 100)}", f"--large-mb={at_length(0, 20)}"]
    only = ["--only=x.h5 -> out.h5"] if at_length(1, 0) else []
    path = os.pathsep.join([str(Path(__file__).parents[2]), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tests.attacks.kills", *words, *only], text=True,
        capture_output=True, check=False, env={**os.environ, "PYTHONPATH": path},
    )  # fmt: skip
    sys.stdout.write(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr


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


def test_everything_is_written_beside_and_renamed():
    """By construction: whoever writes to another name must stand here, with the reason."""
    source = Path(litter.__file__).parents[1]
    writes = re.compile(r"""(?<!fresh)\.(?:write_text|write_bytes)\(|(?<!fresh)\.open\("[wax]""")
    allowed = {
        "batch/cluster.py": "keys of a cluster, into its campaign's scratch folder",
        "files/disk_file.py": "writes to the fresh file it is given",
        "formats/isolation.py": "into its own temporary folder",
    }
    found = {
        file.relative_to(source).as_posix()
        for file in source.rglob("*.py")
        if writes.search(file.read_text("utf-8"))
    }
    assert found == set(allowed)


def test_cells_that_a_spreadsheet_would_run_are_quoted(tmp_path):
    hostile = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1"]
    cells = [*hostile, "-4.5", "+1e-9", "-inf", "a=b"]
    write_csv(["x"], ([cell] for cell in cells), tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        back = [row["x"] for row in csv.DictReader(file)]
    assert back == [*(f"'{cell}" for cell in hostile), *cells[5:]]
