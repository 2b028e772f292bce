"""Told where the first mirror of a roof stands, a recording took three times as long.

Without the way that nobody saw, times scattered about the path by more than pulses are wide, and
halos and mirrors were looked for about it, eight times over: light that is not where it is expected
tells nothing of what else there is.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from lightflight.reconstruct.fit.joint import pulse_std_ps
from lightflight.reconstruct.other_light import diffuse
from tests.labs import corner_in_view, fit_from_truth


@pytest.mark.parametrize(("share", "asked"), [(0.1, True), (1.0, False)])
def test_light_that_scatters_by_its_width_is_not_asked(share, asked, monkeypatch):
    lab = corner_in_view()
    fit, sighting, setting = fit_from_truth(lab, lab.recording(1, 20_000.0))
    times = []
    told = diffuse.without_diffuse

    def counted(*arguments, **options):
        times.append(1)
        return told(*arguments, **options)

    monkeypatch.setattr(diffuse, "without_diffuse", counted)
    floor_ps = share * pulse_std_ps([sighting])
    monkeypatch.setattr(diffuse, "with_fine_light", lambda one, _: replace(one, floor_ps=floor_ps))
    found = diffuse.with_diffuse(fit, setting, nominal=False)
    assert bool(times) == asked
    assert bool(found.strengths) == asked
