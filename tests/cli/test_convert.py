"""`lightflight convert` and `lightflight info --plot`."""

import json
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from tests.cli.conftest import lines_said

read: Any = lf.read


@pytest.fixture
def frames_file(tmp_path, rng):
    """Raw frames of a small PF32 on disk."""
    frames = np.where(rng.random((60, 8, 8)) < 0.1, rng.integers(8, 900, (60, 8, 8)), 0)
    frames.astype("<u2").tofile(tmp_path / "frames.bin")
    return tmp_path / "frames.bin"


HINTS = (
    "--hint", "shape=[8, 8]", "--hint", "footer_bytes=0", "--hint", "laser_period_ps=50000",
    "--hint", "periods_per_frame=4000",
)  # fmt: skip


def test_one_recording_in_every_format(run, frames_file, tmp_path):
    pytest.importorskip("zarr")
    expected = lf.histogram(read(frames_file, shape=(8, 8), laser_period_ps=50_000.0))
    suffixes = (".h5", ".photon.h5", ".npz", ".mat", ".zarr")
    outputs = [tmp_path / f"out{suffix}" for suffix in suffixes]
    words = [word for output in outputs for word in ("-o", output)]
    done = run("convert", frames_file, *HINTS, *words)
    assert done.exit_code == 0, done.stderr
    assert "out.npz (histograms)" in done.stdout
    assert "out.h5 (photons)" in done.stdout
    for output in outputs:
        back = lf.histogram(read(output))
        np.testing.assert_array_equal(back.counts, expected.counts)
        assert back.laser_period_ps == 50_000.0, output
        assert back.reversed_codes == expected.reversed_codes, output
    assert read(outputs[0]).kind == "events"


def test_a_part_is_counted_and_keeps_its_times(run, frames_file, tmp_path):
    done = run(
        "convert", frames_file, *HINTS, "--codes", 100, 300, "--rows", 2, 5, "--frames", 0, 30,
        "-o", tmp_path / "part.h5", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["written"] == [str(tmp_path / "part.h5")]
    whole = read(frames_file, shape=(8, 8), laser_period_ps=50_000.0)
    expected = lf.histogram(whole, codes=(100, 300), rows=(2, 5), frames=(0, 30))
    part = read(tmp_path / "part.h5")
    np.testing.assert_array_equal(part.counts, expected.counts)
    assert part.first_edge_ps == expected.first_edge_ps


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["frames.bin", *HINTS], 2, "--output"),
        (["frames.bin", *HINTS, "-o", "x.doc"], 2, "must end in"),
        (["frames.bin", *HINTS, "-o", "no/x.h5"], 2, "make the folder no"),
        (["frames.bin", *HINTS, "-o", "frames.bin"], 2, "never replaced"),
        (["frames.bin", *HINTS, "--codes", 100, 9000, "-o", "x.h5"], 2, "codes = (100, 9000)"),
        (["frames.bin", *HINTS, "--counted", "-o", "x.photon.h5"], 2, "Photon-HDF5 holds photons"),
        (["missing.bin", "-o", "x.h5"], 3, "missing.bin"),
        ([".", "-o", "x.h5"], 2, "is a folder"),
    ],
)
def test_wrong_input_is_one_sentence_and_writes_nothing(
    run, frames_file, monkeypatch, words, code, said
):
    monkeypatch.chdir(frames_file.parent)
    done = run("convert", *words)
    assert done.exit_code == code, done.stderr
    assert said in done.stderr
    assert len(lines_said(done)) == 1
    assert [file.name for file in frames_file.parent.iterdir()] == ["frames.bin"]


@pytest.mark.parametrize(("suffix", "start"), [(".png", b"\x89PNG"), (".pdf", b"%PDF")])
def test_info_draws_a_recording(run, lab_folder, tmp_path, suffix, start):
    picture = tmp_path / f"picture{suffix}"
    done = run("info", lab_folder / "recording.h5", "--plot", picture)
    assert done.exit_code == 0, done.stderr
    assert "recording (histograms)" in done.stdout
    assert picture.read_bytes().startswith(start)


def test_info_draws_recordings_alone(run, lab_folder, tmp_path):
    done = run("info", lab_folder / "calibration.h5", "--plot", tmp_path / "x.png")
    assert done.exit_code == 2
    assert "lightflight plot calibration.h5" in done.stderr
    done = run("info", lab_folder / "recording.h5", "--plot", tmp_path / "x.doc")
    assert done.exit_code == 2
    assert f"--plot {tmp_path / 'x.doc'}: the name must end in .png" in done.stderr
    assert list(tmp_path.iterdir()) == []
