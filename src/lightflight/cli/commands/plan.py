"""`lightflight plan`: how much light, how long, and where to put the camera."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import (
    Fact,
    plain,
    print_facts,
    print_json,
    print_sentences,
    print_table,
    print_written,
)
from lightflight.cli.options import (
    PLOT_SUFFIXES,
    POSITIVE,
    check_outputs,
    debug_option,
    json_option,
    outputs_option,
    set_option,
)
from lightflight.cli.progress import step, writing

if TYPE_CHECKING:
    from lightflight.reconstruct.limits.planning import Placement, Plan

_LONG_S = 120.0
"""Recording times beyond this are told in minutes or hours, s."""


def _places_from_texts(
    _context: click.Context, _option: click.Parameter, texts: tuple[str, ...]
) -> dict[str, tuple[float, ...]]:
    """Places by name from `name=x,y,z` texts."""
    places: dict[str, tuple[float, ...]] = {}
    for text in texts:
        name, equals, place = text.partition("=")
        try:
            xyz = tuple(float(number) for number in place.strip("[]() ").split(","))
        except ValueError:
            xyz = ()
        if not (equals and name.strip()) or len(xyz) != 3 or not all(map(math.isfinite, xyz)):
            raise click.UsageError(
                f"--camera {text!r}: write name=x,y,z in mm, for example side=600,40,300"
            )
        places[name.strip()] = xyz
    return places


@click.command("plan", short_help="Plan an experiment: light, time, place of the camera.")
@click.argument("setup", required=False, type=click.Path(path_type=Path))
@click.option(
    "--position-mm",
    type=POSITIVE,
    help="Wanted rms error of the position in view, mm.",
)
@click.option(
    "--time-ps",
    type=POSITIVE,
    help="Wanted rms error of the event time in view, ps.",
)
@click.option(
    "--angle-deg",
    type=POSITIVE,
    help="Wanted error of the worst leg's angle, deg.",
)
@click.option(
    "--photons",
    type=POSITIVE,
    help="Signal counts in the brightest pixel for the errors that are printed.  "
    "[default: [scene] photons_per_pixel, else 40,000]",
)
@click.option(
    "--rate-hz",
    type=POSITIVE,
    help="Signal counts per second in the brightest pixel, for times. The paper's: 200 (1e-5 per "
    "pulse at 20 MHz).",
)
@click.option(
    "--pixel-std-ps",
    type=click.FloatRange(min=0),
    default=0.0,
    show_default=True,
    help="Error of each pixel's clock: 0.4 after a good calibration, 3-6 without any, ps.",
)
@click.option(
    "--camera",
    "places",
    metavar="NAME=X,Y,Z",
    multiple=True,
    callback=_places_from_texts,
    help="Another place of the camera, turned towards the path, mm; may be given more than once.",
)
@set_option("set-up")
@outputs_option("Figure to write (.png .pdf .svg).")
@json_option
@debug_option
def command(
    *,
    setup: Path | None,
    position_mm: float | None,
    time_ps: float | None,
    angle_deg: float | None,
    photons: float | None,
    rate_hz: float | None,
    pixel_std_ps: float,
    places: dict[str, tuple[float, ...]],
    assignments: tuple[str, ...],
    outputs: tuple[Path, ...],
    as_json: bool,
) -> None:
    """Say what errors an experiment can reach, and what light and time a wanted error takes.

    SETUP is a set-up file in TOML with [scene] vertices_mm, [camera] and [source] (what will be
    known of it); without, the paper's experiment. The numbers are Cramér-Rao bounds: no estimator
    does better, and `joint` and `photon` come within some per cent.

    \b
    Examples:
      lightflight plan lab.toml --position-mm 0.2 --rate-hz 200
      lightflight plan lab.toml --camera side=600,40,300 --camera near=190,40,350 -o plan.png
    """
    from lightflight.cli.records import lab_from_options, tell_of_papers_path
    from lightflight.lab import scene_from_lab
    from lightflight.reconstruct.limits.planning import plan

    check_outputs(outputs, suffixes=PLOT_SUFFIXES)
    lab = lab_from_options(setup, assignments)
    scene = scene_from_lab(lab)
    if setup is not None:
        tell_of_papers_path(lab)
    if photons is None:
        photons = lab.scene.get("photons_per_pixel", 40_000.0)
    with step("working out what the photons allow"):
        found = plan(
            scene,
            position_rms_mm=position_mm,
            event_time_rms_ps=time_ps,
            angle_std_deg=angle_deg,
            photons_per_pixel=photons,
            rate_hz=rate_hz,
            cameras=places,
            pixel_std_ps=pixel_std_ps,
        )
    _write_figures(found, outputs)
    if as_json:
        print_json(json_from_plan(found) | {"written": [str(output) for output in outputs]})
        return
    _print_plan(found)
    if outputs:
        print_written(outputs)


def _write_figures(found: Plan, outputs: tuple[Path, ...]) -> None:
    """Draw the plan into each file."""
    if not outputs:
        return
    from lightflight.view.export.files import write_figure
    from lightflight.view.figures.plan import plan_figure

    for output in outputs:
        with writing(output, verb="drawing"):
            write_figure(plan_figure(found), output)


def json_from_plan(found: Plan) -> dict[str, object]:
    """The plan for programs.

    Parameters
    ----------
    found : Plan
        From `lightflight.plan`.

    Returns
    -------
    dict of str
        Names end in their units; one entry for each place of the camera and each array.
    """
    return {
        "prior": found.placements[0].bounds.prior,
        "wanted": dict(found.wanted),
        "placements": [_json_from_placement(place) for place in found.placements],
        "blind": dict(found.blind),
        "arrays": [
            {
                "shape": choice.shape,
                "position_rms_mm": choice.bounds.position_rms_mm,
                "event_time_rms_ps": choice.bounds.event_time_rms_ps,
                "pixels": choice.bounds.n_pixels,
                "photons_per_pixel": choice.bounds.photons_per_pixel,
            }
            for choice in found.arrays
        ],
        "statements": found.statements,
    }


def _json_from_placement(place: Placement) -> dict[str, object]:
    """One place of the camera for programs."""
    limit = place.bounds
    return {
        "name": place.name,
        "camera_mm": place.camera.center_mm,
        "photons_per_pixel": limit.photons_per_pixel,
        "photons": limit.photons,
        "pixels": limit.n_pixels,
        "position_rms_mm": limit.position_rms_mm,
        "event_time_rms_ps": limit.event_time_rms_ps,
        "angle_std_deg": limit.angle_std_deg,
        "angle_deg_per_ps": place.angle_deg_per_ps,
        "floor_mm": place.floor_mm,
        "needed_photons_per_pixel": place.photons_per_pixel,
        "needed_seconds": place.seconds,
    }


def _print_plan(found: Plan) -> None:
    """The plan as tables: by place of the camera, and by array of pixels."""
    first = found.placements[0].bounds
    facts = [Fact("prior", "prior", first.prior)]
    if found.wanted:
        units = {"mm": "mm", "ps": "ps", "deg": "°"}
        words = [
            f"{name.rsplit('_', 1)[0].replace('_', ' ')} {value:g} {units[name.rsplit('_', 1)[1]]}"
            for name, value in found.wanted.items()
        ]
        facts.append(Fact("wanted", "wanted", found.wanted, ", ".join(words)))
    print_facts(facts)
    print_table(
        (
            "camera", "at (mm)", "photons", "pixels", "position (mm)", "time (ps)", "angle (deg)",
            "needs photons", "in",
        ),
        [
            (
                place.name,
                plain(tuple(float(x) for x in place.camera.center_mm.round(1))),
                f"{place.bounds.photons_per_pixel:,.0f}",
                place.bounds.n_pixels,
                f"{place.bounds.position_rms_mm:.3g}",
                f"{place.bounds.event_time_rms_ps:.3g}",
                f"{place.bounds.angle_std_deg.max():.2g}",
                _needed(place.photons_per_pixel),
                _in_words(place.seconds),
            )
            for place in found.placements
        ],
        title="What the photons allow (rms in view; worst leg's angle; in the brightest pixel)",
        n_text_columns=2,
    )  # fmt: skip
    print_table(
        ("pixels (rows x cols)", "that see light", "photons", "position (mm)", "time (ps)"),
        [
            (
                f"{choice.shape[0]} x {choice.shape[1]}",
                choice.bounds.n_pixels,
                f"{choice.bounds.photons_per_pixel:,.0f}",
                f"{choice.bounds.position_rms_mm:.3g}",
                f"{choice.bounds.event_time_rms_ps:.3g}",
            )
            for choice in found.arrays
        ],
        title=f"The same light on other arrays ({found.placements[0].name})",
    )
    blind = [f"From {name!r}: {reason}." for name, reason in found.blind.items()]
    print_sentences([*blind, *found.statements])


def _needed(photons: float) -> str:
    """Photons a wanted error takes; a dash where none was wanted."""
    if math.isnan(photons):
        return "–"
    return "no light" if math.isinf(photons) else f"{photons:,.3g}"


def _in_words(seconds: float) -> str:
    """A recording time, s, in the unit one would say it in."""
    if not math.isfinite(seconds):
        return "–"
    for limit, unit, size in ((_LONG_S, "s", 1.0), (7200.0, "min", 60.0)):
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 3600.0:.3g} h"
