"""Damaged files of every format: always one FileFormatError, never a crash, hang or traceback."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from tests import fuzz_process, fuzz_readers, fuzz_seeds
from tests.fuzz_bytes import mutated


def test_the_valid_files_are_valid(tmp_path):
    """A mutation says something only where the file was read before it."""
    (tmp_path / "made").mkdir()
    for seed in fuzz_seeds.seeds(tmp_path / "made"):
        path = fuzz_readers.placed(tmp_path / "now", seed, seed.content)
        assert path is not None
        record: Any = fuzz_process._read(str(path), seed.hints, seed.reads)
        if seed.reads == "recording":
            assert lf.histogram(record).counts.sum() > 0, seed.name


def test_mutations_are_the_same_every_time():
    content = bytes(range(256)) * 4
    twice = [
        [mutated(content, rng) for _ in range(50)]
        for rng in (np.random.default_rng(3), np.random.default_rng(3))
    ]
    assert twice[0] == twice[1]
    assert len(set(twice[0])) > 40


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(os.name == "nt", reason="killable readers are made for POSIX")
def test_damaged_files_are_refused_in_one_sentence(tmp_path):
    """500 of them, the same in every run; `make fuzz` does 20,000 anew."""
    tally, findings = fuzz_readers.run(500, seed=0, keep=tmp_path / "found", vendors=3)
    assert findings == []
    for name, count in tally.items():
        # Formats of vendors are read in processes of their own: few of them in a short run.
        tried = sum(count.values())
        assert tried > 0, name
        assert count["refused"] > 0 or tried < 10, f"no mutation of {name} was noticed"


@pytest.mark.skipif(os.name == "nt", reason="killable readers are made for POSIX")
def test_the_watch_sees_what_it_is_there_for(tmp_path, monkeypatch):
    """A reader that dies or hangs is reported, and the next file is read by a new one."""
    good = tmp_path / "x.npy"
    np.save(good, np.ones((2, 2, 4), np.uint16))
    hints = {"axes": "yxt"}
    reader = fuzz_process.Reader()
    try:
        assert reader.outcome(good, hints) == "read"
        assert reader.outcome(tmp_path / "absent.npy", hints) == "refused"
        assert "ConfigError" in reader.outcome(good, {"axis": "yxt"})
        reader.kill()
        assert "crash" in reader.outcome(good, hints)
        assert reader.outcome(good, hints) == "read"
        monkeypatch.setattr("select.select", lambda *_: ([], [], []))  # no answer
        assert "hang" in reader.outcome(good, hints)
    finally:
        reader.close()
