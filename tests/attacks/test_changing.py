"""Recordings that are cut, replaced or taken away while they are read: one sentence, no crash."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files.mapped import mapped, rows_of

read: Any = lf.read
FRAMES = np.random.default_rng(16).integers(0, 900, (300, 32, 32)).astype("<u2")

CUT = """
import os, sys, lightflight as lf
from pathlib import Path
from lightflight.errors import FileFormatError
path = Path(sys.argv[1])
hints = {"axes": "fyx", "n_codes": 1024} if path.suffix == ".npy" else {"footer_bytes": 0}
recording = lf.read(path, no_photon_code=0, **hints)
os.truncate(path, 4096)
for use in (lf.histogram, lambda one: lf.write(one, path.with_name("out.h5")),
            lambda one: lf.write(one, path.with_name("out.bin"))):
    try:
        use(recording)
    except FileFormatError as error:
        print(error)
"""


@pytest.mark.skipif(not hasattr(os, "preadv"), reason="POSIX")
@pytest.mark.parametrize("name", ["x.bin", "x.npy"])
def test_frames_that_are_cut_end_no_process(tmp_path, name):
    """A camera that starts again under the same name: the process ended by SIGBUS."""
    np.save(tmp_path / name, FRAMES) if name == "x.npy" else FRAMES.tofile(tmp_path / name)
    done = subprocess.run(
        [sys.executable, "-c", CUT, str(tmp_path / name)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(f"{tmp_path / name}: was cut while it was read") == 3, done.stdout
    assert [one.name for one in tmp_path.iterdir()] == [name]


def test_rows_are_those_of_the_map(tmp_path):
    """Of frames, of frames with footers beside them, of footers, of the other order."""
    words = np.random.default_rng(16).integers(0, 1 << 16, (40, 30), dtype=np.uint16)
    path: Path = tmp_path / "x"
    for order in ("C", "F"):
        path.write_bytes(bytes(4099) + words.tobytes(order))
        whole: Any = mapped(path, "<u2", words.shape, offset=4099, order=order)
        views = [whole, whole[5:]]
        if order == "C":
            views += [whole[:, :24].reshape(40, 4, 6), whole[:, 24:].view(np.uint8)]
        for view in views:
            for first, last in ((0, 40), (7, 9), (39, 99), (12, 12)):
                np.testing.assert_array_equal(rows_of(view, first, last), view[first:last])


def test_a_file_that_takes_its_place_is_not_mixed_in(tmp_path):
    FRAMES.tofile(tmp_path / "x.bin")
    recording = read(tmp_path / "x.bin", footer_bytes=0)
    expected = lf.histogram(recording).counts
    (FRAMES // 2).tofile(tmp_path / "y.bin")
    (tmp_path / "y.bin").rename(tmp_path / "x.bin")
    np.testing.assert_array_equal(lf.histogram(recording).counts, expected)


@pytest.mark.parametrize("how", ["cut", "replaced", "gone"])
def test_events_that_are_no_longer_there_are_not_left_out(tmp_path, monkeypatch, how):
    """999 of 50,000 photons were counted, in silence."""
    from lightflight.formats import spc

    monkeypatch.setattr(spc, "_RECORDS_AT_ONCE", 1000)
    monkeypatch.setattr(spc, "_HELD_BYTES", 0)
    records = np.random.default_rng(16).integers(0, 1 << 28, 5000).astype("<u4")
    records[0] = 0x80000064
    path = tmp_path / "x.spc"
    records.tofile(path)
    recording = read(path)
    if how == "cut":
        os.truncate(path, 4000)
    elif how == "gone":
        path.unlink()
    else:
        np.full(5000, 0xA0000000, "<u4").tofile(path)
    with pytest.raises(FileFormatError, match=r"x\.spc: (was changed while|cannot be read \(No)"):
        lf.histogram(recording)
