"""Where a flight ends it lights the room, and lines across that light were told as legs.

A wall behind the flight lights up in rings, in every pixel of the picture: a tenth of the light as
much as all of it. Of six laboratories five had three or four legs for one or two, contradicted
after up to 129 s of CPU (`benchmarks/misfit_labs.py --only flash`). A flight is at one place at a
time, and a leg lights few of the pixels about it: what fills them, and comes from many at once, is
none of it.
"""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from benchmarks.misfit_labs import recording_of
from lightflight.errors import LightflightWarning, NothingFoundError
from lightflight.reconstruct.legs.ghosts import on_surfaces
from tests.reconstruct.fakes import arrivals_from_columns

STD_PS = 70.0
PX_PS = 30.0
"""Light's time across a pixel."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("share", "seed"),
    [
        (0.1, 966),
        (0.1, 965),
        (1.0, 1066),
        (1.0, 1071),
    ],
)
def test_a_lit_room_makes_no_legs(share, seed):
    """Its light is no form that has a place in the fit: it is named as such."""
    lab, hist, told = recording_of("flash", share, seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        path = lf.reconstruct(hist, **told)
    assert path.n_legs == len(lab.vertices) - 1
    assert path.verdict.level == "contradicted"
    assert "unexplained_light" in {one.name for one in path.verdict.findings}


def leg(begin: tuple[float, float], end: tuple[float, float], start_ps: float, px_ps: float):
    """Places (n, 2) and times (n,) of the pixels along a leg."""
    run = np.linspace(0.0, 1.0, 1 + int(np.hypot(*np.subtract(end, begin))))
    places = np.array(begin) + run[:, np.newaxis] * np.subtract(end, begin)
    return np.rint(places), start_ps + px_ps * run * np.hypot(*np.subtract(end, begin))


def wall(size: int, begin: tuple[float, float], behind_px: float, start_ps: float):
    """The same of a wall that light reaches from a point before it."""
    places = np.stack(np.meshgrid(range(size), range(size)), axis=-1).reshape(-1, 2).astype(float)
    way = np.hypot(behind_px, np.linalg.norm(places - begin, axis=1))
    return places, start_ps + PX_PS * (way + behind_px)


def seen_as(
    places: np.ndarray, times: np.ndarray, photons: np.ndarray, shape: tuple[int, int] = (32, 32)
) -> np.ndarray:
    row, col = places.astype(np.int32).T
    return on_surfaces(row, col, shape, times, photons, STD_PS)


def test_what_lights_up_all_about_is_no_flight_and_what_flew_before_is():
    """A wall 8 px behind the end; half the photons of the leg in its nearest pixels."""
    flown, lit = leg((2.0, 3.0), (14.0, 18.0), 0.0, 20.0), wall(32, (14.0, 18.0), 8.0, 385.0)
    places, times = (np.concatenate(pair) for pair in zip(flown, lit, strict=True))
    far = np.hypot(8.0, np.linalg.norm(lit[0] - [14.0, 18.0], axis=1))
    photons = np.concatenate((np.full(len(flown[0]), 1000.0), 500.0 * (8.0 / far) ** 2))
    ghost = seen_as(places, times, photons)
    own = np.arange(len(places)) < len(flown[0])
    assert not ghost[own].any()
    assert np.count_nonzero(~ghost[~own]) < 0.02 * len(far)


@pytest.mark.parametrize(
    "parts",
    [
        [leg((2.0, 2.0), (28.0, 25.0), 0.0, 0.5)],
        [leg((2.0, 2.0), (28.0, 25.0), 0.0, 20.0), leg((8.0, 2.0), (30.0, 20.0), 40.0, 20.0)],
        [leg((2.0, 2.0), (2.0, 28.0), 0.0, 9.0), leg((29.0, 2.0), (26.0, 28.0), 0.0, 9.0)],
    ],
    ids=["a leg that comes all at once", "beside its image", "two swift arms"],
)
def test_lines_are_flights_however_many_pixels_light_up_at_once(parts):
    places, times = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    assert not seen_as(places, times, np.full(len(times), 300.0)).any()


def test_a_cavity_that_fills_the_picture_is_a_flight():
    """Passes a pixel apart, 900 ps each."""
    passes = [leg((2.0, 2.0 + k), (29.0, 2.0 + k), 900.0 * k, 20.0) for k in range(28)]
    places, times = (np.concatenate(pair) for pair in zip(*passes, strict=True))
    assert not seen_as(places, times, np.full(len(times), 300.0)).any()


def test_one_row_of_pixels_shows_no_wall():
    places, times = leg((0.0, 0.0), (0.0, 63.0), 0.0, 1.0)
    assert not seen_as(places, times, np.full(len(times), 300.0), (1, 64)).any()


def test_where_only_a_wall_shows_the_sentence_says_so():
    places, times = wall(32, (14.0, 18.0), 8.0, 2_000.0)
    each = np.ones(len(times))
    row, col = places.T
    seen = arrivals_from_columns(row, col, times, 5.0 * each, 300.0 * each, (32, 32))
    seen = replace(seen, std_ps=STD_PS * each)
    with pytest.raises(NothingFoundError, match=r"\d+ took no part: they come from all about"):
        lf.find_legs(seen)
