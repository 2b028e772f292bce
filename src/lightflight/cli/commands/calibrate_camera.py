"""`lightflight calibrate camera`: where the camera stands and its lens, as a set-up file."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lightflight.cli.console import Fact, report
from lightflight.cli.options import debug_option, json_option, output_option
from lightflight.cli.progress import step, writing
from lightflight.files.whole_file import atomic_path

if TYPE_CHECKING:
    from lightflight.camera.calibration import CameraFit

_PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm")


@click.command("camera")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--shape", nargs=2, type=click.IntRange(min=1), help="Rows and columns of the camera."
)
@click.option("--variable", help="Array to take from a .mat or .npz file that holds several.")
@click.option(
    "--mm-per-unit",
    type=float,
    default=1.0,
    show_default=True,
    help="Size of the file's unit of length, mm (1000 for metres).",
)
@click.option(
    "--corners",
    nargs=2,
    type=click.IntRange(min=2),
    help="Inner corners per row and per column of the chessboard in the pictures.",
)
@click.option("--square-mm", type=float, help="Side of one square of the board, mm.")
@click.option("--focal-length-px", type=float, help="Focal length over pixel pitch, where known.")
@click.option(
    "--no-distortion", is_flag=True, help="Hold the lens's distortion at zero (points only)."
)
@click.option("--pixel-std-px", type=float, help="Error of one pixel coordinate, where known.")
@output_option(
    "Set-up file (.toml) with the [camera] found: for --lab, or to be named in one by "
    "[camera] file."
)
@json_option
@debug_option
def command(
    *,
    files: tuple[Path, ...],
    shape: tuple[int, int] | None,
    variable: str | None,
    mm_per_unit: float,
    corners: tuple[int, int] | None,
    square_mm: float | None,
    focal_length_px: float | None,
    no_distortion: bool,
    pixel_std_px: float | None,
    output: Path,
    as_json: bool,
) -> None:
    """Find where the camera stands, and its lens, with their errors.

    FILES is a table of points and the pixels that saw them, or pictures of a chessboard taken
    through the lens. A table is a .csv with columns x_mm, y_mm, z_mm, row, col; a .npz with
    points_mm (n, 3) and pixels (n, 2); or a .mat or .npz with one array (2 or 3, rows, cols) that
    says where each pixel looks. The first picture's board is the world's plane z = 0.

    \b
    Examples:
      lightflight calibrate camera points.csv --shape 32 32 -o camera.toml
      lightflight calibrate camera pointing.mat --variable coords --mm-per-unit 1000 -o camera.toml
      lightflight calibrate camera board*.png --corners 7 5 --square-mm 20 -o camera.toml
    """
    _check_output(output, files)
    pictures = [path.suffix.lower() in _PICTURES for path in files]
    if all(pictures):
        if corners is None or square_mm is None:
            raise click.UsageError("pictures of a board need --corners and --square-mm")
        if focal_length_px is not None or no_distortion:
            raise click.UsageError("--focal-length-px and --no-distortion are for tables of points")
        fit = _fit_from_pictures(files, corners, square_mm, pixel_std_px)
    elif len(files) > 1:
        raise click.UsageError("give one table of points, or pictures of a board")
    else:
        from lightflight.camera.calibration import fit_camera
        from lightflight.formats.point_tables import points_from_file

        points, seen, found_shape = points_from_file(files[0], variable=variable)
        shape = shape or found_shape
        if shape is None:
            raise click.UsageError("the table does not say how many pixels there are: give --shape")
        with step("fitting the camera"):
            fit = fit_camera(
                points * mm_per_unit, seen, shape, focal_length_px=focal_length_px,
                distortion=not no_distortion, pixel_std_px=pixel_std_px,
            )  # fmt: skip
    _write(fit, output)
    facts = camera_facts(fit)
    notes = camera_sentences(fit)
    report(facts, notes, as_json=as_json, title="Camera", written=[output], notes=notes)


def _check_output(output: Path, files: tuple[Path, ...]) -> None:
    """Refuse, before any work, a set-up file that is somebody's own work, or an input."""
    if output.suffix.lower() != ".toml":
        raise click.UsageError(f"-o {output}: the name must end in .toml")
    if not output.parent.is_dir():
        raise click.UsageError(f"-o {output}: make the folder {output.parent} first")
    if any(path.exists() and output.exists() and output.samefile(path) for path in files):
        raise click.UsageError(f"-o {output}: is an input too, choose another name")
    if output.exists() and not _is_ours(output):
        raise click.UsageError(
            f"-o {output}: exists and is no earlier result of this command, choose another name"
        )


def _is_ours(output: Path) -> bool:
    """Whether this command wrote the file, which may be anything: a pipe, or larger than memory."""
    if not output.is_file():
        return False
    with output.open("rb") as file:
        return file.read(len(_MARK)) == _MARK.encode()


def _fit_from_pictures(
    files: tuple[Path, ...], corners: tuple[int, int], square_mm: float, std_px: float | None
) -> CameraFit:
    """Camera and lens from pictures of a chessboard."""
    from lightflight.camera.boards import calibrate_camera_from_boards
    from lightflight.formats.point_tables import picture_from_file

    images = [picture_from_file(path) for path in files]
    with step("looking for boards"):
        return calibrate_camera_from_boards(
            images, corners=corners, square_mm=square_mm, pixel_std_px=std_px
        )


_MARK = "# Camera found by `lightflight calibrate camera`"
"""First line of what this command writes, by which it knows what it may replace."""


def _write(fit: CameraFit, output: Path) -> None:
    """Write [camera] as a set-up file; its first line marks it as ours to replace."""
    from lightflight.lab import toml_from_camera

    sentences = "".join(f"# {text}\n" for text in camera_sentences(fit))
    text = f"{_MARK}\n{sentences}\n{toml_from_camera(fit.camera)}"
    with writing(output), atomic_path(output) as fresh:
        fresh.write_text(text, encoding="utf-8")


def camera_facts(fit: CameraFit) -> list[Fact]:
    """What a camera calibration found.

    Parameters
    ----------
    fit : CameraFit
        Camera, lens and residuals.

    Returns
    -------
    list of Fact
        Place (mm), rotation (deg), lens and residual (px), with their one-sigma errors.
    """
    import numpy as np

    camera = fit.camera
    std = np.sqrt(np.diag(camera.pose_covariance)) if camera.pose_covariance is not None else None
    place = camera.center_mm

    def listed(values: Iterable[float], digits: int) -> str:
        return ", ".join(f"{value:.{digits}f}" for value in values)

    rows, cols = camera.shape
    facts = [
        Fact("pixels (rows x cols)", "shape", camera.shape, f"{rows} x {cols}"),
        Fact("entrance pupil", "center_mm", place.tolist(), f"({listed(place, 3)}) mm"),
    ]
    if std is not None:
        turn = np.rad2deg(std[:3])
        facts += [
            Fact("its error", "center_std_mm", std[3:].tolist(), f"({listed(std[3:], 3)}) mm"),
            Fact("error of the rotation", "rotation_std_deg", turn.tolist(),
                 f"({listed(turn, 4)}) deg"),
        ]  # fmt: skip
    focal = float(camera.matrix[0, 0])
    focal_std = focal * fit.lens_std["log_focal_length"]
    facts.append(
        Fact("focal length", "focal_length_px", focal, f"{focal:.2f} \u00b1 {focal_std:.2f} px")
    )
    facts += [
        Fact(f"distortion {name}", name, fit.lens[name],
             f"{fit.lens[name]:.4f} \u00b1 {fit.lens_std[name]:.4f}")
        for name in ("k1", "k2")
    ]  # fmt: skip
    rms = float(np.sqrt(np.nanmean(fit.residuals_px**2)))
    facts.append(Fact("residual (rms)", "residual_px", rms, f"{rms:.3g} px"))
    return facts


def camera_sentences(fit: CameraFit) -> list[str]:
    """What the camera's error means for a path.

    Parameters
    ----------
    fit : CameraFit
        Camera, with or without a covariance of its pose.

    Returns
    -------
    list of str
        None where the error is not known.
    """
    import numpy as np

    covariance = fit.camera.pose_covariance
    if covariance is None:
        return []
    along = float(np.sqrt(fit.camera.backward_axis @ covariance[3:, 3:] @ fit.camera.backward_axis))
    if not math.isfinite(along):
        return []
    return [
        f"The pupil is known to {along:.2g} mm along the optical axis. Its error is shared by all "
        "pixels; with the source held fixed, each mm of it turns a leg by 0.28 deg."
    ]
