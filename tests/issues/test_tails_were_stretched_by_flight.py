"""In a large room light takes longer through a pixel than its pulse lasts, and tails grew with it.

Pulses with a calibrated tail were fitted as wider ones of the same shape, and times came out wrong
by the tail's part of that: places up to seven stated errors off, with "trust". With one tip in view
no pixel was examined. Of Gaussian pulses the width without flight was taken from medians of all
legs, and a leg that was less steep than another was wider than its pulses by half: contradicted.
Pulses that a tip cuts came "when no leg of the path is there".
"""

import pytest

from benchmarks.random_labs import FAR_STDS, drawn_lab, path_of, pulls_of

WORSE_SINCE = pytest.mark.xfail(reason="trusted; mean square pull 2.65 of 2.0 since an older day")


@pytest.mark.parametrize(
    ("seed", "method", "noise"),
    [
        pytest.param(65, "joint", 0, id="wrong and trusted", marks=pytest.mark.long),
        pytest.param(94, "joint", 0, id="tailed, 40 mm a pixel", marks=pytest.mark.long),
        pytest.param(94, "photon", 0, id="tailed, all counts", marks=pytest.mark.long),
        pytest.param(
            113, "joint", 0, id="tailed, whole pixels", marks=[pytest.mark.long, WORSE_SINCE]
        ),
        pytest.param(
            113, "photon", 0, id="tailed, whole, all counts", marks=[pytest.mark.long, WORSE_SINCE]
        ),
        pytest.param(48, "joint", 0, id="ends in view", marks=pytest.mark.long),
        pytest.param(227, "joint", 1, id="beside pixels that are not asked"),
        pytest.param(349, "joint", 0, id="pulses that a tip cuts"),
        pytest.param(52, "joint", 1, id="one leg steeper than the other"),
        pytest.param(67, "joint", 0, id="edges of whole pixels", marks=pytest.mark.long),
    ],
)
def test_a_large_room_is_trusted_and_right(seed, method, noise):
    lab = drawn_lab(seed)
    path = path_of(lab, method, noise)
    pulls = pulls_of(lab, path)
    assert path.n_legs == len(lab.vertices) - 1
    assert path.verdict.level == "trust"
    # Two to six places that err together: of chance by half of this.
    assert (pulls[:, 1] < FAR_STDS).all()
    assert pulls[:, 0].mean() < 2.0
