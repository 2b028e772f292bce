"""A larger `n_legs` than the picture shows came back as fewer legs, without a word."""

import pytest

import lightflight as lf
from lightflight.errors import NothingFoundError
from tests.labs import one_leg


@pytest.mark.usefixtures("unexamined")
@pytest.mark.parametrize("n_legs", [pytest.param(2, marks=pytest.mark.long), 3])
def test_more_than_show_is_kept_or_refused(n_legs):
    lab = one_leg()
    hist = lab.recording(3, 4000.0)
    try:
        found = lf.reconstruct(
            hist, camera=lab.camera, source=lab.known, timing=lab.timing, n_legs=n_legs
        ).n_legs
    except NothingFoundError as refused:
        found = n_legs if f"n_legs={n_legs}" in str(refused) else 0
    assert found == n_legs
