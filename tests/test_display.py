"""Cards that notebooks show: every record has one, small, escaped, without heavy imports."""

from __future__ import annotations

import base64
import re
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET
import zlib
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags as fl
from lightflight.display import number, png_from_image, with_error
from lightflight.timing.pulses.arrivals import arrivals_from_pulses
from tests.view import fakes


def small_histograms(shape=(4, 5)):
    counts = np.random.default_rng(3).poisson(2.0, (*shape, 64))
    counts[..., 30:33] += 400
    return lf.Histograms(counts, bin_width_ps=55.0, laser_period_ps=50_000.0, n_frames=100_000)


def pulses():
    return lf.fit_pulses(
        small_histograms(), timing=lf.TimingCalibration.nominal(small_histograms())
    )


def bounds():
    path = fakes.fake_path()
    return lf.Bounds(
        path, 0.08, 0.25, np.array([0.01, 0.02, 0.03]), 1e6, 4e4, 96, "source known", ("One.",), 9.0
    )


RECORDS = {
    "Histograms": (small_histograms, "55.000 ps"),
    "Recording": (
        lambda: lf.Recording.from_frames(np.zeros((7, 4, 5), np.uint16), n_codes=64),
        'time per code</th><td style="text-align:left">unknown',
    ),
    "TimingCalibration": (lambda: lf.TimingCalibration.nominal(small_histograms()), "4 × 5 pixels"),
    "Camera": (lambda: lf.Camera.facing_plane(), "(0, 0, 535.00) mm"),
    "LightPath": (fakes.fake_path, "source known, emission time fitted"),
    "Pulses": (pulses, "20, 20 usable"),
    "Arrivals": (lambda: arrivals_from_pulses(pulses(), timing=None), "arrival time"),
    "Bounds": (bounds, "0.0800 mm"),
}


@pytest.mark.filterwarnings("ignore:.*nominal:UserWarning")
@pytest.mark.parametrize("name", RECORDS)
def test_every_record_has_a_card_that_is_small_and_well_formed(name):
    make, fact = RECORDS[name]
    record = make()
    assert type(record).__name__ == name
    card = record._repr_html_()
    assert f"<b>{name}</b>" in card
    assert fact in card
    assert len(card) < 30_000
    ET.fromstring(card)  # every element is closed
    assert "<script" not in card


def test_strings_from_outside_are_text():
    hostile = "<img src=x onerror=alert(1)>"
    card = replace(fakes.fake_path(), prior=hostile)._repr_html_()
    assert hostile not in card
    assert "&lt;img src=x" in card


def test_a_path_that_did_not_converge_or_has_no_errors_says_so():
    path = fakes.fake_path()
    goodness = replace(path.goodness, converged=False)
    card = replace(path, goodness=goodness, covariance=path.covariance * np.nan)._repr_html_()
    assert "do not trust" in card
    assert "±" not in card


def test_flags_are_counted():
    timing = lf.TimingCalibration.nominal(small_histograms())
    words = np.zeros((4, 5), np.uint32)
    words[1, 2:4] = fl.SCREAMING
    assert f"2 {fl.names_from_flags(fl.SCREAMING)[0]}" in replace(timing, flags=words)._repr_html_()


def decoded(png):
    """Grey and alpha (rows, cols, 2) of a PNG as `png_from_image` writes it."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    place, chunks = 8, {}
    while place < len(png):
        length, kind = struct.unpack(">I4s", png[place : place + 8])
        body = png[place + 8 : place + 8 + length]
        (check,) = struct.unpack(">I", png[place + 8 + length : place + 12 + length])
        assert check == zlib.crc32(kind + body)
        chunks[kind] = body
        place += 12 + length
    cols, rows, *rest = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
    assert rest == [8, 4, 0, 0, 0]
    lines = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(rows, 1 + 2 * cols)
    assert not lines[:, 0].any()
    return lines[:, 1:].reshape(rows, cols, 2)


def test_the_picture_follows_the_values_and_leaves_out_nan():
    image = np.arange(12.0).reshape(3, 4)
    image[1, 1] = np.nan
    pixels = decoded(png_from_image(image))
    assert pixels[1, 1, 1] == 0
    assert (np.delete(pixels[..., 1].ravel(), 5) == 255).all()
    known = np.delete(pixels[..., 0].ravel(), 5).astype(int)
    assert known[0] == 35
    assert known[-1] == 255
    assert (np.diff(known[:-1]) > 0).all()


def test_a_large_picture_is_thinned_by_its_mean():
    image = np.zeros((300, 200))
    image[:150] = 1.0
    pixels = decoded(png_from_image(image))
    assert pixels.shape[:2] == (100, 67)
    np.testing.assert_array_equal(pixels[:50, :, 0], 255)
    np.testing.assert_array_equal(pixels[50:, :, 0], 35)


@pytest.mark.parametrize("image", [np.full((2, 2), np.nan), np.full((1, 1), 7.0)])
def test_a_picture_of_nothing_is_still_a_picture(image):
    assert decoded(png_from_image(image)).shape[:2] == image.shape


def test_the_card_of_histograms_shows_their_photons():
    hist = small_histograms()
    data = re.search(r"base64,([^\"]+)", hist._repr_html_()).group(1)
    assert decoded(base64.b64decode(data)).shape[:2] == hist.shape


def test_cards_load_no_plotting():
    code = (
        "import sys, numpy as np, lightflight as lf\n"
        "lf.Histograms(np.ones((2, 2, 3)))._repr_html_()\n"
        "lf.Camera.facing_plane()._repr_html_()\n"
        "heavy = {'matplotlib', 'plotly', 'scipy', 'numba'} & {m.partition('.')[0] "
        "for m in sys.modules}\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_numbers_are_written_for_reading():
    assert number(-0.012345, 3) == "\u22120.0123"
    assert number(float("nan")) == "\u2013"
    assert number(1_234_567.0, 7) == "1\u2009234\u2009567"
    assert with_error(12.34567, 0.0123) == "12.346 ± 0.012"
    assert with_error(12.34567, float("nan")) == "12.3457"
