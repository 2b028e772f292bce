"""`lightflight simulate`: a recording by the digital twin."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import Fact, report
from lightflight.cli.options import (
    POSITIVE,
    RECORD_SUFFIXES,
    check_outputs,
    debug_option,
    json_option,
    lab_options,
    output_option,
    seed_option,
)
from lightflight.cli.progress import step, writing

if TYPE_CHECKING:
    from lightflight.recording.histograms import Histograms
    from lightflight.recording.recording import Recording


@click.command("simulate", short_help="Simulate a recording, photon by photon.")
@click.option(
    "--kind",
    type=click.Choice(["histograms", "frames", "events", "code_density", "flat", "dark"]),
    default="histograms",
    show_default=True,
    help="The pulse (as histograms, frames or photon events), or a calibration recording.",
)
@click.option(
    "--photons",
    type=POSITIVE,
    help="Expected signal counts in the brightest pixel; for code_density and flat the mean "
    "counts per pixel.  [default: 40,000; code_density: 4 million]",
)
@seed_option()
@output_option("Recording to write (.h5).")
@lab_options
@json_option
@debug_option
def command(
    *,
    kind: str,
    photons: float | None,
    seed: int,
    output: Path,
    lab_path: Path | None,
    assignments: tuple[str, ...],
    dry_run: bool,
    as_json: bool,
) -> None:
    """Simulate what a camera would record of a pulse, photon by photon.

    Without --lab: the paper's three-leg experiment, seen by its camera with all the defects of
    a real one. In a set-up, [scene] has the path (vertices_mm, or source_direction and mirrors)
    and [detector] the camera's clock; its keys change its preset (without one: an ideal camera).

    \b
    Examples:
      lightflight simulate -o recording.h5
      lightflight simulate --kind flat --photons 400000 -o flat.h5
      lightflight simulate --set detector.preset=pf32 --set detector.seed=99 -o another_camera.h5
    """
    from lightflight.cli.records import (
        lab_from_options,
        print_lab,
        provenance_of_command,
        tell_of_papers_path,
    )
    from lightflight.formats.registry import write
    from lightflight.lab import resolved_lab, scene_from_lab
    from lightflight.simulate import simulate

    inputs = [] if lab_path is None else [lab_path]
    check_outputs([output], suffixes=RECORD_SUFFIXES, kinds=("histograms", "recording"))
    lab = lab_from_options(lab_path, assignments)
    scene = scene_from_lab(lab)
    if lab_path is not None and kind in ("histograms", "frames", "events"):
        tell_of_papers_path(lab)
    if dry_run:
        print_lab(resolved_lab(lab, scene))
        return
    # The command line stands over the set-up, which stands over the default of each kind.
    photons = lab.scene.get("photons_per_pixel") if photons is None else photons
    with step(f"simulating {kind}"):
        recording = simulate(scene, photons_per_pixel=photons, seed=seed, kind=kind)
    with writing(output):
        made = provenance_of_command(
            "simulate", inputs, resolved_lab(lab, scene), kind=kind, seed=seed
        )
        write(replace(recording, settings={**recording.settings, "provenance": made}), output)
    _report(recording, kind, seed, output, as_json=as_json)


def _report(
    recording: Recording | Histograms, kind: str, seed: int, output: Path, *, as_json: bool
) -> None:
    """Say on stdout what was simulated."""
    from lightflight.cli.records import clock_facts, photon_facts
    from lightflight.recording.description import describe_recording

    facts = [
        Fact("simulated", "kind", kind),
        Fact("seed", "seed", seed),
        *clock_facts(recording),
        *photon_facts(describe_recording(recording)),
    ]
    flat = getattr(recording.truth, "flat_arrival_ps", None)
    if flat is not None:
        facts.append(Fact("arrival of the flat's light", "flat_arrival_ps", flat, f"{flat:g} ps"))
    report(facts, as_json=as_json, written=[output])
