"""One campaign with every recording that goes wrong in it, and results that were tampered with.

No row is lost, each says why, and what is sound is the same, byte for byte, as without the others.
"""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from tests.batch.conftest import CAMPAIGN, LAB, recording_at

pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="pipes, links and locks"),
]
CLAIM = (1 << 14, 1 << 14, 1 << 10)


def _flipped(file: Path, sound: Path) -> None:
    content = bytearray(sound.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def _claims(file: Path, _sound: Path) -> None:
    with h5py.File(file, "w") as out:
        out.create_dataset("counts", CLAIM, "u4", chunks=(64, 64, 1024), compression="gzip")


def _without_light(file: Path, _sound: Path) -> None:
    rng = np.random.default_rng(16)
    counts = rng.poisson(0.5, (16, 16, 128)).astype(np.uint16)
    lf.write(lf.Histograms(counts, bin_width_ps=55.0), file)


def _other_camera(file: Path, _sound: Path) -> None:
    lf.write(lf.Histograms(np.ones((4, 4, 128), np.uint16), bin_width_ps=55.0), file)


BAD: dict[str, tuple[Callable[[Path, Path], object], str]] = {
    "empty": (lambda file, _: file.touch(), "is empty"),
    "letter": (lambda file, _: file.write_bytes(b"Dear all,\n" * 9), "is not an HDF5 file"),
    "cut": (lambda file, sound: file.write_bytes(sound.read_bytes()[:3000]), "damaged"),
    "flipped": (_flipped, "damaged|digest"),
    "pipe": (lambda file, _: os.mkfifo(file), "regular file"),
    "device": (lambda file, _: file.symlink_to("/dev/zero"), "regular file"),
    "dangling": (lambda file, _: file.symlink_to("nowhere.h5"), "no such file|does not exist"),
    "loop": (lambda file, _: file.symlink_to(file.name), "symbolic links"),
    "claims": (_claims, "memory|axes|damaged"),
    "dark": (_without_light, "pulse|leg"),
    "small": (_other_camera, "4 x 4 pixels and the camera 16 x 16"),
    "locked": (lambda file, sound: shutil.copy(sound, file), "locked"),
}
GOOD = ("=1+1", os.fsdecode(b"caf\xe9"), "[red]c")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A campaign of recordings that all are sound, whatever they are called."""
    place: Path = tmp_path_factory.mktemp("campaigns") / "sound"
    (place / "angle_4").mkdir(parents=True)
    (place / "lab.toml").write_text(LAB)
    (place / "campaign.toml").write_text(CAMPAIGN)
    lf.write(recording_at(4, seed=16), place / "angle_4" / f"{GOOD[0]}.h5")
    for name in GOOD[1:]:
        shutil.copy2(place / "angle_4" / f"{GOOD[0]}.h5", place / "angle_4" / f"{name}.h5")
    return place


def run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, list[dict[str, str]]]:
    """What a run says, and its rows."""
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(main, ["batch", "campaign.toml", "--workers", "1"])
    assert done.exit_code == 0, done.output
    with (folder / "results" / "table.csv").open(encoding="utf-8", newline="") as file:
        return done.output, list(csv.DictReader(file))


def test_every_recording_that_goes_wrong_is_a_row(folder, tmp_path, monkeypatch):
    """Twelve kinds among three recordings, whose rows are those of a run without them."""
    _, alone = run(folder, monkeypatch)
    assert [row["status"] for row in alone] == ["done"] * len(GOOD)
    mixed = tmp_path / "mixed"
    shutil.copytree(folder, mixed, ignore=shutil.ignore_patterns("results"))
    sound = folder / "angle_4" / f"{GOOD[0]}.h5"
    for name, (make, _) in BAD.items():
        make(mixed / "angle_4" / f"{name}.h5", sound)
    held = "import fcntl, sys; f = open(sys.argv[1]); fcntl.flock(f, fcntl.LOCK_EX); "
    held += "print(flush=True); sys.stdin.read()"
    other = subprocess.Popen(
        [sys.executable, "-c", held, str(mixed / "angle_4" / "locked.h5")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    try:
        assert other.stdout is not None
        other.stdout.readline()
        _, rows = run(mixed, monkeypatch)
    finally:
        other.communicate()
    of = {row["recording"]: row for row in rows}
    assert len(rows) == len(BAD) + len(GOOD)
    for name, (_, why) in BAD.items():
        row = of.pop(f"angle_4/{name}.h5")
        assert row["status"] == "failed", name
        assert re.search(why, row["reason"]), (name, row["reason"])
        assert "internal" not in row["reason"], name
    assert sorted(of) == sorted(row["recording"] for row in alone)
    for row in alone:
        assert of[row["recording"]] == row
    assert not any(one.name.startswith(".") for one in (mixed / "results").rglob("*"))


def test_results_that_were_tampered_with_are_made_again(folder, monkeypatch):
    """Cut, changed in a byte, a folder in the place of one: the table is the same in the end."""
    _, rows = run(folder, monkeypatch)
    table, paths = folder / "results" / "table.csv", folder / "results" / "paths"
    before = table.read_bytes()
    cut, changed, gone = sorted(paths.glob("*.h5"))
    cut.write_bytes(cut.read_bytes()[:2000])
    _flipped(changed, changed)
    gone.unlink()
    gone.mkdir()
    table.write_text("of somebody else")
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(main, ["batch", "campaign.toml", "--workers", "1"])
    assert done.exit_code == 0, done.output
    assert len(list(csv.DictReader(table.read_text().splitlines()))) == len(rows)
    assert "cannot put a file in place of a folder" in table.read_text()  # its row says so
    gone.rmdir()
    assert run(folder, monkeypatch)[1] == rows
    assert table.read_bytes() == before
