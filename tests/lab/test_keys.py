"""The keys of a set-up file, and the records they are read from."""

import dataclasses

import pytest

from lightflight.flight import Medium, Source
from lightflight.lab import (
    DETECTOR_KEYS,
    MEDIUM_KEYS,
    RECONSTRUCT_KEYS,
    SECTIONS,
    SOURCE_KEYS,
    WINDOW_KEYS,
    field_meanings,
)
from lightflight.reconstruct.estimators import METHODS
from lightflight.simulate.detector import Detector


def test_sections_mirror_the_records_they_build():
    names = {section: {key.name for key in keys or ()} for section, keys in SECTIONS.items()}
    assert names["source"] == {item.name for item in dataclasses.fields(Source)}
    by_name = {"material", "wavelength_nm"}
    assert (
        names["medium"] == {item.name for item in dataclasses.fields(Medium)} - {"blocks"} | by_name
    )
    assert names["detector"] == {item.name for item in dataclasses.fields(Detector)} | {"preset"}


@pytest.mark.parametrize(
    "key", [*SOURCE_KEYS, *WINDOW_KEYS, *MEDIUM_KEYS, *DETECTOR_KEYS], ids=lambda k: k.name
)
def test_every_key_has_a_meaning(key):
    assert len(key.meaning) > 5


def test_meanings_come_from_the_field_docstrings():
    assert field_meanings(Detector)["gain_rms"].startswith("Relative spread")


def test_every_estimator_may_be_named_and_nothing_else():
    check = next(key.check for key in RECONSTRUCT_KEYS if key.name == "method")
    assert [check(method) for method in METHODS] == list(METHODS)
    with pytest.raises(ValueError, match="must be one of 'joint', 'paper', 'photon'"):
        check("fast")
