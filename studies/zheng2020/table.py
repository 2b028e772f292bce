"""Every number of the paper beside ours: by estimator, with the bound, the factor and the prior.

The paper's numbers were measured in its laboratory, ours on the twin: its coordinates, photon
numbers, lens blur and the defects of its very camera are not published.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lightflight.demo import EVENT_TIME_RMS_PS, POSITION_RMS_MM
from studies.zheng2020 import reported
from studies.zheng2020.contributions import Contributions
from studies.zheng2020.discussion import Discussion
from studies.zheng2020.fig5a import Fig5a
from studies.zheng2020.fig5c import Fig5c
from studies.zheng2020.fig6 import Fig6, Way

WHY = (
    "The lines are wrong by 0.1 px from end to end: pixels of 6 µm on a pitch of 50 µm see a spot "
    "of 0.35 px too coarsely for a centre of mass, and a wider spot mixes the light of "
    "neighbouring legs, 1.1 px apart at the picture's edge. Corners lie outside the picture and "
    "legs meet there at 8°: 0.1 px moves a corner by 4 mm. The paper's blur and mirrors are not "
    "published."
)
"""Why the paper's chain is where it is; `note_from_records` gives the measurements behind it."""


@dataclass(frozen=True)
class Row:
    """One number of the paper, and ours."""

    quantity: str
    """What it is."""
    unit: str
    """Its unit."""
    where: str
    """Where the paper says it."""
    reported: float | None
    """The paper's number; None where it hopes for something without a number."""
    paper: float | None
    """By the paper's chain on the twin."""
    joint: float | None
    """By `joint`."""
    photon: float | None
    """By `photon`."""
    bound: float | None
    """Cramér-Rao bound of a perfect clock."""
    prior: str
    """What was taken as known, and which clock."""
    short: str = ""
    """What the README calls it; empty: the README leaves it out."""

    @property
    def factor(self) -> float | None:
        """The paper's number over the better of ours."""
        ours = [v for v in (self.joint, self.photon) if v is not None and v > 0]
        return None if self.reported is None or not ours else self.reported / min(ours)


def rows_from_records(records: Mapping[str, Any]) -> tuple[Row, ...]:
    """Rows of whatever is there.

    Parameters
    ----------
    records : by name: "fig5a", "fig5c", "fig6", "contributions", "discussion"; some may be missing.
    """
    makers: dict[str, Callable[[Any], Iterator[Row]]] = {
        "fig5a": _angle_rows,
        "fig5c": _width_rows,
        "fig6": _path_rows,
        "contributions": _contribution_rows,
        "discussion": _discussion_rows,
    }
    return tuple(
        row for name, maker in makers.items() if name in records for row in maker(records[name])
    )


def note_from_records(records: Mapping[str, Any]) -> str:
    """What the paper's chain reaches here against the paper, and why; "" without Fig. 6.

    Parameters
    ----------
    records : as for `rows_from_records`; what was not measured is left out.
    """
    if "fig6" not in records:
        return ""
    figure: Fig6 = records["fig6"]
    at = figure.ways.index(Way("paper", "delays", True))
    position, time = figure.position_rms_mm[at], figure.event_time_rms_ps[at]
    sentences = []
    if "fig5a" in records:
        leg: Fig5a = records["fig5a"]
        angle = leg.estimator_averaged_deg[leg.estimators.index("paper, delays")]
        sentences.append(
            f"The paper's chain errs by {angle:.2g}° on one leg, where the paper has "
            f"{reported.MEAN_ANGLE_ERROR_DEG}°."
        )
    sentences.append(
        f"Calibrated as in the paper (delays alone), its chain errs by {position:.2g} mm and "
        f"{time:.2g} ps on three legs, {position / POSITION_RMS_MM:.1f} and "
        f"{time / EVENT_TIME_RMS_PS:.1f} times the paper's numbers."
    )
    errors: dict[str, tuple[float, float]] = {}
    if "contributions" in records:
        tried: Contributions = records["contributions"]
        errors = dict(
            zip(
                tried.names,
                zip(tried.position_rms_mm, tried.event_time_rms_ps, strict=True),
                strict=True,
            )
        )
    for name, words in _TELLING.items():
        if name in errors:
            sentences.append(f"{words} {errors[name][0]:.2g} mm and {errors[name][1]:.2g} ps.")
    return " ".join([*sentences, WHY])


_TELLING = {
    "lines": "Its times are not to blame: with every leg's line in the picture put right, and code "
    "widths calibrated too, the same times give",
    "lines-delays": "With delays alone they give",
    "alone-0.50": "Legs recorded one at a time with a blur of 0.50 px give",
}
"""Variants of `contributions` that the note tells of."""


def _angle_rows(figure: Fig5a) -> Iterator[Row]:
    at = {name: k for k, name in enumerate(figure.estimators)}
    over = f"mean of {len(figure.angles_deg)} angles"
    for words, errors, shrink in (
        ("one recording", figure.estimator_single_deg, 1.0),
        (
            f"mean of {figure.recordings} recordings",
            figure.estimator_averaged_deg,
            figure.recordings**-0.5,
        ),
    ):
        what = f"angle error, 32 times, {words}"
        known, fitted = (figure.bound_deg[p] * shrink for p in ("known", "fitted"))
        yield Row(
            f"{what}; paper's clock: delays, ours: code widths too", "deg", "Fig. 5a",
            reported.MEAN_ANGLE_ERROR_DEG if shrink != 1.0 else None,
            errors[at["paper, delays"]], errors[at["joint"]], errors[at["photon"]], known,
            f"source, emission time known; {over}",
            f"angle of one leg, 32 times, {words}" if shrink != 1.0 else "",
        )  # fmt: skip
        yield Row(
            f"{what}; code widths calibrated", "deg", "Fig. 5a", None, errors[at["paper, codes"]],
            errors[at["joint"]], errors[at["photon"]], known, "source, emission time known",
        )  # fmt: skip
        yield Row(
            f"{what}; emission time fitted", "deg", "Fig. 5a", None, None,
            errors[at["joint, emission fitted"]], None, fitted, "source known, emission fitted",
        )  # fmt: skip
    yield Row(
        "angle error, 2 times; paper's clock: delays", "deg", "Fig. 5a",
        reported.ANGLE_ERROR_TWO_TIMES_DEG,
        figure.averaged_deg["delays"][0], None, None, None,
        "source, emission time known; the first two in the order of flight",
        "the same from 2 times",
    )  # fmt: skip


def _width_rows(figure: Fig5c) -> Iterator[Row]:
    yield Row(
        "pulse width (FWHM) after deconvolution, one leg; laser: 68 ps", "ps", "Fig. 5c",
        reported.DECONVOLVED_FWHM_PS, figure.width_ps, None, None, None,
        "of a pixel's histogram; response 150 ps known", "laser pulse of 68 ps, deconvolved, FWHM",
    )  # fmt: skip
    error = float(np.sqrt(np.mean((figure.frame_ps - figure.theory_frame_ps) ** 2)))
    low, high = float(figure.theory_frame_ps.min()), float(figure.theory_frame_ps.max())
    yield Row(
        f"pulse width in one frame against {low:.0f}-{high:.0f} ps of theory, rms", "ps",
        "Fig. 5c", None, None, error, None, None, "in event time; response 150 ps known",
    )  # fmt: skip


def _path_rows(figure: Fig6) -> Iterator[Row]:
    at = {way: k for k, way in enumerate(figure.ways)}

    def error(values: Any, method: str, clock: str, *, known: bool) -> float:
        return float(values[at[Way(method, clock, known)]])

    for words, unit, number, values, bound in (
        ("position", "mm", POSITION_RMS_MM, figure.position_rms_mm, figure.bound_mm),
        ("time", "ps", EVENT_TIME_RMS_PS, figure.event_time_rms_ps, figure.bound_ps),
    ):
        for clock, known in (("delays", True), ("codes", True), ("codes", False)):
            prior = "emission time known" if known else "emission time fitted"
            given = (
                "paper's clock: delays, ours: code widths too"
                if clock == "delays"
                else "code widths calibrated"
            )
            yield Row(
                f"{words} error, three legs, in view, rms; {prior}; {given}", unit, "Fig. 6",
                number if clock == "delays" else None,
                error(values, "paper", clock, known=known),
                error(values, "joint", "codes", known=known),
                error(values, "photon", "codes", known=known),
                bound[known],
                f"source known, {prior}",
                f"three legs, {words}, rms in view" if clock == "delays" else "",
            )  # fmt: skip
    for known in (True, False):
        prior = "emission time known" if known else "emission time fitted"
        yield Row(
            f"position error, three legs, source to exit, rms; {prior}; code widths calibrated",
            "mm", "Fig. 6", None,
            error(figure.whole_position_rms_mm, "paper", "codes", known=known),
            error(figure.whole_position_rms_mm, "joint", "codes", known=known),
            error(figure.whole_position_rms_mm, "photon", "codes", known=known),
            None, f"source known, {prior}",
        )  # fmt: skip
    yield Row(
        "arrival time against event time, before correction, rms", "ps", "Fig. 6b",
        reported.ARRIVAL_TIME_RMS_PS, figure.before_ps, None, None, None,
        "the scene's, no measurement", "time before correction, rms",
    )  # fmt: skip
    yield Row(
        "pulse width (FWHM) after deconvolution, three legs; laser: 68 ps", "ps", "Fig. 6",
        reported.DECONVOLVED_FWHM_THREE_LEGS_PS, figure.width_ps, None, None, None,
        "of a pixel's histogram; response 150 ps known",
    )  # fmt: skip
    for words, number in (
        ("transverse resolution, surpassed", reported.TRANSVERSE_RESOLUTION_MM),
        ("longitudinal resolution, surpassed", reported.LONGITUDINAL_RESOLUTION_MM),
    ):
        yield Row(
            words, "mm", "Section 5", number,
            error(figure.position_rms_mm, "paper", "codes", known=True),
            error(figure.position_rms_mm, "joint", "codes", known=True),
            error(figure.position_rms_mm, "photon", "codes", known=True),
            figure.bound_mm[True], "position error in view; emission time known",
        )  # fmt: skip


def _contribution_rows(contributions: Contributions) -> Iterator[Row]:
    for words, position in zip(contributions.words, contributions.position_rms_mm, strict=True):
        yield Row(
            f"the paper's chain, three legs: {words}", "mm", "Fig. 6", None, float(position), None,
            None, None, "emission time known",
        )  # fmt: skip


def _discussion_rows(discussion: Discussion) -> Iterator[Row]:
    def number(value: float | None) -> float | None:
        return None if value is None or not np.isfinite(value) else float(value)

    for case in discussion.cases:
        quantity, _, unit = case.quantity.partition(" (")
        yield Row(
            f"{case.topic}, {case.name}: {quantity}", unit.rstrip(")"), "Section 5", None,
            number(case.errors.get("paper")), number(case.errors.get("joint")),
            number(case.errors.get("photon")), number(case.bound),
            "; ".join(filter(None, ("source, emission time known", case.note))),
            f"three legs, {case.name}, position" if case.topic == "larger array" else "",
        )  # fmt: skip


# --- the table -------------------------------------------------------------------------------

COLUMNS = (
    "quantity", "unit", "reported", "paper", "joint", "photon", "bound", "factor", "prior",
)  # fmt: skip
"""Headings of `cells_of_row`."""


def cells_of_row(row: Row) -> tuple[str, ...]:
    """A row as it is printed."""
    numbers = (row.reported, row.paper, row.joint, row.photon, row.bound, row.factor)
    return (row.quantity, row.unit, *(_number(value) for value in numbers), row.prior)


def _number(value: float | None) -> str:
    """Three digits; a dash for what does not apply."""
    if value is None:
        return "–"
    return f"{value:.3g}" if abs(value) < 100 else f"{value:,.0f}"


def values_of_row(row: Row) -> dict[str, Any]:
    """A row for programs."""
    return asdict(row) | {"factor": row.factor}


def markdown_from_rows(
    rows: tuple[Row, ...], about: Mapping[str, Any], *, notes: Sequence[str] = ()
) -> str:
    """The table as Markdown, with notes, seed, version and date."""
    titles = ["the paper" if column == "reported" else column for column in COLUMNS]
    lines = [
        f"| {' | '.join(titles)} |",
        "|---|---|" + "---:|" * 6 + "---|",
        *(f"| {' | '.join(cells_of_row(row))} |" for row in rows),
        "",
        "*the paper*: measured in its laboratory. *paper*, *joint*, *photon*: estimators, on the "
        "twin. *bound*: Cramér-Rao bound of a perfect clock. *factor*: the paper's number over the "
        "better of joint and photon.",
        "",
        *(line for note in notes for line in (note, "")),
        f"lightflight {about['lightflight']}, seed {about['seed']}, {about['made_utc']}"
        + (", quick run" if about["quick"] else "")
        + ".",
        "",
    ]
    return "\n".join(lines)
