"""Crosstalk did not stand in the frame of its cause: raw frames lost their coincidences."""

import numpy as np
import pytest

from lightflight.simulate import pf32, simulate
from tests.simulate.fakes import QUIET, photons_of_events, small_scene


@pytest.mark.parametrize("kind", ["frames", "events"])
def test_crosstalk_stands_in_the_frame_of_its_cause(kind):
    """6,600 dark counts in one pixel, 330 echoes beside it; the light gives some photons more."""
    hot = np.zeros((8, 8))
    hot[3, 3] = 8000.0
    detector = pf32(**QUIET, crosstalk_probability=0.05, gain_rms=0.0, phase_rms=0.0)
    skew = detector.pixels((8, 8)).skew_ps
    scene = small_scene(detector, background=hot)
    raw = simulate(scene, kind=kind, seed=2, photons_per_pixel=0.1, n_frames=20_000)
    if kind == "frames":
        frame, row, col = np.nonzero(raw.frames)
        code = raw.frames[frame, row, col].astype(int)
    else:
        frame, row, col = photons_of_events(raw)
        code = np.asarray(raw.code, dtype=int)
    is_hot = (row == 3) & (col == 3)
    cause = dict(zip(frame[is_hot], code[is_hot], strict=True))
    beside = (np.abs(row - 3) + np.abs(col - 3) == 1) & np.isin(frame, frame[is_hot])
    wanted = 0.05 * len(cause)
    assert beside.sum() == pytest.approx(wanted, abs=6 * np.sqrt(wanted))
    assert (np.abs(row - 3) + np.abs(col - 3) == 1).sum() - beside.sum() < 10
    # One moment, read by two clocks that differ in delay alone; later is a smaller code. Codes are
    # 8 % wider or narrower, the first one 76 %.
    later = skew[row[beside], col[beside]] - skew[3, 3]
    step = np.array([cause[f] for f in frame[beside]]) - code[beside]
    within = np.abs(step) < 400  # the others lie on two sides of the period's end
    assert within.mean() > 0.97
    np.testing.assert_allclose(step[within], later[within] / 55.06, atol=2.0)
