"""Reading and describing records for the commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lightflight.cli.console import Fact, with_error
from lightflight.cli.progress import say, step

if TYPE_CHECKING:
    from lightflight.lab import Lab
    from lightflight.recording.description import Description
    from lightflight.recording.histograms import Histograms
    from lightflight.recording.recording import Recording
    from lightflight.timing.clock.calibration import TimingCalibration


def lab_from_options(lab_path: Path | None, assignments: Iterable[str]) -> Lab:
    """Lab from --lab and --set.

    Parameters
    ----------
    lab_path : Path or None
        Set-up file.
    assignments : iterable of str
        "section.key=value", laid over it.

    Returns
    -------
    Lab
        The set-up.

    Raises
    ------
    ConfigError
        As `lightflight.lab.lab_from_toml`.
    """
    from lightflight.lab import lab_from_toml

    return lab_from_toml(lab_path, assignments=assignments)


def print_lab(lab: Lab) -> None:
    """Print what was understood of a set-up, as TOML, for --dry-run.

    Parameters
    ----------
    lab : Lab
        The set-up.
    """
    from lightflight.lab import toml_from_lab

    click.echo(toml_from_lab(lab).rstrip())
    if lab.camera_needs:
        click.echo(f"# no camera yet: [camera] lacks {' and '.join(lab.camera_needs)}")


def tell_of_papers_path(lab: Lab) -> None:
    """Say that a set-up has no path of its own, so that the paper's three legs stand in.

    Parameters
    ----------
    lab : Lab
        Of a set-up file.
    """
    if not lab.scene.keys() & {"vertices_mm", "source_direction"}:
        say("the set-up has no path ([scene] vertices_mm): the paper's three legs stand in")


def read_hinted(path: Path, lab: Lab, hints: Mapping[str, object]) -> Recording | Histograms:
    """Recording or histograms from a file of any known format.

    Parameters
    ----------
    path : Path
        The file.
    lab : Lab
        The set-up; [recording] tells what the file does not.
    hints : mapping of str
        What --hint told; stands over [recording].

    Returns
    -------
    Recording or Histograms
        What the file holds.
    """
    from lightflight.formats.registry import read

    with step(f"reading {path.name}"):
        return read(path, **{**lab.recording, **hints})


def read_histograms(path: Path, lab: Lab, hints: Mapping[str, object]) -> Histograms:
    """Histograms from a file; recordings are counted.

    Parameters
    ----------
    path : Path
        The file.
    lab : Lab
        The set-up; [recording] tells what the file does not.
    hints : mapping of str
        What --hint told; stands over [recording].

    Returns
    -------
    Histograms
        Counts of every pixel and code.
    """
    from lightflight.recording.counting import histogram

    record = read_hinted(path, lab, hints)
    with step(f"counting {path.name}") as report:
        return histogram(record, progress=report)


def calibration_from_option(path: Path | None) -> TimingCalibration | None:
    """Timing calibration from --timing.

    Parameters
    ----------
    path : Path or None
        What was given.

    Returns
    -------
    TimingCalibration or None
        None where nothing was: the nominal clock.
    """
    if path is None:
        return None
    from lightflight.timing.clock.calibration import TimingCalibration

    return TimingCalibration.load(path)


def clock_facts(record: Recording | Histograms) -> list[Fact]:
    """How codes are read as times.

    Parameters
    ----------
    record : Recording or Histograms
        Whose clock.

    Returns
    -------
    list of Fact
        Shape, codes and clock; times in ps.
    """

    def ps(value: float | None) -> str:
        return "unknown" if value is None else f"{value:g} ps"

    rows, cols = record.shape
    direction = "reversed, a larger code is an earlier photon"
    if not record.reversed_codes:
        direction = "forward, a larger code is a later photon"
    return [
        Fact("pixels (rows x cols)", "shape", record.shape, f"{rows} x {cols}"),
        Fact("codes", "n_codes", record.n_codes),
        Fact("time per code", "bin_width_ps", record.bin_width_ps, ps(record.bin_width_ps)),
        Fact("laser period", "laser_period_ps", record.laser_period_ps, ps(record.laser_period_ps)),
        Fact("clock", "reversed_codes", record.reversed_codes, direction),
        Fact("first edge", "first_edge_ps", record.first_edge_ps, ps(record.first_edge_ps)),
        Fact("no-photon code", "no_photon_code", record.no_photon_code),
        Fact("frames", "n_frames", record.n_frames),
        Fact("laser periods per frame", "periods_per_frame", record.periods_per_frame),
    ]


def photon_facts(found: Description) -> list[Fact]:
    """Photons of a recording, and what looks unusual about its pixels.

    Parameters
    ----------
    found : Description
        From `lightflight.recording.description.describe_recording`.

    Returns
    -------
    list of Fact
        Counts of photons and of pixels; the drift in codes.
    """

    def or_unknown(value: float | None, digits: str, unit: str = "") -> str | None:
        return "unknown" if value is None else f"{format(value, digits)}{unit}"

    live = found.live_codes
    occupancy = found.occupancy
    drift = "unknown"
    if found.drift_codes is not None and found.drift_std_codes is not None:
        drift = f"{with_error(found.drift_codes, found.drift_std_codes)} codes"
    return [
        Fact("codes with photons", "live_codes", live,
             "none" if live is None else f"{live[0]}-{live[1]}"),
        Fact("photons", "photons", found.photons, f"{found.photons:,.10g}"),
        Fact("median pixel", "median_photons_per_pixel", found.median_photons,
             f"{found.median_photons:,.6g}"),
        Fact("photons per frame, median pixel", "occupancy", occupancy,
             or_unknown(occupancy, ".3g")),
        Fact("pixels that show a pulse", "pulse_pixels", found.n_pulse_pixels),
        Fact("pixels that scream", "screaming_pixels", found.n_screaming),
        Fact("pixels without a photon", "silent_pixels", found.n_silent),
        Fact("saturated pixels", "saturated_pixels", found.n_saturated),
        Fact("drift, first to second half", "drift_codes", found.drift_codes, drift),
    ]  # fmt: skip


def provenance_of_command(
    command: str, inputs: Iterable[Path | None], lab: Lab, **more: Any
) -> dict[str, object]:
    """Provenance of what a command makes, with the resolved set-up.

    Parameters
    ----------
    command : str
        Name of the command.
    inputs : iterable of Path or None
        Files that were read; None for what was not given.
    lab : Lab
        The set-up, options of the command line laid over it.
    **more
        Further settings; `seed` has a place of its own.

    Returns
    -------
    dict of str
        As `lightflight.provenance.provenance_record` makes it.
    """
    from lightflight.lab import table_from_lab
    from lightflight.provenance import provenance_record

    settings: Mapping[str, object] = table_from_lab(lab)
    return provenance_record(
        command=f"lightflight {command}",
        inputs=[path for path in inputs if path is not None],
        settings={**settings, **{k: v for k, v in more.items() if k != "seed"}},
        seed=more.get("seed"),
    )
