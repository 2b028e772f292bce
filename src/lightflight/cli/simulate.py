"""`lightflight simulate`: a recording by the digital twin."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli._console import (
    Fact,
    json_from_facts,
    print_facts,
    print_json,
    print_sentences,
    step,
)
from lightflight.cli._options import (
    RECORD_SUFFIXES,
    check_outputs,
    debug_option,
    json_option,
    lab_options,
    seed_option,
)

if TYPE_CHECKING:
    from lightflight.lab import Lab
    from lightflight.simulate.scene import Scene


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
    type=click.FloatRange(min=0, min_open=True),
    help="Expected signal counts in the brightest pixel; for code_density and flat the mean "
    "counts per pixel.  [default: 40,000; code_density: 4 million]",
)
@seed_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    help="Recording to write (.h5).",
)
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
    and [detector] the camera's clock.

    \b
    Examples:
      lightflight simulate -o recording.h5
      lightflight simulate --kind flat --photons 400000 -o flat.h5
      lightflight simulate --lab lab.toml --set detector.gain_rms=0.02 -o recording.h5
    """
    from lightflight.cli._records import lab_from_options, print_lab, provenance
    from lightflight.recording import write
    from lightflight.simulate import simulate

    inputs = [] if lab_path is None else [lab_path]
    check_outputs(
        [output], inputs=inputs, suffixes=RECORD_SUFFIXES, kinds=("histograms", "recording")
    )
    lab = lab_from_options(lab_path, assignments)
    scene = scene_from_lab(lab)
    if dry_run:
        print_lab(resolved_lab(lab, scene))
        return
    photons = lab.scene.get("photons_per_pixel") if photons is None else photons
    with step(f"simulating {kind}"):
        recording = simulate(scene, photons_per_pixel=photons, seed=seed, kind=kind)
    with step(f"writing {output.name}"):
        made = provenance("simulate", inputs, resolved_lab(lab, scene), kind=kind, seed=seed)
        write(_with_settings(recording, made), output)
    _report(recording, kind, seed, output, as_json=as_json)


def scene_from_lab(lab: Lab) -> Scene:
    """Scene of a set-up; what it does not say is as in the paper's experiment.

    Raises
    ------
    ConfigError
        Where there is a path but no camera to see it, or keys that do not go together.
    GeometryError
        Where the pulse meets none of the mirrors.
    """
    from lightflight.errors import ConfigError, GeometryError
    from lightflight.simulate import Scene, paper_scene, pf32
    from lightflight.simulate.tables import scene_arguments

    try:
        options = scene_arguments(lab.scene, lab.source)
    except GeometryError:
        raise
    except ValueError as problem:
        raise ConfigError(f"[scene] {problem}") from problem
    detector = pf32() if lab.detector is None else lab.detector
    vertices = options.pop("vertices_mm", None)
    if vertices is None:
        if lab.camera is not None:
            options["camera"] = lab.camera
        return paper_scene(detector, medium=lab.medium, **options)
    if lab.camera is None:
        raise ConfigError(
            f"[scene] has a path but nobody to see it: [camera] lacks "
            f"{' and '.join(lab.camera_needs)}"
        )
    return Scene(
        vertices,
        camera=lab.camera,
        source=lab.source,
        medium=lab.medium,
        detector=detector,
        **options,
    )


def resolved_lab(lab: Lab, scene: Scene) -> Lab:
    """Set-up with everything that the scene filled in."""
    from dataclasses import replace

    from lightflight.simulate.tables import MIRROR_KEYS

    own = {key: value for key, value in lab.scene.items() if key not in MIRROR_KEYS}
    return replace(
        lab,
        camera=scene.camera,
        source=scene.source,
        medium=scene.medium,
        detector=scene.detector,
        scene={
            **own,
            "vertices_mm": scene.vertices_mm,
            "true_emission_time_ps": scene.emission_time_ps,
        },
        camera_needs=(),
    )


def _with_settings(recording: Any, made: dict[str, Any]) -> Any:
    from dataclasses import replace

    return replace(recording, settings={**recording.settings, "provenance": made})


def _report(recording: Any, kind: str, seed: int, output: Path, *, as_json: bool) -> None:
    from lightflight.cli._records import clock_facts, photon_facts
    from lightflight.description import describe_recording

    facts = [
        Fact("simulated", "kind", kind),
        Fact("seed", "seed", seed),
        *clock_facts(recording),
        *photon_facts(describe_recording(recording)),
    ]
    flat = getattr(recording.truth, "flat_arrival_ps", None)
    if flat is not None:
        facts.append(Fact("arrival of the flat's light", "flat_arrival_ps", flat, f"{flat:g} ps"))
    if as_json:
        print_json(json_from_facts(facts) | {"written": [str(output)]})
        return
    print_facts(facts)
    print_sentences([f"Written: {output}"])
