"""Set-ups and calls that nobody means: one sentence, never an internal error or another number."""

from __future__ import annotations

import os
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from lightflight.cli.errors import sentence_and_code
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
    with pytest.raises(ValueError, match=r"counts\[0, 1, 2\] = .* is beyond 64 bits"):
        lf.Histograms(cube)
    cube[0, 1, 2] = 2.0**63
    assert lf.Histograms(cube).counts.max() == 2**63


def test_sums_of_64_bits_do_not_wrap():
    with pytest.raises(ValueError, match="add up beyond 64 bits"):
        _ = lf.Histograms(np.full((1, 1, 4), 2**63, np.uint64)).photons


PULSES = np.random.default_rng(16).poisson(
    0.05 + 60 * np.exp(-0.5 * ((np.arange(64) - 30) / 2.0) ** 2), (4, 4, 64)
)
HIST = lf.Histograms(PULSES.astype(np.uint16), bin_width_ps=20.0, laser_period_ps=1280.0)
CLOCK = lf.TimingCalibration.nominal(HIST)
CAMERA = lf.Camera.facing_plane(shape=(4, 4))


def of_shape(shape: tuple[int, ...]) -> dict[str, Any]:
    """Arrays of this shape that are no array of numbers, and numbers that no clock has."""
    some = np.ones(shape)
    far = some.copy()
    far.flat[-1] = 1e200
    return {
        "texts": np.full(shape, "a"), "bytes": np.full(shape, b"False"), "complex": some + 1j,
        "dates": np.zeros(shape, "M8[s]"), "records": np.zeros(shape, [("a", "i4")]),
        "objects": np.full(shape, None), "masked": np.ma.masked_array(some, some > 0),
        "-inf": -np.inf * some, "far": far, "a text": "x", "ragged": [[1.0, 2.0], [3.0]],
        "one axis more": some[..., None],
    }  # fmt: skip


@pytest.mark.parametrize("kind", [*of_shape((4, 4)), "nan", "tiny", "of two", "halves", "negative"])
def test_masks_say_yes_or_no_of_each_pixel(kind):
    """NaN, texts and -1 left a pixel out, None, dates and masked ones did not, all in silence."""
    odd = {"nan": np.nan, "tiny": 1e-300, "of two": 2, "halves": 0.5, "negative": -1}
    mask = np.full((4, 4), odd[kind]) if kind in odd else of_shape((4, 4))[kind]
    for call in (lf.fit_pulses, lf.find_arrivals, lf.reconstruct):
        also = {"camera": CAMERA} if call is lf.reconstruct else {}
        with pytest.raises(ValueError, match=r"exclude_mask (must|are masked)"):
            call(HIST, exclude_mask=mask, **also)


@pytest.mark.parametrize("dtype", [bool, np.uint8, int, float])
def test_masks_of_ones_and_zeros_are_taken(dtype):
    pulses = lf.fit_pulses(HIST, exclude_mask=np.eye(4, dtype=dtype), max_pulses=1)
    np.testing.assert_array_equal(np.isnan(pulses.delay_ps), np.eye(4).ravel() == 1)


ARRAYS = [one.name for one in fields(CLOCK) if isinstance(getattr(CLOCK, one.name), np.ndarray)]
# What stands for any shape: pairs of a curve, what is left out without names.
ANY_SHAPE = ("end_widths", "flat_modes_ps", "response_curve")


@pytest.mark.parametrize("name", ARRAYS)
def test_a_calibration_holds_what_a_clock_may(name):
    """Texts and None ended in NumPy's errors; dates, records, masks and -inf were taken."""
    shape = getattr(CLOCK, name).shape
    for kind, value in of_shape(shape if np.prod(shape) else (2, 4)).items():
        if kind == "one axis more" and name in ANY_SHAPE:
            continue
        if kind == "-inf" and name == "flags":
            value = np.full(shape, -1)
        with pytest.raises(ValueError, match=name) as caught:
            replace(CLOCK, **{name: value})
        assert sentence_and_code(caught.value)[1] == 2, kind


PLAIN = [one.name for one in fields(CLOCK) if one.name not in ARRAYS]


@pytest.mark.parametrize("name", PLAIN)
def test_plain_fields_of_a_calibration_are_what_they_are_called(name):
    """From Python nobody looked: `first_live_code=2**31` ended in an IndexError of NumPy."""
    for value in (object(), [1], {"a": 1}, float("nan"), -np.inf, 10**30, "x", 1e300):
        if name == "provenance" and isinstance(value, dict):
            continue
        with pytest.raises(ValueError, match=name) as caught:
            replace(CLOCK, **{name: value})
        assert sentence_and_code(caught.value)[1] == 2, value


@pytest.mark.parametrize(
    "told",
    [
        *({"n_legs": value} for value in ("x", float("nan"), float("inf"), [1], 1.5, 0)),
        *({name: value} for name in ("camera", "source", "medium", "timing", "background")
          for value in (5, "x", [object()])),
        *({name: value} for name in ("waypoints", "start", "free") for value in (5, "x")),
        {"free": None},
        {"free": [["index"]]},
        *({"max_pulses": value} for value in (1.5, "x", None, 0, 10**9)),
        *({"threads": value} for value in (1.5, "x", None, 0)),
    ],
    # An address would differ between workers.
    ids=lambda told: str(told).partition(" object at")[0],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::lightflight.errors.UncalibratedWarning")
def test_arguments_of_other_kinds_are_one_sentence(told):
    """They ended in errors of Python that named none of them."""
    call: Any = lf.fit_pulses if {"max_pulses", "threads"} & told.keys() else lf.reconstruct
    also = {"camera": CAMERA} if call is lf.reconstruct else {}
    with pytest.raises((ValueError, TypeError), match=next(iter(told))) as caught:
        call(HIST, **{**also, **told})
    text, code = sentence_and_code(caught.value)
    assert code == 2, text


@pytest.mark.parametrize("value", ["x", None, object(), [1, [2]], np.full((3, 3), "a")])
@pytest.mark.parametrize("name", ["shape", "matrix", "distortion", "world_from_camera"])
def test_a_camera_is_made_of_numbers(name, value):
    with pytest.raises(ValueError) as caught:
        replace(CAMERA, **{name: value})
    assert sentence_and_code(caught.value)[1] in (2, 5), caught.value


def test_a_background_of_other_codes_is_refused():
    """It was taken in silence: light of one delay was held against that of another."""
    dark = replace(HIST, counts=HIST.counts // 2, n_frames=10_000)
    other = replace(dark, bin_width_ps=40.0, laser_period_ps=None)
    with pytest.raises(ValueError, match="the background recording has codes of"):
        lf.fit_pulses(replace(HIST, n_frames=10_000), background=other)
