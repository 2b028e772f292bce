"""Set-ups and calls that nobody means: one sentence, never an internal error or another number."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from lightflight.errors import ConfigError
from lightflight.files.toml_tables import table_from_toml, value_from_text

CUBE = np.ones((2, 2, 8), np.uint16)
FRAMES = np.ones((5, 2, 2), np.uint16)
EVENTS = {"pixel": np.zeros(3, np.uint16), "code": np.zeros(3, np.uint16)}


@pytest.mark.parametrize(
    "text",
    [
        "x = " + "[" * 100_000,
        "x = " + "[" * 500 + "]" * 500,
        ".".join(["a"] * 20_000) + " = 1",
        "[" + ".".join(["a"] * 20_000) + "]",
        "x = " + "9" * 5000,
        "[camera]\ndistance_mm = " + "9" * 400,
        "[camera]\nshape = [2e9, 2e9]",
        "[camera]\nshape = [" + "9" * 30 + ", 2]",
        '[recording]\naxes = "yxt"\nshape = [2e9, 2e9]',
    ],
    ids=lambda text: text[:24],
)
def test_a_set_up_that_hurts_is_one_sentence(tmp_path, text):
    (tmp_path / "lab.toml").write_text(text)
    np.save(tmp_path / "x.npy", CUBE)
    words = ["reconstruct", str(tmp_path / "x.npy"), "--lab", str(tmp_path / "lab.toml")]
    done = CliRunner().invoke(main, [*words, "-o", str(tmp_path / "p.h5")])
    assert done.exit_code == 2, done.output
    assert "internal error" not in done.output
    assert len(done.output) < 600


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_a_set_up_that_is_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "lab.toml")
    with pytest.raises(ConfigError, match="is no regular file"):
        table_from_toml(tmp_path / "lab.toml")


def test_a_value_on_the_command_line_that_hurts_stays_text():
    text = "[" * 100_000
    assert value_from_text(text) == text


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"no_photon_code": 1.0}, "no_photon_code must be a whole number, got 1.0"),
        ({"no_photon_code": True}, "no_photon_code must be a whole number, got True"),
        ({"no_photon_code": [1]}, "no_photon_code must be a whole number"),
        ({"n_frames": "1"}, "n_frames must be positive and finite, got '1'"),
        ({"bin_width_ps": "55"}, "bin_width_ps must be positive and finite, got '55'"),
        ({"bin_width_ps": [1]}, "bin_width_ps must be positive and finite"),
        ({"bin_width_ps": 1 + 2j}, "bin_width_ps must be positive and finite"),
        ({"first_edge_ps": None}, "first_edge_ps must be finite, got None"),
    ],
)
def test_fields_of_the_clock(fields, text):
    with pytest.raises(ValueError, match=text.replace("[", r"\[")):
        lf.Histograms(CUBE, **fields)
    with pytest.raises(ValueError, match=text.split()[0]):
        lf.Recording.from_frames(FRAMES, n_codes=8, **fields)


@pytest.mark.parametrize("shape", [(4.0, 5), (2e9, 2e9), (2,), "ab", 5, (-1, 2), (True, 2), None])
def test_shapes(shape, tmp_path):
    with pytest.raises(ValueError, match="shape"):
        lf.Recording(shape, n_codes=8, **EVENTS)
    np.save(tmp_path / "x.npy", np.ones((4, 8), np.uint16))
    read: Any = lf.read
    with pytest.raises(ConfigError, match="shape"):
        read(tmp_path / "x.npy", axes="pt", shape=shape)


@pytest.mark.parametrize("n_codes", [8.0, "8", None])
def test_numbers_of_codes(n_codes):
    with pytest.raises(ValueError, match="n_codes must be a whole number"):
        lf.Recording.from_frames(FRAMES, n_codes=n_codes)


def test_masks_are_not_passed_over():
    masked = np.ma.masked_array(CUBE, CUBE > 0)
    with pytest.raises(ValueError, match="counts are masked in places"):
        lf.Histograms(masked)
    with pytest.raises(ValueError, match="frames are masked in places"):
        lf.Recording.from_frames(np.ma.masked_equal(FRAMES, 1), n_codes=8)
    assert lf.Histograms(np.ma.masked_array(CUBE, False)).counts.sum() == CUBE.sum()


@pytest.mark.parametrize("count", [2.0**64, 1e300])
def test_counts_beyond_64_bits_are_refused(count):
    cube = np.zeros((2, 2, 8))
    cube[0, 1, 2] = count
    with pytest.raises(ValueError, match=r"counts\[\(0, 1, 2\)\] = .* is beyond 64 bits"):
        lf.Histograms(cube)
    cube[0, 1, 2] = 2.0**63
    assert lf.Histograms(cube).counts.max() == 2**63


def test_sums_of_64_bits_do_not_wrap():
    with pytest.raises(ValueError, match="add up beyond 64 bits"):
        _ = lf.Histograms(np.full((1, 1, 4), 2**63, np.uint64)).photons
