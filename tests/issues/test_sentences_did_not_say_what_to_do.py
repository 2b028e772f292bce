"""Slips of a newcomer were told in the words of Python or click, or without a cure."""

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main


@pytest.fixture
def folder(tmp_path, monkeypatch, rng):
    monkeypatch.chdir(tmp_path)
    hist = lf.Histograms(rng.poisson(3.0, (8, 16, 64)), bin_width_ps=55.0)
    lf.write(hist, "mine.h5")
    np.save("cube.npy", np.asarray(hist.counts))
    (tmp_path / "latin.toml").write_bytes(b"# 10 \xb0C\n")
    (tmp_path / "empty.toml").touch()
    (tmp_path / "notes.txt.bak").write_text("hello")
    (tmp_path / "folder").mkdir()
    return tmp_path


CAMERA = ("calibrate", "camera", "--shape", "8", "16", "-o", "camera.toml")


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ("plan latin.toml", 2, "latin.toml: is not a text file in UTF-8, as TOML is: name a"),
        ("plan none.toml", 2, "none.toml: there is no such set-up file: check the name"),
        ("view none.html", 3, "none.html: there is no such file: check the name"),
        (f"{' '.join(CAMERA)} folder", 3, "folder: is a folder, not a file: name a file in it"),
        (f"{' '.join(CAMERA)} none.csv", 3, "none.csv: there is no such file: check the name"),
        ("info cube.npy --hint axes=yxt --hint bin_width_ps=-5", 2,
         "hint bin_width_ps must be positive, got -5"),
        ("info mine.h5 --hint axes=yxt", 2, "mine.h5: unknown hint 'axes'"),
        ("info notes.txt.bak", 3, "say which with --hint format= ("),
        ("check empty.toml mine.h5", 2,
         "empty.toml: has no camera to check: [camera] lacks distance_mm and field_of_view_mm"),
        ("convert mine.h5 --codes 60 10 -o a.npz", 2, "codes = (60, 10) must ascend"),
        ("calibrate --flat mine.h5 --flat-arrival-ps soon -o a.h5", 2,
         "--flat-arrival-ps soon: is neither a number of ps nor the name of a file"),
        ("reconstruct mine.h5 --n-legs three", 2, "'three' is no whole number"),
        ("view path.h5 --viewpoint 1 2", 2, "(see lightflight view --help)"),
        ("simulate --photons many -o a.h5", 2, "'many' is no number"),
    ],
)  # fmt: skip
def test_it_is_told_what_is_wrong_and_where(folder, words, code, said):
    done = CliRunner().invoke(main, words.split())
    assert said in " ".join(done.stderr.split())
    assert done.exit_code == code
    assert not list(folder.glob("a.*"))
