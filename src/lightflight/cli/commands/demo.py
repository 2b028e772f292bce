"""`lightflight demo`: the whole chain on the paper's experiment, without a lab."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import print_json, print_sentences, print_table
from lightflight.cli.options import debug_option, json_option, seed_option
from lightflight.cli.progress import step

if TYPE_CHECKING:
    from lightflight.demo import Estimate, Recordings
    from lightflight.path.light_path import LightPath
    from lightflight.timing.clock.calibration import TimingCalibration

_FILES = ("recording.h5", "calibration.h5", "path.h5", "path.csv", "demo.png")

_REFERENCE = ("joint", "fitted")
"""Method and prior of the path that is written: what a lab has, where the trigger delay is
unknown."""


@click.command("demo", short_help="Try everything on the paper's experiment.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("out/demo"),
    show_default=True,
    help="Folder for the results; made if needed.",
)
@click.option(
    "--photons",
    type=click.FloatRange(min=1),
    default=40_000.0,
    help="Expected signal counts in the brightest pixel.  [default: 40,000]",
)
@seed_option(default=1)
@json_option
@debug_option
def command(*, output: Path, photons: float, seed: int, as_json: bool) -> None:
    """Simulate, calibrate and reconstruct the paper's three-leg experiment, and compare.

    A pulse goes by way of two mirrors outside the picture; a SPAD camera with 55 ps codes and
    all the defects of a real one looks on. Takes less than a minute.

    \b
    Examples:
      lightflight demo
      lightflight demo --photons 500 -o out/starved
    """
    from lightflight.cli.paths import print_verdict
    from lightflight.demo import (
        calibrate_three_legs,
        estimate_three_legs,
        record_three_legs,
    )

    started = time.perf_counter()
    output.mkdir(parents=True, exist_ok=True)
    recordings = record_three_legs(photons_per_pixel=photons, seed=seed, step=_shown)
    timings = calibrate_three_legs(recordings, step=_shown)
    estimates = estimate_three_legs(recordings, timings, step=_shown)
    # Among the seconds that are told: drawing is a part of what a newcomer waits for.
    with _shown(f"writing {output}"):
        _write_results(recordings, timings[_REFERENCE[1]], estimates, output)
    seconds = time.perf_counter() - started
    if as_json:
        print_json(json_from_demo(recordings, estimates) | {"seconds": round(seconds, 1)})
        return
    print_verdict(_reference(estimates))
    _print_comparison(recordings, estimates)
    print_sentences(
        [
            f"Written to {output}: {', '.join(_FILES)} (the path is {_REFERENCE[0]}'s, "
            "emission time fitted).",
            f"{seconds:.0f} s in all.",
        ]
    )


def _shown(what: str) -> AbstractContextManager[object]:
    """A step of the demo: each stays on the screen, with the time it took."""
    return step(what, always=True)


def comparison_rows(recordings: Recordings, estimates: list[Estimate]) -> list[dict[str, object]]:
    """The comparison with the paper: one row per result, the paper's own first.

    Parameters
    ----------
    recordings : Recordings
        What was recorded.
    estimates : list of Estimate
        What was made of it.

    Returns
    -------
    list of dict
        Rms errors in view and from source to exit, mm and ps; None where the paper states none.
    """
    from lightflight.demo import EVENT_TIME_RMS_PS, POSITION_RMS_MM, PRIORS

    rows: list[dict[str, object]] = [
        {
            "result": "paper, Fig. 6 (measured)",
            "method": None,
            "prior": "source known",
            "position_rms_mm": POSITION_RMS_MM,
            "event_time_rms_ps": EVENT_TIME_RMS_PS,
            "whole_position_rms_mm": None,
            "photons_per_pixel": None,
            "verdict": None,
        }
    ]
    rows += [
        {
            "result": f"{estimate.method} (simulated)",
            "method": estimate.method,
            "prior": PRIORS[estimate.prior],
            "position_rms_mm": estimate.error.position_rms_mm,
            "event_time_rms_ps": estimate.error.event_time_rms_ps,
            "whole_position_rms_mm": estimate.whole_error.position_rms_mm,
            "photons_per_pixel": recordings.photons_per_pixel,
            "verdict": str(estimate.path.verdict.level),
        }
        for estimate in estimates
    ]
    return rows


def json_from_demo(recordings: Recordings, estimates: list[Estimate]) -> dict[str, object]:
    """The demo's results for programs; `tools/update_readme.py` reads them.

    Parameters
    ----------
    recordings : Recordings
        What was recorded.
    estimates : list of Estimate
        What was made of it.

    Returns
    -------
    dict of str
        `seed` and `rows`.
    """
    return {"seed": recordings.seed, "rows": comparison_rows(recordings, estimates)}


def _print_comparison(recordings: Recordings, estimates: list[Estimate]) -> None:
    """The rows as a table, and what its columns mean."""

    def cell(row: Mapping[str, object], key: str, digits: str) -> str:
        return "not stated" if row[key] is None else format(row[key], digits)

    print_table(
        ("result", "verdict", "prior", "in view (mm)", "in view (ps)", "to exit (mm)", "photons"),
        [
            (
                row["result"],
                row["verdict"] or "–",
                row["prior"],
                cell(row, "position_rms_mm", ".3f"),
                cell(row, "event_time_rms_ps", ".3f"),
                cell(row, "whole_position_rms_mm", ".3f"),
                cell(row, "photons_per_pixel", ",.0f"),
            )
            for row in comparison_rows(recordings, estimates)
        ],
        title="Three legs: rms error of the path",
        n_text_columns=3,
    )
    print_sentences(
        [
            "In view: positions at 1,000 equal event times; times on the rays of the pixels that "
            "see the path. To exit: positions from source to exit, in view or not. Photons: "
            "expected signal counts in the brightest pixel.",
        ]
    )


def _reference(estimates: list[Estimate]) -> LightPath:
    """The path that is kept and shown."""
    return next(e.path for e in estimates if (e.method, e.prior) == _REFERENCE)


def _write_results(
    recordings: Recordings,
    timing: TimingCalibration,
    estimates: list[Estimate],
    output: Path,
) -> None:
    """Write recording, calibration, path, points and picture into a folder."""
    from dataclasses import replace

    from lightflight.demo import EVENT_TIME_RMS_PS, POSITION_RMS_MM
    from lightflight.formats.registry import write
    from lightflight.provenance import provenance_record
    from lightflight.timing.pulses.arrivals import find_arrivals
    from lightflight.view.export.files import write_figure
    from lightflight.view.export.tables import write_csv
    from lightflight.view.figures.demo import demo_figure

    settings = {"photons_per_pixel": recordings.photons_per_pixel}
    made = provenance_record(command="lightflight demo", settings=settings, seed=recordings.seed)
    hist = recordings.hist
    write(replace(hist, settings={**hist.settings, "provenance": made}), output / "recording.h5")
    replace(timing, provenance=made).save(output / "calibration.h5")
    chosen = {(e.method, e.prior): e.path for e in estimates}
    path = replace(_reference(estimates), provenance=made)
    path.save(output / "path.h5")
    write_csv(path, output / "path.csv")
    figure = demo_figure(
        path,
        truth=hist.truth,
        arrivals=find_arrivals(hist, timing=timing),
        others={"paper": chosen["paper", _REFERENCE[1]]},
        published={"Zheng 2020": (POSITION_RMS_MM, EVENT_TIME_RMS_PS)},
    )
    write_figure(figure, output / "demo.png")
