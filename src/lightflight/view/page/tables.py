"""The page's words and tables as static HTML: they can be read without scripts.

Takes the page's payload, gives text in which everything that came from outside is escaped.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from lightflight.display import count, number, with_error
from lightflight.path.trace import unseen_legs_of
from lightflight.path.tree import starts_of, ways
from lightflight.view.page.origin import origin_html
from lightflight.view.types import Json

if TYPE_CHECKING:
    from lightflight import LightPath

_SIGNS = {"trust": "\u2713", "check": "?", "contradicted": "\u2715"}
"""Beside the word of a verdict's level: not by colour alone."""


def heading(path: LightPath) -> str:
    """A title for a path that was given none."""
    n_legs = max(len(np.atleast_1d(path.vertex_times_ps)) - 1, 0)
    unseen, branches = len(unseen_legs_of(path)), len(ways(starts_of(path)))
    if not unseen:
        forked = f" on {branches} branches" if branches > 1 else ""
        return f"{count(n_legs, 'leg').capitalize()} of light{forked} in space and time"
    hidden = f"{count(unseen, 'way')} that nobody saw"
    return f"{count(n_legs - unseen, 'leg').capitalize()} of light and {hidden}"


def lead(payload: Json) -> str:
    """One line: size, how it was found, how well."""
    words, path = payload["words"], payload["path"]
    parts = []
    times = path["vertex_times_ps"]
    lengths = [leg["length_mm"] for leg in path["legs"]]
    if lengths and None not in lengths and None not in times:
        parts.append(f"{sum(lengths):.0f} mm in {(max(times) - times[0]) / 1000:.2f} ns")
    if words["method"]:
        parts.append(f"{words['method']} estimate")
    if words["prior"]:
        parts.append(words["prior"])
    if words["fit"]:
        parts.append(words["fit"])
    truth = payload["truth"]
    if truth and truth["position_rms_mm"] is not None:
        position = number(truth["position_rms_mm"], 2)
        time = number(truth["time_rms_ps"] or float("nan"), 2)
        parts.append(f"off the truth by {position} mm and {time} ps rms in view")
    return " \u00b7 ".join(parts)


def badge_html(level: str) -> str:
    """The level of a verdict as a word with a sign, on its colour."""
    return (
        f'<strong class="badge {level}"><span aria-hidden="true">{_SIGNS[level]}</span> '
        f"{level}</strong>"
    )


def verdict_html(payload: Json) -> str:
    """The verdict: its badge, the findings with what to do, and what it cannot see."""
    verdict = payload["verdict"]
    # The badge says the level; what it means stands behind it.
    meaning = verdict["headline"].partition(": ")[2]
    parts = [f"<p>{badge_html(verdict['level'])} {html.escape(meaning)}</p>"]
    if verdict["explained"]:
        parts.append(f"<p>The path explains {html.escape(verdict['explained'])}.</p>")
    if verdict["findings"]:
        first, *others = (_finding_html(finding) for finding in verdict["findings"])
        parts.append(f'<ul class="findings" aria-label="What speaks against it">{first}</ul>')
        if others:
            title = f"What else speaks against it, the likeliest first ({len(others)})"
            items = "".join(others)
            parts.append(f'<details><summary>{title}</summary><ol start="2">{items}</ol></details>')
    for title, said in (
        ("Other paths that explain the recording", verdict.get("alternatives", ())),
        ("What would go unseen here, and what it moves", verdict["blind_to"]),
        ("What was taken as exact, and what that costs", verdict["exact"]),
    ):
        if said:
            parts.append(f"<details><summary>{title}</summary>{_list(said)}</details>")
    return "\n".join(parts)


def _finding_html(finding: Json) -> str:
    """One finding: its name, what was seen and how clearly, and the cure."""
    clearly = f" ({finding['sigma']:.2g} \u03c3)" if finding["sigma"] else ""
    return (
        f"<li><code>{html.escape(finding['name'])}</code> {html.escape(finding['sentence'])}"
        f"{clearly}. <em>To do:</em> {html.escape(finding['remedy'])}.</li>"
    )


def _table(caption: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f'<th scope="col">{html.escape(text)}</th>' for text in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f'<div><div class="table-scroll" role="region" tabindex="0" '
        f'aria-label="{html.escape(caption, quote=True)}"><table>'
        f"<caption>{html.escape(caption)}</caption>"
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div></div>"
    )


def tables_html(payload: Json) -> str:
    """Vertices and legs with their errors, and the truth beside them where it is known."""
    path = payload["path"]
    if not path["legs"]:
        return "<p>The path has no legs.</p>"
    parts = [_vertex_table(path)]
    rows: list[tuple[str, ...]] = [
        (
            str(k + 1),
            number(leg["length_mm"], 6),
            with_error(leg["angle_deg"], leg["angle_std_deg"]),
            number(leg["paper_angle_deg"], 5),
        )
        if leg["seen"]
        else (str(k + 1), "open", "unseen", "")
        for k, leg in enumerate(path["legs"])
    ]
    header: tuple[str, ...] = (
        "leg",
        "length (mm)",
        "elevation \u03b1 (\u00b0)",
        "\u03b1 of the paper (\u00b0)",
    )
    if len(path["ways"]) > 1:
        # In a chain each leg begins where the leg before ends.
        header = (*header, "from vertex", "to vertex")
        rows = [
            (*row, str(start), str(k + 1))
            for k, (row, start) in enumerate(zip(rows, path["leg_starts"], strict=True))
        ]
    parts.append(_table("Legs", header, rows))
    if payload["truth"]:
        truth = payload["truth"]
        rows = [
            (str(k), *(number(x, 6) for x in vertex), number(time, 8))
            for k, (vertex, time) in enumerate(
                zip(truth["vertices_mm"], truth["vertex_times_ps"], strict=True)
            )
        ]
        header = ("vertex", "x (mm)", "y (mm)", "z (mm)", "event time (ps)")
        parts.append(_table("Truth", header, rows))
    return '<div class="tables">' + "\n".join(parts) + "</div>"


def _vertex_table(path: Json) -> str:
    n = len(path["vertices_mm"])
    first = "source" if path["source_known"] else "entry"
    open_ends = {k + end for k, leg in enumerate(path["legs"]) if not leg["seen"] for end in (0, 1)}
    exits = {way[-1] + 1 for way in path["ways"]}
    forks = {start for start in path["leg_starts"] if path["leg_starts"].count(start) > 1}
    rows = []
    for k in range(n):
        name = first if k == 0 else "exit" if k in exits else f"corner {k}"
        name = f"splitter {k}" if k in forks else name
        name = f"mirror {k}, open" if k in open_ends else name
        values = (*path["vertices_mm"][k], path["vertex_times_ps"][k])
        errors = path["vertex_std"][k]
        rows.append(
            (f"{k}  {name}", *(with_error(v, e) for v, e in zip(values, errors, strict=True)))
        )
    header = ("vertex", "x (mm)", "y (mm)", "z (mm)", "event time (ps)")
    return _table("Vertices, with one standard deviation", header, rows)


def statements_html(payload: Json) -> str:
    """What the data fix, what the result rests on, and what is missing, in sentences."""
    words, clock = payload["words"], payload["clock"]
    said = list(words["statements"])
    if words["prior"]:
        said.insert(0, f"Taken as known: {words['prior']}.")
    parts = [_list(said) if said else "<p>The path carries no statements.</p>"]
    if clock and clock["notes"]:
        parts.append("<h3>The clock</h3>" + _list(clock["notes"]))
    if payload["missing"]:
        parts.append("<h3>Not here</h3>" + _list(payload["missing"]))
    return "\n".join(parts)


def _list(sentences: Sequence[object]) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(str(text))}</li>" for text in sentences) + "</ul>"


def provenance_html(payload: Json) -> str:
    """Inputs, settings, versions and seed that made the path."""
    provenance = payload["words"]["provenance"]
    if not provenance:
        return "<p>The path does not say how it was made.</p>"
    return origin_html(provenance)
