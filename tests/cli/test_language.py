"""Errors and warnings of a command speak of its options, and blame what is to blame."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from lightflight.cli import main
from lightflight.cli.language import in_options, options_of

RECONSTRUCT = options_of(main, ["reconstruct", "recording.h5"])


@pytest.mark.parametrize(
    ("python", "command"),
    [
        ("ps, go unseen; give timing=", "ps, go unseen; give --timing"),
        ("leave n_legs out, or give a starting path (start=)",
         "leave n_legs out, or give a starting path (start= in Python)"),
        ("n_legs=3 was given but only 2 show", "--n-legs 3 was given but only 2 show"),
        ("(poisson=False): use method='joint'", "(--hint poisson=false): use --method joint"),
        ("give camera= (for", "give --lab with [camera] (for"),
        ("need shape=(rows, cols)", "need --hint shape=[rows, cols]"),
        ("axes='yxt' or axes='tyx'", "--hint axes=yxt or --hint axes=tyx"),
        ("time per code (--hint bin_width_ps=...,", "time per code (--hint bin_width_ps=...,"),
        ("data/shape=4/timing=3.h5: is empty", "data/shape=4/timing=3.h5: is empty"),
        ("n_legs=3_run1.h5: is empty", "n_legs=3_run1.h5: is empty"),
        ("free=/x: there is no such file", "free=/x: there is no such file"),
        ("a = b, p=0.3, s = c t_a / n", "a = b, p=0.3, s = c t_a / n"),
        ("--set camera.shape=5", "--set camera.shape=5"),
    ],
)  # fmt: skip
def test_arguments_become_options(python, command):
    assert in_options(python, RECONSTRUCT) == command


def test_a_command_without_the_option_is_told_as_python_says_it():
    plan = options_of(main, ["plan"])
    assert in_options("give timing=", plan) == "give timing="
    assert "focal_length_px" in options_of(main, ["calibrate", "camera"])
    assert options_of(main, ["nonsense"]) == options_of(main, [])


@pytest.fixture
def lab(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lab.toml").write_text(
        "[camera]\nshape = [8, 8]\ndistance_mm = 535.0\nfield_of_view_mm = [245.0, 245.0]\n"
    )
    return ["simulate", "--lab", "lab.toml", "--dry-run", "-o", "out.h5"]


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("camera.distnce_mm=5", "--set: unknown key 'distnce_mm' in [camera]"),
        ("camra.distance_mm=5", "--set: unknown section 'camra'"),
        ("camera.distance_mm=abc", "--set: [camera] distance_mm must be a number"),
        ("camera.distance_mm=-5", "(with --set camera.distance_mm=-5)"),
    ],
)
def test_a_slip_on_the_command_line_is_not_the_files_fault(lab, assignment, said):
    assert CliRunner().invoke(main, lab).exit_code == 0
    done = CliRunner().invoke(main, [*lab, "--set", assignment])
    assert done.exit_code == 2
    assert said in done.output


def test_a_slip_in_the_file_is_the_files(lab, tmp_path):
    (tmp_path / "lab.toml").write_text("[camera]\nshap = [8, 8]\n")
    done = CliRunner().invoke(main, lab)
    assert "lab.toml: unknown key 'shap'" in done.output
    assert "--set" not in done.output
