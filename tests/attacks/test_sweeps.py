"""Every key of a set-up and every field of a calibration with what nobody means, one by one.

Quick: a sample; at length all of them.
"""

from __future__ import annotations

import datetime
import time
import warnings
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.cli.errors import sentence_and_code
from lightflight.lab import lab_from_table
from lightflight.lab.keys import SECTIONS
from lightflight.lab.lab import reconstruct_options
from lightflight.lab.scene import scene_from_lab
from lightflight.lab.write import table_from_lab
from tests.attacks.length import at_length
from tests.labs import three_legs

WHOLE: dict[str, dict[str, Any]] = {
    "camera": {"shape": [4, 4], "distance_mm": 535.0, "field_of_view_mm": [245.0, 245.0]},
    "source": {"position_mm": [0.0, 0.0, 0.0]},
    "scene": {"vertices_mm": [[-50.0, 0.0, 0.0], [50.0, 0.0, 0.0]]},
    "detector": {"n_codes": 64, "bin_width_ps": 55.0},
}
NAN, INF = float("nan"), float("inf")
VALUES: tuple[Any, ...] = (
    True, 0, -1, 10**30, -(10**18), 2**63, 1.5, NAN, INF, -INF, 1e308, -1e308, 1e-320, "", "none",
    "\0", "../../x", "x" * 10**6, [], [[]], [1], [1, 2], [1, 2, 3, 4, 5], [NAN] * 2, [INF] * 3,
    [-1, -1], [0, 0, 0], [2**40] * 2, ["a", "b"], [[1, 2], [3, 4]], [[1.0, 2, 3]] * 3,
    [[NAN] * 3] * 2, [[1e308] * 3, [-1e308] * 3], [[0.0] * 4] * 4, [[1.0, 2, 3]] * 100_000, {},
    {"a": 1}, datetime.date(2020, 1, 1), datetime.time(1, 2),
)  # fmt: skip
"""Of any kind, size and shape."""


def _keys() -> Iterator[tuple[str, str]]:
    for section, keys in SECTIONS.items():
        for name in ("a",) if keys is None else (key.name for key in keys):
            yield section, name


@pytest.mark.parametrize(("section", "name"), list(_keys()))
def test_a_key_with_a_wrong_value_is_one_sentence(section, name):
    said = []
    for value in VALUES[:: at_length(3, 1)]:
        table = {key: dict(values) for key, values in WHOLE.items()}
        table.setdefault(section, {})[name] = value
        start = time.process_time()
        try:
            lab = lab_from_table(table, where="lab.toml")
            reconstruct_options(lab)
            table_from_lab(lab)
            assert len(repr(lab).splitlines()) <= 15
            scene_from_lab(lab)
        except ValueError as error:
            said.append(sentence_and_code(error))
        assert time.process_time() - start < 5.0
    assert {code for _, code in said} <= {2, 3}, said
    assert max((len(text) for text, _ in said), default=0) < 1000


@cache
def _lab():
    return three_legs()


def _spoilt(value: Any) -> list[Any]:
    """Others in the place of a value of a calibration."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        found = []
        for wrong in (NAN, INF, 0.0, -1.0, 1e300, 1e-300, 1e12):
            one = value.copy()
            one.reshape(-1)[value.size // 2 : value.size // 2 + 1] = wrong  # on the first leg
            found += [np.full_like(value, wrong), one]
        return [*found, value[:0], value.ravel(), value.astype(complex), value.astype(object)]
    if isinstance(value, np.ndarray):
        return [np.full_like(value, np.iinfo(value.dtype).max), np.zeros_like(value), value[:0]]
    if isinstance(value, tuple):
        return [None, "x", ("x",) * 100_000]
    return [None, NAN, INF, 0, -1, 1e300, 10**30, "x", [1]]


_SLOW = (
    "response_curve", "end_widths", "flat_modes_ps", "response_place_ps", "first_live_width",
    "response_std_ps", "phase_std", "anchor_delay_ps",
)  # fmt: skip


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(field.name, marks=pytest.mark.long if field.name in _SLOW else ())
        for field in fields(lf.TimingCalibration)
    ],
)
def test_a_calibration_with_a_wrong_field_is_used_or_refused(name, tmp_path):
    """Its digest is sound: another program, or an experiment, has written it so."""
    said, lab = [], _lab()
    recording = lab.recording(0, 4000.0)
    for value in _spoilt(getattr(lab.timing, name))[:: at_length(9, 1)]:
        try:
            replace(lab.timing, **{name: value}).save(tmp_path / "clock.h5")
            timing = lf.TimingCalibration.load(tmp_path / "clock.h5")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                path = lf.reconstruct(recording, camera=lab.camera, source=lab.timed, timing=timing)
            assert np.isfinite(path.vertices_mm).all()
        except (ValueError, TypeError, RuntimeError) as error:
            said.append(sentence_and_code(error))
    assert {code for _, code in said} <= {2, 3, 4, 5}, said
