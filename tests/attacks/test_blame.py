"""Who is to blame: only damage is called damage."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files.filecheck import damage_as_format_error
from lightflight.formats import isolation

read: Any = lf.read


@pytest.fixture(autouse=True)
def readers_of_this_file_are_found(monkeypatch):
    told = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, told)))


def test_want_of_memory_is_no_damage(tmp_path):
    with pytest.raises(MemoryError), damage_as_format_error(tmp_path):
        np.empty(1 << 50, np.uint8)


@pytest.mark.skipif(sys.platform != "linux", reason="locks differ")
def test_a_locked_file_is_no_damage(tmp_path):
    """HDF5 locks what it writes; another process meets the lock."""
    lf.write(lf.Histograms(np.ones((2, 2, 8), np.uint16)), tmp_path / "x.h5")
    code = "import lightflight as lf, sys; lf.read(sys.argv[1])"
    with h5py.File(tmp_path / "x.h5", "r+"):
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "x.h5")],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    said = done.stderr.splitlines()[-1]
    assert "is locked: another program has it open" in said
    assert "damaged" not in said


@pytest.mark.parametrize(
    ("error", "text", "is_damage"),
    [
        (ValueError("bad header"), "(bad header): the file is damaged", True),
        (
            PermissionError(13, "Permission denied"),
            "see to the disk, the network or the perm",
            False,
        ),
        (OSError(5, "Input/output error"), "(Input/output error): see to the disk", False),
        (AttributeError("no such name"), "a fault of lightflight or of a library, or", True),
        (AssertionError(), "(AssertionError: AssertionError): a fault of lightflight", True),
    ],
)
def test_each_kind_has_its_own_words(tmp_path, error, text, is_damage):
    with pytest.raises(FileFormatError) as caught, damage_as_format_error(tmp_path / "x"):
        raise error
    assert text in str(caught.value)
    assert ("damaged" in str(caught.value)) == is_damage


def killed(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    os.kill(os.getpid(), signal.SIGKILL)
    return {}, {}


def short_of_memory(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    raise MemoryError


def faulty(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    raise AttributeError("module has no such name")


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
@pytest.mark.parametrize(
    ("function", "text"),
    [
        ("killed", "was ended from outside, as the system does for want of memory"),
        ("short_of_memory", "the file is damaged, or memory is short"),
        ("faulty", "a fault of lightflight or of a library"),
    ],
)
def test_what_a_vendors_reader_died_of(tmp_path, function, text):
    (tmp_path / "x").write_bytes(b"x")
    with pytest.raises(FileFormatError, match=text):
        isolation.run_isolated(f"tests.attacks.test_blame:{function}", tmp_path / "x", {})


def test_a_worker_that_is_killed_while_it_starts_is_not_the_scripts_guard(tmp_path):
    cluster = pytest.importorskip("lightflight.batch.cluster")
    said = cluster._why_not(RuntimeError("Nanny failed to start."), tmp_path)
    assert "it was ended while it started" in said
    (tmp_path / "imported").touch()
    assert "must stand under" in cluster._why_not(RuntimeError("Nanny failed to start."), tmp_path)


def test_a_header_of_brackets_alone_is_damage(tmp_path):
    """Python's own reading of NumPy's header gave a fault of a kind nobody had named."""
    (tmp_path / "x.npy").write_bytes(b"\x93NUMPY\x01\x00\x10\x27" + b"(" * 10_000)
    with pytest.raises(FileFormatError, match="has no readable"):
        read(tmp_path / "x.npy", axes="yxt")
