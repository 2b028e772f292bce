"""Wrong input: one sentence that names it, a documented exit code, nothing half-written."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import click
import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight import errors
from lightflight.cli.errors import EXIT_CODES, one_line, sentence_and_code
from tests.cli.conftest import lines_said


def assert_refused(done, code, *words):
    """One sentence on stderr, that code, those words, and no traceback.

    Warnings and, on slow machines, progress ("reconstructing the path ...") may stand before it.
    """
    assert done.exit_code == code, (done.stderr, done.stdout, done.exception)
    lines = [
        line
        for line in done.stderr.splitlines()
        if not line.startswith("warning: ") and not line.endswith(" ...")
    ]
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("lightflight: ")
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in lines[0]


# --- the command line itself ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["reconstrct"], "reconstrct"),
        (["reconstruct"], "RECORDINGS"),
        (["info", "x.h5", "--bogus"], "--bogus"),
        (["simulate"], "--output"),
        (["simulate", "--photons", "many", "-o", "x.h5"], "many"),
        (["simulate", "--photons", "0", "-o", "x.h5"], "photons"),
        (["simulate", "--photons", "1e30", "-o", "x.h5"], "1e+30"),
        (["simulate", "--kind", "movie", "-o", "x.h5"], "movie"),
        (["simulate", "-o", "x.txt"], ".h5"),
        (["simulate", "-o", "no/such/folder/x.h5"], "no/such/folder"),
        (["calibrate", "-o", "x.h5"], "--code-density"),
        (["reconstruct", "x.h5", "--set", "bogus", "-o", "p.h5"], "section.key=value"),
        (["info", "x.h5", "--hint", "bogus"], "key=value"),
    ],
)
def test_usage(run, words, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_refused(run(*words), 2, named)
    assert list(tmp_path.iterdir()) == []


# --- set-up files --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        ("[camera]\ndistance = 535\n", ["distance", "distance_mm"]),
        ("[camra]\n", ["camra", "camera"]),
        ("[camera\n", ["TOML", "line 1"]),
        ("[camera]\ndistance_mm = 'far'\n", ["distance_mm", "number", "far"]),
        ("[medium]\npath_group_index = 0.1\n", ["path_group_index", "0.1"]),
    ],
)
def test_set_up(run, lab_folder, tmp_path, toml, words):
    path = tmp_path / "wrong.toml"
    path.write_text(toml)
    done = run("reconstruct", lab_folder / "recording.h5", "--lab", path)
    assert_refused(done, 2, "wrong.toml", *words)


def test_missing_set_up(run, lab_folder):
    assert_refused(
        run("reconstruct", lab_folder / "recording.h5", "--lab", "no.toml"), 2, "no.toml"
    )


# --- recordings ----------------------------------------------------------------------------


@pytest.fixture
def bad_file(tmp_path, lab_folder):
    """Write one of the files that are no recordings; gives its path."""
    whole = (lab_folder / "recording.h5").read_bytes()
    contents = {
        "empty.h5": b"",
        "truncated.h5": whole[: len(whole) // 2],
        "foreign.h5": b"this is a letter, not a recording\n" * 100,
        "header.h5": whole[:512],
        "picture.png": b"\x89PNG\r\n\x1a\n" + bytes(100),
    }

    def write(name):
        path = tmp_path / name
        if name in contents:
            path.write_bytes(contents[name])
        return path

    return write


@pytest.mark.parametrize(
    "name", ["missing.h5", "empty.h5", "truncated.h5", "foreign.h5", "header.h5", "picture.png"]
)
@pytest.mark.parametrize("command", ["info", "reconstruct", "calibrate"])
def test_files_that_are_no_recordings(run, bad_file, tmp_path, lab_folder, command, name):
    path = bad_file(name)
    output = tmp_path / "out.h5"
    words = {
        "info": ["info", path],
        "reconstruct": ["reconstruct", path, "--lab", lab_folder / "lab.toml", "-o", output],
        "calibrate": ["calibrate", "--flat", path, "-o", output],
    }[command]
    assert_refused(run(*words), 3, name)
    assert not output.exists()


def test_a_folder_is_no_recording(run, tmp_path):
    assert_refused(run("info", tmp_path), 3, tmp_path.name)


def test_a_recording_is_no_calibration_and_the_other_way_round(run, lab_folder):
    recording, calibration = lab_folder / "recording.h5", lab_folder / "calibration.h5"
    lab = ["--lab", lab_folder / "lab.toml"]
    assert_refused(run("reconstruct", recording, *lab, "--timing", recording), 3, "recording.h5")
    assert_refused(run("reconstruct", calibration, *lab), 3, "calibration.h5")


def save_counts(path, counts):
    np.save(path, counts)
    return path


HINTS = ("--hint", "axes=yxt", "--hint", "bin_width_ps=55")


@pytest.mark.parametrize(
    ("counts", "word"),
    [
        (np.full((4, 4, 64), np.nan), "finite"),
        (np.full((4, 4, 64), -1), "negative"),
        (np.full((4, 4, 64), 0.5), "fractional"),
        (np.zeros((4, 4)), "shape"),
    ],
)
def test_counts_that_cannot_be(run, tmp_path, counts, word):
    path = save_counts(tmp_path / "bad.npy", counts)
    done = run("info", path, *HINTS)
    assert done.exit_code in (2, 3), done.stderr
    assert "Traceback" not in done.stderr
    assert len(lines_said(done)) == 1
    assert word in done.stderr or "axes" in done.stderr


def test_no_photons_at_all(run, tmp_path, lab_folder):
    path = save_counts(tmp_path / "dark.npy", np.zeros((32, 32, 128), np.uint16))
    done = run("reconstruct", path, "--lab", lab_folder / "lab.toml", *HINTS)
    assert_refused(done, 5, "photon")


def test_background_alone_is_no_path(run, tmp_path, lab_folder):
    rng = np.random.default_rng(3)
    counts = rng.poisson(5.0, (32, 32, 128)).astype(np.uint16)
    path = save_counts(tmp_path / "flat.npy", counts)
    assert_refused(run("reconstruct", path, "--lab", lab_folder / "lab.toml", *HINTS), 5)


def test_a_calibration_of_another_camera(run, tmp_path, lab_folder):
    done = run(
        "simulate", "--photons", 2000, "-o", tmp_path / "other.h5", "--set", "camera.shape=[16,16]",
        "--set", "camera.distance_mm=535", "--set", "camera.field_of_view_mm=[245,245]",
        "--set", "camera.center_mm=[187.5,37.5]",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    done = run(
        "reconstruct", tmp_path / "other.h5", "--lab", lab_folder / "lab.toml",
        "--set", "camera.shape=[16,16]", "--timing", lab_folder / "calibration.h5",
    )  # fmt: skip
    assert_refused(done, 4, "calibration")


def test_a_camera_of_another_shape(run, lab_folder):
    done = run(
        "reconstruct", lab_folder / "recording.h5", "--lab", lab_folder / "lab.toml",
        "--set", "camera.shape=[16,16]", "--timing", lab_folder / "calibration.h5",
    )  # fmt: skip
    assert_refused(done, 5, "32 x 32", "16 x 16")


def test_codes_said_to_run_the_other_way(run, lab_folder, tmp_path):
    recording = tmp_path / "reversed.h5"
    done = run(
        "simulate", "--set", "detector.preset=ideal", "--set", "detector.reversed_codes=true",
        "--photons", 5000, "-o", recording,
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    done = run(
        "reconstruct", recording, "--lab", lab_folder / "lab.toml", "--hint", "reversed_codes=false"
    )
    assert_refused(done, 4, "--hint reversed_codes=true")


def test_an_unknown_hint_names_the_nearest(run, lab_folder):
    done = run("info", lab_folder / "recording.h5", "--hint", "bin_with_ps=55")
    assert_refused(done, 2, "bin_with_ps", "bin_width_ps")


# --- outputs -------------------------------------------------------------------------------


def test_an_input_is_never_an_output(run, lab_folder):
    recording = lab_folder / "recording.h5"
    before = recording.read_bytes()
    done = run("reconstruct", recording, "--lab", lab_folder / "lab.toml", "-o", recording)
    assert_refused(done, 2, "input")
    done = run("calibrate", "--flat", lab_folder / "flat.h5", "-o", lab_folder / "flat.h5")
    assert_refused(done, 2, "input")
    assert recording.read_bytes() == before


def test_a_file_of_another_program_is_not_replaced(run, tmp_path):
    path = tmp_path / "thesis.h5"
    with h5py.File(path, "w") as file:
        file["years"] = np.arange(4)
    before = path.read_bytes()
    assert_refused(run("simulate", "--photons", 100, "-o", path), 2, "thesis.h5")
    assert path.read_bytes() == before


def test_only_an_earlier_result_of_the_same_kind_is_replaced(run, tmp_path, lab_folder):
    for name in ("calibration.h5", "recording.h5"):
        (tmp_path / name).write_bytes((lab_folder / name).read_bytes())
    measured = replace(lf.read(tmp_path / "recording.h5"), truth=None)
    lf.write(measured, tmp_path / "measured.h5")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for name in ("calibration.h5", "measured.h5"):
        done = run("simulate", "--photons", 100, "-o", tmp_path / name)
        assert_refused(done, 2, name, "choose another name")
    assert before == {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert run("simulate", "--photons", 100, "-o", tmp_path / "recording.h5").exit_code == 0


def test_an_old_result_survives_a_failure(run, tmp_path, lab_folder):
    old = tmp_path / "path.csv"
    old.write_text("an earlier result")
    before = old.read_bytes()
    dark = save_counts(tmp_path / "dark.npy", np.zeros((32, 32, 128), np.uint16))
    done = run("reconstruct", dark, "--lab", lab_folder / "lab.toml", "-o", old, *HINTS)
    assert done.exit_code == 5
    assert old.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["dark.npy", "path.csv"]


# --- in a process of its own ---------------------------------------------------------------


def in_a_process(*words, **options):
    return subprocess.run(
        [sys.executable, "-m", "lightflight", *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        **options,
    )


def test_a_process_ends_with_one_line_and_the_code():
    done = in_a_process("info", "no-such-file.h5")
    assert done.returncode == 3
    assert done.stdout == ""
    assert len(lines_said(done)) == 1
    assert "no-such-file.h5" in done.stderr


def test_debug_shows_the_traceback():
    done = in_a_process("info", "no-such-file.h5", "--debug")
    assert done.returncode == 3
    assert "Traceback" in done.stderr


def test_a_reader_that_has_seen_enough_is_no_error(lab_folder):
    command = f"{sys.executable} -m lightflight --help | head -1"
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", command], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert done.stderr == ""


def test_ctrl_c_leaves_nothing_half_written(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "lightflight", "demo", "-o", str(tmp_path / "demo")],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / "demo").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert err.splitlines()[-1].startswith("lightflight: interrupted")
    assert not [p for p in (tmp_path / "demo").iterdir() if p.name.startswith(".")]


@pytest.mark.skipif(os.name == "nt" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written(run, tmp_path):
    tmp_path.chmod(0o500)
    try:
        done = run("simulate", "--photons", 100, "-o", tmp_path / "x.h5")
    finally:
        tmp_path.chmod(0o700)
    assert_refused(done, 3, "x.h5")


# --- the translation of errors -------------------------------------------------------------


def raised(make):
    try:
        make()
    except BaseException as error:  # noqa: BLE001
        return error
    raise AssertionError("nothing was raised")


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.ConfigError("x"), 2),
        (errors.MissingExtraError("x"), 2),
        (errors.FileFormatError("x", path="a.h5"), 3),
        (errors.CalibrationError("x"), 4),
        (errors.NothingFoundError("x"), 5),
        (errors.GeometryError("x"), 5),
        (errors.NotConvergedError("x"), 5),
        (PermissionError(13, "Permission denied", "a.h5"), 3),
        (MemoryError(), 3),
        (KeyboardInterrupt(), 130),
        (click.Abort(), 130),
        (click.UsageError("x"), 2),
        (RuntimeError("boom"), 1),
        (ZeroDivisionError(), 1),
    ],
)
def test_every_error_has_a_documented_code(error, code):
    text, found = sentence_and_code(error)
    assert found == code
    assert found in EXIT_CODES
    assert text == one_line(text)


def test_a_check_of_ours_is_the_users_mistake_but_a_slip_of_ours_is_not():
    from lightflight.flight import Medium

    text, code = sentence_and_code(raised(lambda: Medium(path_group_index=0.2)))
    assert (code, "path_group_index" in text) == (2, True)
    text, code = sentence_and_code(raised(lambda: int("seven")))
    assert code == 1
    assert "internal error" in text


def test_no_words_at_all_are_a_question_for_help(run):
    done = run()
    assert done.exit_code == 0
    assert done.stdout == run("--help").stdout


def test_help_lists_every_exit_code(run):
    text = run("--help").stdout
    for code, meaning in EXIT_CODES.items():
        assert f"{code:>3}  {meaning}" in text


@pytest.mark.parametrize(
    "command", ["simulate", "info", "calibrate", "reconstruct", "demo", "versions"]
)
def test_help_of_every_command_has_an_example(run, command):
    text = run(command, "--help").stdout
    assert "Example" in text
    assert f"lightflight {command}" in text
