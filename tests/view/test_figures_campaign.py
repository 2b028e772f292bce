"""view.figures_campaign: what is drawn of groups of repeats."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from lightflight.batch.table import Repeats
from lightflight.view import campaign_figure, draw_repeat_pulls, draw_set_point_errors
from lightflight.view.figures.campaign import draw_set_points


@pytest.fixture
def groups(rng):
    return tuple(
        Repeats(f"{a:g} deg", a, a + rng.normal(0, 0.1, n), np.full(n, 0.2), np.full(n, 0.1))
        for a, n in ((-5.0, 4), (0.0, 1), (2.5, 0), (5.0, 3))
    )


def texts(figure) -> str:
    figure.canvas.draw()
    return " ".join(t.get_text() for ax in figure.axes for t in ax.findobj(match=is_text))


def is_text(artist) -> bool:
    return hasattr(artist, "get_text") and artist.get_visible()


def test_means_stand_at_their_set_points(groups):
    ax = draw_set_points(groups)
    bars: Any = ax.containers[0]
    x, y = bars.lines[0].get_data()
    np.testing.assert_array_equal(x, [-5.0, 0.0, 2.5, 5.0])
    np.testing.assert_allclose(y[[0, 1, 3]], [groups[k].mean_deg for k in (0, 1, 3)])
    assert np.isnan(y[2])


def test_every_repeat_is_drawn_beside_its_set_point_without_overlap(groups):
    ax = draw_set_point_errors(groups)
    containers: Any = ax.containers[1::2]  # thin, thick, thin ...
    places = [bars.lines[0].get_xdata() for bars in containers]
    drawn = np.concatenate(places)
    assert len(drawn) == len(np.unique(drawn)) == 8
    assert np.abs(places[0] + 5.0).max() < 1.25  # half the least distance of set-points


def test_pulls_are_counted_where_there_are_repeats(groups):
    ax = draw_repeat_pulls((*groups, groups[0]))
    bars = [bar for bar in ax.patches if isinstance(bar, Rectangle)]
    assert sum(bar.get_height() for bar in bars) == 11
    assert "n = 11" in texts(ax.figure)
    assert "line: unit normal" in texts(ax.figure)


def test_few_pulls_are_dots_and_no_histogram(groups):
    ax = draw_repeat_pulls(groups)
    assert not [bar for bar in ax.patches if isinstance(bar, Rectangle)]
    dots = np.asarray(ax.lines[0].get_xdata(), dtype=float)
    expected = np.concatenate([group.pulls for group in groups])
    np.testing.assert_allclose(dots, np.sort(expected))
    assert not ax.get_ylabel()
    assert ax.get_yticks().size == 0


def test_groups_without_set_points_are_named():
    values = np.array([1.0, 2.0])
    groups = [Repeats(name, None, values, values, values) for name in ("wall", "fog")]
    text = texts(campaign_figure(groups, title="Two rooms"))
    assert "wall" in text
    assert "mean (deg)" in text


def test_a_campaign_without_a_path_says_so():
    nothing = np.empty(0)
    figure = campaign_figure([Repeats("a", 1.0, nothing, nothing, nothing)])
    assert "no recording gave a path" in texts(figure)
    assert "no group has two repeats" in texts(figure)
    assert campaign_figure([])
