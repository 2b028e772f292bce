"""`lightflight check`: does a set-up go with a recording, before any path is asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli.console import Fact, print_facts, print_json, print_table, print_written
from lightflight.cli.options import (
    PLOT_SUFFIXES,
    check_outputs,
    debug_option,
    hint_option,
    json_option,
    outputs_option,
    set_option,
    timing_option,
)
from lightflight.cli.progress import step, writing

if TYPE_CHECKING:
    from lightflight.flight import Source
    from lightflight.lab import Lab
    from lightflight.path.light_path import LightPath
    from lightflight.path.verdict import Finding
    from lightflight.reconstruct.legs.find import ImageLeg
    from lightflight.recording.histograms import Histograms
    from lightflight.timing.clock.calibration import TimingCalibration

_CLEARLY = 5.0
"""A told emission time this many errors from the recording's is another one."""


@click.command("check", short_help="Check a set-up against a recording, before any fit.")
@click.argument("lab_path", metavar="LAB", type=click.Path(path_type=Path))
@click.argument("recording", metavar="RECORDING", type=click.Path(path_type=Path))
@timing_option("Calibration of the clock, from `lightflight calibrate`. Without: nominal.")
@outputs_option("Figure to write (.png .pdf .svg): the set-up drawn over the picture.")
@click.option("--strict", is_flag=True, help="End with exit code 6 where anything is found.")
@set_option("set-up")
@hint_option
@json_option
@debug_option
def command(
    *,
    lab_path: Path,
    recording: Path,
    timing_path: Path | None,
    outputs: tuple[Path, ...],
    strict: bool,
    assignments: tuple[str, ...],
    hints: dict[str, object],
    as_json: bool,
) -> None:
    """Check whether the set-up LAB can be that of RECORDING.

    \b
    Asked, with what to do where the answer is no:
      units         lengths in mm, times in ps: 0.535 mm, or 535? 2 ps, or 2 ns?
      orientation   do pixels come out square, or are width and height swapped? Does
                    the first leg lead back to the source, or would it in a picture
                    that was mirrored, turned or transposed?
      source        is the emission time the one that the recording asks for?
      calibration   is the clock that of the camera that recorded?

    Then the price: how far each mm, degree and percent of the set-up, taken as exact, would
    move a corner of the path. State as an error what you cannot measure better than that.

    Exit code 0, whatever is found (with --strict: 6); 4 for another camera's calibration; 5
    where no leg is seen.

    \b
    Examples:
      lightflight check lab.toml recording.h5 --timing calibration.h5 -o setup.png
      lightflight check lab.toml recording.h5 --set camera.distance_mm=535 --json
    """
    from lightflight.cli.errors import NotTrustedError
    from lightflight.cli.records import (
        calibration_from_option,
        lab_from_options,
        read_histograms,
    )
    from lightflight.errors import ConfigError

    check_outputs(outputs, suffixes=PLOT_SUFFIXES)
    lab = lab_from_options(lab_path, assignments)
    if lab.camera is None:
        lacks = " and ".join(lab.camera_needs)
        raise ConfigError(f"{lab_path}: has no camera to check: [camera] lacks {lacks}")
    hist = read_histograms(recording, lab, hints)
    checked = _checked(lab, hist, calibration_from_option(timing_path))
    for output in outputs:
        with writing(output):
            _draw(lab, hist, checked.legs, output, title=recording.name)
    _print(checked, outputs, as_json=as_json)
    if strict and checked.findings:
        raise NotTrustedError(f"{len(checked.findings)} findings: {checked.findings[0].sentence}")


@dataclass(frozen=True)
class _Checked:
    """What there is to say of a set-up.

    Attributes
    ----------
    legs : tuple of ImageLeg
        In the picture.
    facts : list of Fact
        Scale and place of things.
    findings : tuple of Finding
        What cannot be so.
    prices : tuple of str
        What each part of the set-up costs; empty where no path is found.
    """

    legs: tuple[ImageLeg, ...]
    facts: list[Fact]
    findings: tuple[Finding, ...]
    prices: tuple[str, ...]


def _checked(lab: Lab, hist: Histograms, timing: TimingCalibration | None) -> _Checked:
    """Ask everything that can be asked of a set-up and a recording."""
    from lightflight.reconstruct import find_legs
    from lightflight.reconstruct.calls import checked_call
    from lightflight.reconstruct.legs.plausible import implausible
    from lightflight.timing.pulses.arrivals import find_arrivals
    from lightflight.timing.pulses.same_camera import check_same_camera

    camera = checked_call([hist], lab.camera, lab.source, "joint", None, None)
    with step("fitting the pulses"):
        arrivals = find_arrivals(hist, timing=timing)
    if timing is not None:
        check_same_camera(arrivals, timing)
    with step("looking for legs"):
        legs = find_legs(arrivals, camera=camera)
    findings = implausible(camera, lab.source, lab.medium, legs, code_ps=hist.bin_width_ps)
    with step("weighing the set-up"):
        path = _rough_path(replace(lab, source=_untimed(lab.source)), hist, timing)
    emission = _emission_finding(lab, path, hist.laser_period_ps)
    if path is not None and emission is None:
        # The recording itself says that the emission time is right, small as it may be.
        findings = tuple(one for one in findings if "emission time" not in one.sentence)
    elif emission is not None:
        findings = (*findings, emission)
    told = path
    if lab.source.emission_time_ps is not None and emission is None:
        with step("weighing the set-up with its emission time"):
            told = _rough_path(lab, hist, timing) or path
    prices = () if told is None else told.prices
    return _Checked(legs, _facts(lab, hist, legs, path), findings, prices)


def _rough_path(lab: Lab, hist: Histograms, timing: TimingCalibration | None) -> LightPath | None:
    """A path with all that the set-up says taken as exact; None: there is none."""
    import warnings

    from lightflight.camera.model import LENS_ERRORS
    from lightflight.errors import LightflightWarning
    from lightflight.flight import Medium
    from lightflight.reconstruct import reconstruct

    assert lab.camera is not None
    exact: dict[str, Any] = dict.fromkeys((*LENS_ERRORS, "clock_offset_std_ps"), 0.0)
    camera = replace(lab.camera, pose_covariance=None, **exact)
    source = replace(lab.source, position_std_mm=0.0, emission_time_std_ps=0.0)
    medium = Medium(
        lab.medium.path_group_index, lab.medium.return_group_index, blocks=lab.medium.blocks
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        try:
            return reconstruct(hist, camera=camera, source=source, medium=medium, timing=timing)
        except (ValueError, RuntimeError):  # as found: what it would have said, the findings say
            return None


def _untimed(source: Source) -> Source:
    """A source whose emission time is not known."""
    return replace(source, emission_time_ps=None, emission_time_std_ps=0.0)


def _emission_finding(lab: Lab, path: LightPath | None, period_ps: float | None) -> Finding | None:
    """Whether the emission time told is far from the one the recording asks for."""
    from lightflight.path.verdict import Finding, FindingName, Severity

    told = lab.source.emission_time_ps
    if told is None or path is None or lab.source.position_mm is None:
        return None
    found, std = float(path.vertex_times_ps[0]), float(path.vertex_std[0, 3])
    apart = found - told
    if period_ps is not None:
        apart -= period_ps * round(apart / period_ps)
    sigma = abs(apart) / float((std**2 + lab.source.emission_time_std_ps**2 + 1.0) ** 0.5)
    if sigma < _CLEARLY:
        return None
    return Finding(
        FindingName.SOURCE,
        f"the emission time is told as {told:.6g} ps, and the source's place and the recording ask "
        f"for {found:.6g} ± {std:.2g} ps",
        sigma,
        "measure the trigger delay anew (or its unit, or the source's place), or leave "
        "emission_time_ps out: it is then fitted",
        Severity.CHECK,
    )


def _facts(
    lab: Lab, hist: Histograms, legs: tuple[ImageLeg, ...], path: LightPath | None
) -> list[Fact]:
    """Scale of the picture, and where the source lies in it."""
    import numpy as np

    from lightflight.reconstruct.legs.plausible import distance_mm, pixel_sides_mm, slowness

    assert lab.camera is not None
    camera, source = lab.camera, lab.source
    far, (width, height) = distance_mm(camera, source), pixel_sides_mm(camera, source)
    rows, cols = camera.shape
    of = "source" if source.position_mm is not None else "origin"
    recorded, flight = slowness(camera, source, lab.medium, legs)
    facts = [
        Fact(f"{of} from the camera", "distance_mm", far, f"{far:.5g} mm along the optical axis"),
        Fact(
            "field of view there",
            "field_of_view_mm",
            (cols * width, rows * height),
            f"{cols * width:.5g} x {rows * height:.5g} mm (width x height)",
        ),
        Fact("one pixel", "pixel_mm", (width, height), f"{width:.4g} x {height:.4g} mm"),
        Fact("light crosses it in", "pixel_flight_ps", flight, f"{flight:.3g} ps"),
        Fact(
            "recorded, px to px",
            "pixel_recorded_ps",
            recorded,
            f"{recorded:.3g} ps on the swiftest leg",
        ),
        Fact("legs in the picture", "n_legs", len(legs)),
    ]
    if source.position_mm is not None:
        row, col = (float(x) for x in camera.pixels_from_points(np.asarray(source.position_mm)))
        inside = "in the picture" if bool(camera.sees(source.position_mm)) else "beyond its border"
        words = f"column {col:.1f}, row {row:.1f}: {inside}"
        facts.append(Fact("source", "source_px", (col, row), words))
    if path is not None and source.position_mm is not None:
        found = float(path.vertex_times_ps[0])
        facts.append(Fact("emission time, fitted", "emission_ps", found, f"{found:,.1f} ps"))
    return facts


def _draw(
    lab: Lab, hist: Histograms, legs: tuple[ImageLeg, ...], output: Path, *, title: str
) -> None:
    """The set-up over the picture."""
    from lightflight.view.export.files import write_figure
    from lightflight.view.figures.setup import setup_figure

    assert lab.camera is not None
    write_figure(setup_figure(hist, lab.camera, lab.source, legs, title=title), output)


def _print(checked: _Checked, outputs: tuple[Path, ...], *, as_json: bool) -> None:
    """Say on stdout what was found."""
    if as_json:
        print_json(
            {fact.key: fact.value for fact in checked.facts}
            | {
                "findings": [
                    {"name": one.name.value, "sentence": one.sentence, "remedy": one.remedy}
                    for one in checked.findings
                ],
                "prices": checked.prices,
                "written": [str(output) for output in outputs],
            }
        )
        return
    if checked.findings:
        print_table(
            ("finding", "what was seen", "what to do"),
            [(one.name.value, one.sentence, one.remedy) for one in checked.findings],
            n_text_columns=3,
        )
    else:
        print_facts([Fact("findings", "findings", "none: the set-up can be that of the recording")])
    print_facts(checked.facts)
    if checked.prices:
        said = [price.replace(" exact:", ":", 1) for price in checked.prices]
        print_facts(
            [Fact("" if k else "price, where exact", "price", line) for k, line in enumerate(said)]
        )
    if outputs:
        print_written(outputs)
