"""A tail shorter than the pulse, in no flat, was called a second pulse and the path contradicted.

Six of 54 laboratories of `benchmarks/random_labs.py` (1151 to 1204), without any calibration,
have tails of 61 to 110 ps. The fit took them up to a percent of the light, and the counts held
against the path with them agree; but what is named first where nothing is taken up was an echo, 180
to 230 ps late, and echoes have no place among diffuse light.
"""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from benchmarks.random_labs import camera_of, drawn_lab, expected_counts, histograms, source_of
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.reconstruct.verdict import taken_up


@pytest.mark.parametrize("left", [Level.TRUST, Level.CONTRADICTED])
def test_counts_decide_whatever_the_light_was_called(monkeypatch, left):
    """Called an echo, taken up as a tail: counts with it agree, or the path stays contradicted."""
    echo, tail = (
        Finding(name, "some", 9.0, "", Severity.CONTRADICTED)
        for name in (FindingName.OTHER_PULSE, FindingName.SHAPE)
    )
    monkeypatch.setattr(taken_up, "_plausible", lambda _: True)
    monkeypatch.setattr(taken_up, "evidence_from_counts", lambda *_, **__: ())
    monkeypatch.setattr(taken_up, "verdict_from_evidence", lambda *_: Verdict(left, ()))
    monkeypatch.setattr(taken_up, "_as_fitted", lambda *_: (tail,))
    plain, fit = Verdict(Level.CONTRADICTED, (echo,)), None
    told: Any = taken_up.verdict_with_light_taken_up(plain, (), (), fit, [], nominal=False)
    if left is Level.TRUST:
        assert told.level is Level.CHECK
        assert [one.sentence for one in told.findings] == ["some: taken into the fit"]
    else:
        assert told is plain


@pytest.mark.long
@pytest.mark.parametrize("seed", [1158, 1202])
def test_it_is_a_tail_that_the_fit_has_taken_up(seed):
    """Three legs each; tails of 61 and 66 ps, half of the light, pulses of 95 and 99 ps."""
    lab = drawn_lab(seed)
    lab = replace(lab, widths=np.ones_like(lab.widths), delays_ps=np.zeros_like(lab.delays_ps))
    drawn = np.random.default_rng([8, seed, 0]).poisson(expected_counts(lab))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = lf.reconstruct(
            histograms(lab, drawn), camera=camera_of(lab), source=source_of(lab, 0)
        )
    assert path.n_legs == len(lab.vertices) - 1
    assert path.verdict.level == "check"
    assert path.verdict.findings[0].name == "shape"
    assert "taken into the fit" in path.verdict.findings[0].sentence
