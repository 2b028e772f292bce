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
from lightflight.batch.table import CampaignTable
from lightflight.camera.calibration import CameraFit
from lightflight.display import Card, number, png_from_image, with_error
from lightflight.reconstruct.legs.find import ImageLeg
from lightflight.simulate.presets import ideal
from lightflight.timing.laser_width import LaserWidth
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


def simulated():
    return lf.simulate(small_scene(), photons_per_pixel=200.0, seed=1)


def small_scene(n_vertices=2):
    x = np.linspace(0.0, 375.0, n_vertices)
    vertices = np.stack([x, 37.5 + 20.0 * (np.arange(n_vertices) % 2), 0 * x], axis=1)
    return lf.Scene(vertices, camera=lf.Camera.facing_plane(), detector=ideal(n_codes=128))


PRINTED = {
    **{name: make for name, (make, _) in RECORDS.items()},
    "Scene": small_scene,
    "Scene of many": lambda: small_scene(60),
    "Detector": lf.Detector,
    "Truth": lambda: simulated().truth,
    "Plan": lambda: lf.plan(fakes.fake_path()),
    "Placement": lambda: lf.plan(fakes.fake_path()).placements,
    "Observation": lambda: lf.observe(fakes.fake_path(), fakes.fake_path().camera),
    "Leg": lambda: fakes.fake_path().legs,
    "Verdict": lambda: fakes.fake_path().verdict,
    "LightPath of many": lambda: long_path(40),
    "ImageLeg": lambda: ImageLeg(
        np.arange(300), np.ones(2), np.array([1.0, 0.0]), (0.0, 9.0), np.arange(3.0), 300, 4.0, 0.3
    ),
    "LaserPulse": lambda: lf.LaserPulse(LaserWidth(68.0, 2.0, 96, 120.0), np.array([70.0, 71.0])),
    "CameraFit": lambda: CameraFit(
        lf.Camera.facing_plane(), {"k1": 0.1}, {"k1": 0.01}, np.zeros((400, 2)), 0.1, 12.0
    ),
    "CampaignTable": lambda: CampaignTable(({"status": "done", "verdict": "trust"},) * 500),
}


def long_path(n_vertices):
    vertices = np.asarray(small_scene(n_vertices).vertices_mm)
    times = np.arange(n_vertices) * 100.0
    return replace(
        fakes.fake_path(), vertices_mm=vertices, vertex_times_ps=times,
        covariance=np.eye(4 * n_vertices),
    )  # fmt: skip


@pytest.mark.parametrize("name", PRINTED)
def test_records_print_what_a_person_wants(name):
    """In a session of Python too, where `repr` is shown: a calibration was 3,335 lines."""
    record = PRINTED[name]()
    for text in (str(record), repr(record)):
        assert 1 <= len(text.splitlines()) <= 15
        assert len(text) <= 3000
        assert "array(" not in text
        assert "0x" not in text  # no address
    title = name.split()[0]
    assert title in repr(record) or title in ("LightPath", "Verdict")


def test_what_is_printed_has_errors():
    path = fakes.fake_path()
    assert "\u00b1" in repr(path)
    assert "\u00b1" in repr(path.legs[0])
    assert "typical error" in repr(pulses())
    assert "trust" in repr(path) or "check" in repr(path)


def test_a_card_for_the_terminal_is_short_and_aligned():
    facts = [("a", "word " * 60), *((f"term {k}", "x") for k in range(30))]
    lines = Card("Title", facts).text().splitlines()
    assert lines[0] == "Title"
    assert len(lines) == 15
    assert lines[-1].endswith("and 21 more")
    assert max(map(len, lines)) <= 100
    assert lines[1].index("word") == lines[2].index("word")


def test_numbers_are_written_for_reading():
    assert number(-0.012345, 3) == "\u22120.0123"
    assert number(float("nan")) == "\u2013"
    assert number(1_234_567.0, 7) == "1\u2009234\u2009567"
    assert with_error(12.34567, 0.0123) == "12.346 ± 0.012"
    assert with_error(12.34567, float("nan")) == "12.3457"
