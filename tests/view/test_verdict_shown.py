"""The verdict on the page, in figures and in a campaign's index: by words, not colour alone."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lightflight.path.tables import Explained
from lightflight.path.verdict import Finding, FindingName, Level, Severity, Verdict
from lightflight.view import style
from lightflight.view.figures.campaign import campaign_figure
from lightflight.view.figures.demo import demo_figure
from lightflight.view.page.campaign import campaign_html
from lightflight.view.page.payload import payload_from_records
from lightflight.view.page.tables import badge_html, heading, verdict_html
from tests.path.test_verdict import WORST
from tests.path_fakes import make_path
from tests.view import fakes
from tools.make_schema_files import known_path_with_an_alternative


def path_of(verdict: Verdict, **fields: Any) -> Any:
    return replace(fakes.fake_path(), verdict=verdict, **fields)


def words_of(figure: Any) -> list[str]:
    return [text.get_text() for text in (*figure.texts, *figure.artists) if text.get_text()]


def test_the_page_says_it_before_all_drawings() -> None:
    from lightflight.view.page.build import page_html

    explained = Explained(79, 222, 40.0, 100.0)
    text = page_html(path_of(WORST, explained=explained, prices=("source exact: dear",)))
    verdict = text.index('<section class="verdict card contradicted"')
    assert text.index("<h1>") < verdict < text.index('<section class="clocks')
    section = text[verdict : text.index("</section>", verdict)]
    said = " ".join(re.sub(r"<[^>]+>", " ", section).split())
    assert "✕ contradicted the recording contradicts this path" in said
    assert said.index("index off by 0.01 (12 σ)") < said.index("pose off by 2 mm (11 σ)")
    assert "To do: state it." in said
    assert "79 of 222 pulses, 40 % of their photons" in said
    assert "clock_scale up to 0.0001 of itself, which moves a vertex by 0.7 mm" in said
    assert "source exact: dear" in said
    payload = json.loads(re.search(r'application/json">(.*?)</script>', text, re.S)[1])  # type: ignore[index]
    assert payload["verdict"]["level"] == "contradicted"
    assert [one["name"] for one in payload["verdict"]["findings"]] == ["index", "pose"]


def test_the_page_tells_other_answers_and_only_where_there_are_some() -> None:
    path = known_path_with_an_alternative()
    title = "Other paths that explain the recording"
    text = verdict_html(payload_from_records(path))
    said = f"<summary>{title}</summary>"
    assert "leg 1 turned in depth (3 times less likely)" in text[text.index(said) :]
    alone = payload_from_records(replace(path, alternatives=()))
    assert "alternatives" not in alone["verdict"]
    assert title not in verdict_html(alone)


def test_what_a_finding_says_stays_text() -> None:
    hostile = "<img src=x onerror=alert(1)>"
    finding = Finding(FindingName.INDEX, hostile, float("nan"), hostile, Severity.CHECK)
    text = verdict_html(payload_from_records(path_of(Verdict(Level.CHECK, (finding,)))))
    assert "<img" not in text
    assert text.count("&lt;img") == 2


@pytest.mark.parametrize("level", Level)
def test_a_badge_is_a_word_and_can_be_read(level: Level) -> None:
    assert f"</span> {level}</strong>" in badge_html(level)
    ground, ink = style.VERDICT[level]
    # WCAG 2: 4.5 for text of any size.
    light, dark = sorted((luminance(ground), luminance(ink)), reverse=True)
    assert (light + 0.05) / (dark + 0.05) > 4.5


def luminance(color: str) -> float:
    """Relative luminance of a colour, by the definition of WCAG 2."""
    channels = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("level", Level)
def test_a_figure_says_it_before_its_headline(level: Level) -> None:
    verdict = replace(WORST, level=level, findings=() if level == "trust" else WORST.findings)
    figure = demo_figure(path_of(verdict, explained=Explained(79, 222, 40.0, 100.0)))
    figure.canvas.draw()
    badge = next(text for text in figure.texts if text.get_text() == level)
    (headline,) = figure.artists
    assert "Three legs" in words_of(figure)[-1]
    box, beside = (one.get_window_extent() for one in (badge, headline))
    assert box.x1 < beside.x0
    why = next(text for text in words_of(figure) if text.startswith("explains 79 of 222 pulses"))
    assert ("index off by 0.01 (12 σ), and 1 more" in why) == (level != "trust")


def test_no_line_of_a_figure_runs_into_the_table() -> None:
    long = replace(WORST.findings[0], sentence="every word of this is too long for a line " * 5)
    good = replace(fakes.fake_path().goodness, error_floor_ps=12.3)
    path = path_of(
        replace(WORST, findings=(long, long)), explained=Explained(79, 222, 4.0, 9.0), goodness=good
    )
    figure = demo_figure(path)
    figure.canvas.draw()
    table = next(text for text in figure.texts if text.get_text() == "rms error in view")
    for text in figure.texts:
        if "explains" in text.get_text() or "extra scatter" in text.get_text():
            assert text.get_window_extent().x1 < table.get_window_extent().x0


@pytest.mark.parametrize("n_legs", [1, 2, 4, 5, 6])
def test_figure_and_page_count_legs_in_the_same_words(n_legs: int) -> None:
    vertices = [(60 * k, 30 * (k % 2), 5 * (k % 3)) for k in range(n_legs + 1)]
    path = make_path(vertices)
    assert heading(path) in words_of(demo_figure(path))


def test_a_campaigns_index_counts_and_marks_levels() -> None:
    trusted, worst = path_of(Verdict(Level.TRUST)), path_of(WORST)
    text = campaign_html([("a.h5", trusted, "a"), ("b.h5", worst, "b"), ("c.h5", worst, "c")])
    plain = re.sub(r"<[^>]+>", "", text.partition("<body>")[2])
    assert "1 ✓ trust, 2 ✕ contradicted. All pictures to one scale." in plain
    assert "b.h5 ✕ contradicted" in plain
    assert "index, pose" in plain
    assert "check" not in plain


def test_a_campaigns_figure_counts_levels() -> None:
    figure = campaign_figure([], title="Ten", verdicts={"trust": 9, "check": 1, "contradicted": 0})
    assert figure.get_suptitle() == "Ten: 9 trust, 1 check"
    assert campaign_figure([], title="Ten").get_suptitle() == "Ten"
