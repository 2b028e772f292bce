"""Metres, ns, a swapped field and a mirrored picture gave six legs, a crash, or no remark."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import GeometryError
from lightflight.reconstruct.legs.plausible import aspect, implausible
from tests.labs import three_legs

METRES = lf.Camera.facing_plane(
    distance_mm=0.535, field_of_view_mm=(0.245, 0.245), center_mm=(0.1875, 0.0375)
)


def recorded(lab):
    hist = lab.recording(4)
    arrivals = lf.find_arrivals(hist, timing=lab.timing)
    return hist, lf.find_legs(arrivals, camera=lab.camera)


def found(camera, source, legs, *, code_ps=55.0):
    return [one.name for one in implausible(camera, source, lf.Medium(), legs, code_ps=code_ps)]


def test_a_sound_set_up_has_no_finding():
    lab = three_legs()
    _, legs = recorded(lab)
    for source in (lab.known, lab.timed, lf.Source()):
        assert found(lab.camera, source, legs) == []


def test_metres_are_refused_in_one_sentence_before_other_paths_are_tried(monkeypatch):
    """They were for half a minute: ways that nobody saw explain what no light can do."""
    monkeypatch.setattr(import_module("lightflight.reconstruct.answer"), "detour_instead", None)
    lab = three_legs()
    hist, _ = recorded(lab)
    for n_legs in (None, 3):
        with pytest.raises(GeometryError, match=r"all lengths in mm.*0\.535 mm.*or 535\?"):
            lf.reconstruct(hist, camera=METRES, source=lab.timed, timing=lab.timing, n_legs=n_legs)


@pytest.mark.parametrize(("times", "refused"), [(50.0, False), (1000.0, True)])
def test_steep_legs_are_no_metres(times, refused):
    """Away from the camera, 2 degrees off the line of sight, light seems 57 times slower."""
    lab = three_legs()
    _, legs = recorded(lab)
    slower = [replace(leg, time_coefficients=leg.time_coefficients * times) for leg in legs]
    assert ("units" in found(lab.camera, lab.timed, slower)) == refused


def test_places_in_metres_and_times_in_ns_are_units():
    lab = three_legs()
    _, legs = recorded(lab)
    off = lf.Source((-0.1875, 0.003, 0.0))
    assert "units" in found(lab.camera, off, legs)
    assert found(lab.camera, lf.Source((0, 0, 0), emission_time_ps=2.0), legs) == ["units"]
    assert found(lab.camera, lf.Source((0, 0, 0), emission_time_ps=0.0), legs) == []


def test_a_swapped_field_is_told_by_its_pixels():
    sound = lf.Camera.facing_plane((24, 32), field_of_view_mm=(245.0, 183.75))
    swapped = lf.Camera.facing_plane((24, 32), field_of_view_mm=(183.75, 245.0))
    assert aspect(sound, lf.Source()) is None
    assert "swap width and height" in aspect(swapped, lf.Source()).remedy
    oblong = lf.Camera.facing_plane((32, 32), field_of_view_mm=(245.0, 170.0))
    assert "are width and height" in aspect(oblong, lf.Source()).remedy


@pytest.mark.parametrize(
    ("turned", "words"),
    [
        (lambda c: c[:, ::-1], "mirrored left to right"),
        (lambda c: c[::-1], "mirrored top to bottom"),
        (lambda c: c[::-1, ::-1], "turned by 180"),
        (lambda c: np.swapaxes(c, 0, 1), "transposed"),
    ],
)
def test_pictures_the_other_way_round_are_named(turned, words):
    lab = three_legs()
    hist = lab.recording(4)
    other = replace(hist, counts=turned(np.array(hist.counts)))
    legs = lf.find_legs(lf.find_arrivals(other, timing=lab.timing), camera=lab.camera)
    (finding,) = implausible(lab.camera, lab.timed, lf.Medium(), legs)
    assert finding.name == "orientation"
    assert words in finding.sentence
