"""Megapixel recordings: photons sorted into tiles of rows, the pulses of each tile fitted alone.

A piece of the recording is read once and its photons are kept by tile (6 bytes each); a tile
counts its own and fits them; the path is then fitted to the pulses of all tiles and to the counts
of the pixels near them. No task holds the cube, and the work grows with photons plus pixels.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lightflight.batch.job import (
    BYTES_PER_MB,
    Job,
    keep_path,
    make_folder,
    read_recording,
    recording_of,
    task,
    timing_of,
)
from lightflight.batch.kept import is_kept, kept_arrays
from lightflight.batch.pieces import PartOfArray, bytes_of, photons_between, share_of
from lightflight.batch.warnings_said import caught_warnings
from lightflight.batch.window import TimingWindow
from lightflight.errors import ConfigError, FileFormatError, NothingFoundError
from lightflight.formats.photons import photon_blocks
from lightflight.lab import reconstruct_options
from lightflight.recording.clock_fields import clock_fields_of
from lightflight.recording.counting import histogram
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording, SlicedArray
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.code_clock import ClockWithoutCodes, CodeClock
from lightflight.timing.pulses.background import without_background_pulses

if TYPE_CHECKING:
    from lightflight.timing.pulses.arrivals import Arrivals

Indices = NDArray[np.int64]

SORTED_KIND, TILE_KIND = "sorted piece", "fitted tile"
PIECE_BYTES = 100 * BYTES_PER_MB
"""Most bytes of a recording whose photons are sorted at once."""

REACH_PX = 8
"""Pixels around a pulse whose counts the path fit may ask for."""

_BYTES_PER_COUNT = 4
_CHUNK = 1 << 22


@dataclass(frozen=True)
class Tiles:
    """How the rows of a camera are shared out.

    Attributes
    ----------
    rows, cols : int
        Of the camera.
    rows_per_tile : int
        The last tile may have fewer.
    """

    rows: int
    cols: int
    rows_per_tile: int

    @property
    def n(self) -> int:
        """Number of tiles."""
        return math.ceil(self.rows / self.rows_per_tile)

    def rows_of(self, tile: int) -> tuple[int, int]:
        """(start, end) of the rows of one tile."""
        start = tile * self.rows_per_tile
        return start, min(start + self.rows_per_tile, self.rows)


def tiles_of(recording: Recording, codes: tuple[int, int] | None, tile_bytes: float) -> Tiles:
    """Tiles of whole rows whose counts are no larger than `tile_bytes` (one row at least).

    Parameters
    ----------
    recording : Recording
        All of it.
    codes : (int, int) or None
        Codes that are kept, (start, end).
    tile_bytes : float
        Largest cube of counts, bytes.

    Returns
    -------
    Tiles
        Rows by tile.
    """
    rows, cols = recording.shape
    n_codes = recording.n_codes if codes is None else codes[1] - codes[0]
    per_row = cols * n_codes * _BYTES_PER_COUNT
    return Tiles(rows, cols, min(rows, max(1, int(tile_bytes // per_row))))


def n_tiles_of(recording: Recording, codes: tuple[int, int] | None, tile_bytes: float) -> int:
    """Tiles a recording is fitted in; 1: its counts are small enough for one task.

    Parameters
    ----------
    recording, codes, tile_bytes
        As for `tiles_of`.

    Returns
    -------
    int
        One or more.
    """
    return tiles_of(recording, codes, tile_bytes).n


def n_sorted_pieces_of(recording: Recording, piece_bytes: float) -> int:
    """Pieces whose photons are sorted one by one.

    Parameters
    ----------
    recording : Recording
        All of it.
    piece_bytes : float
        Longest piece, bytes; `PIECE_BYTES` at most.

    Returns
    -------
    int
        One or more.
    """
    length = _photon_axis(recording).shape[0]
    wanted = math.ceil(bytes_of(recording) / min(piece_bytes, PIECE_BYTES))
    return max(1, min(wanted, length))


def _photon_axis(recording: Recording) -> SlicedArray:
    """The array along which a recording is cut."""
    array = recording.frames if recording.frames is not None else recording.pixel
    assert array is not None
    return array


def check_tiles(job: Job) -> None:
    """Refuse a method that needs all counts at once.

    Parameters
    ----------
    job : Job
        The recording.

    Raises
    ------
    ConfigError
        For any method but joint.
    """
    method = job.lab.reconstruct.get("method", "joint")
    if method != "joint":
        raise ConfigError(
            f"method {method!r} does not work in tiles: use joint, keep fewer codes, or raise "
            "tile_megabytes"
        )


# --- tasks -----------------------------------------------------------------------------------


@task
def sort_piece(job: Job, index: int, n_pieces: int) -> str:
    """Keep the photons of one piece by tile, unless an earlier run did.

    Parameters
    ----------
    job : Job
        The recording.
    index, n_pieces : int
        Which piece, of how many.

    Returns
    -------
    str
        The file.
    """
    from lightflight.files.store import new_record

    file = Path(job.parts) / f"sorted-{index:05d}-of-{n_pieces:05d}.h5"
    if is_kept(file, SORTED_KIND, job.key):
        return str(file)
    recording = recording_of(job)
    tiles = tiles_of(recording, job.codes, job.tile_bytes)
    pixel, code, starts = _sorted_photons(_photons_of(recording, index, n_pieces), job, tiles)
    make_folder(file.parent)
    with new_record(file, kind=SORTED_KIND, attributes={"key": job.key}) as out:
        out.write("starts", starts)
        out.append("pixel", pixel)
        out.append("code", code)
    return str(file)


def _photons_of(recording: Recording, index: int, n_pieces: int) -> Recording:
    """One piece: a run of frames, or of photons."""
    length = _photon_axis(recording).shape[0]
    part = share_of(length, index, n_pieces)
    if recording.frames is not None:
        return replace(recording, frames=PartOfArray(recording.frames, *part), n_frames=None)
    return photons_between(recording, *part)


def _sorted_photons(
    piece: Recording, job: Job, tiles: Tiles
) -> tuple[NDArray[np.uint32], NDArray[np.uint16], NDArray[np.int64]]:
    """Pixel within its tile and kept code of each photon, tile by tile, and where each starts."""
    first, end = (0, piece.n_codes) if job.codes is None else job.codes
    pixels, codes = [], []
    for block in photon_blocks(piece):
        _check_photons(block.pixel, block.code, piece, job)
        kept = (block.code >= first) & (block.code < end)
        if piece.no_photon_code is not None:
            kept &= block.code != piece.no_photon_code
        pixels.append(block.pixel[kept].astype(np.uint32))
        codes.append((block.code[kept] - first).astype(np.uint16))
    pixel = np.concatenate(pixels) if pixels else np.empty(0, np.uint32)
    code = np.concatenate(codes) if codes else np.empty(0, np.uint16)
    per_tile = np.uint32(tiles.rows_per_tile * tiles.cols)
    tile = (pixel // per_tile).astype(np.uint16)
    # 16 bits are sorted by radix: the time is linear in the photons.
    order = np.argsort(tile, kind="stable")
    starts = np.zeros(tiles.n + 1, np.int64)
    np.cumsum(np.bincount(tile, minlength=tiles.n), out=starts[1:])
    return (pixel - tile * per_tile)[order], code[order], starts


def _check_photons(
    pixel: NDArray[np.integer], code: NDArray[np.integer], recording: Recording, job: Job
) -> None:
    """Raise FileFormatError for a pixel or a code that the camera does not have."""
    n_pixels = recording.shape[0] * recording.shape[1]
    bad = (pixel >= n_pixels) | (code >= recording.n_codes)
    if bad.any():
        first = int(np.argmax(bad))
        raise FileFormatError(
            f"a photon is of pixel {pixel[first]} and code {code[first]}, but the recording has "
            f"{n_pixels} pixels and {recording.n_codes} codes: the file is damaged",
            path=job.recording,
        )


@task
def fit_pulses_of_tile(job: Job, tile: int, *pieces: str) -> str:
    """Fit the pulses of one tile into a file, unless an earlier run did.

    Parameters
    ----------
    job : Job
        The recording.
    tile : int
        Which tile.
    *pieces : str
        Files of `sort_piece`.

    Returns
    -------
    str
        The file.
    """
    from lightflight.files.store import save_record

    recording = recording_of(job)
    tiles = tiles_of(recording, job.codes, job.tile_bytes)
    file = Path(job.parts) / f"tile-{tile:05d}-of-{tiles.n:05d}.h5"
    if is_kept(file, TILE_KIND, job.key):
        return str(file)
    rows = tiles.rows_of(tile)
    hist = _tile_histograms(recording, job, rows, _joined(pieces, tile))
    arrays = _pulses_of_tile(job, hist, rows)
    save_record(file, kind=TILE_KIND, arrays=arrays, attributes={"key": job.key})
    return str(file)


def _tile_histograms(
    recording: Recording,
    job: Job,
    rows: tuple[int, int],
    photons: tuple[SlicedArray, SlicedArray],
) -> Histograms:
    """Counts of one tile, as `histogram` with windows gives them for the whole recording."""
    empty = _empty_window(recording, job.codes)
    tile = Recording(
        (rows[1] - rows[0], recording.shape[1]),
        n_codes=empty.n_codes,
        pixel=photons[0],
        code=photons[1],
        settings=empty.settings,
        **{**clock_fields_of(empty), "n_frames": recording.n_frames},
    )
    return histogram(tile)


def _empty_window(recording: Recording, codes: tuple[int, int] | None) -> Histograms:
    """One pixel without photons, with clock and settings of the window."""
    nothing = np.empty(0, np.uint16)
    bare = Recording(
        (1, 1),
        n_codes=recording.n_codes,
        pixel=nothing,
        code=nothing,
        settings=recording.settings,
        **{**clock_fields_of(recording), "n_frames": None},
    )
    return histogram(bare, codes=codes)


def _pulses_of_tile(
    job: Job, hist: Histograms, rows: tuple[int, int]
) -> dict[str, NDArray[np.generic]]:
    """Columns of the pulses that were found, and pixels that tell nothing."""
    from lightflight.reconstruct.model.sighting import blind_pixels
    from lightflight.timing.pulses.arrivals import find_arrivals

    timing: CodeClock
    if job.timing is None:
        timing = TimingCalibration.nominal(hist)
    else:
        timing = TimingWindow.of(timing_of(job), rows=rows, codes=job.codes)
        timing.check_matches(hist)
    background = None
    if job.background is not None:
        background = histogram(read_recording(job.background, job.lab), rows=rows, codes=job.codes)
    cut: dict[str, NDArray[np.generic]] = {}
    if background is not None:
        without = without_background_pulses(hist, background, timing, response=timing.response)
        if without is not None:
            hist, background, timing = without.emptied(hist), without.emptied(background), without
            pixel, code = without.codes
            cut = {"cut_pixel": pixel + rows[0] * hist.shape[1], "cut_code": code}
    if not hist.photons.any():  # dark is a fact: these pixels saw nothing
        return {"blind": ~timing.is_known, **cut}
    try:
        arrivals = find_arrivals(hist, timing=timing, background=background, response="clock")
    except NothingFoundError:  # hot pixels alone
        return {"blind": np.ones(hist.shape, dtype=bool), **cut}
    # A pixel without a pulse is a row of NaN: most of a megapixel, and nothing to keep.
    found = np.isfinite(arrivals.arrival_ps)
    columns = {name: getattr(arrivals, name)[found] for name in _COLUMNS}
    columns["row"] = columns["row"] + np.int32(rows[0])
    names = np.array(list(arrivals.shared_names), dtype=np.str_)
    return {**columns, **cut, "blind": blind_pixels(arrivals, timing), "shared_names": names}


_COLUMNS = (
    "row", "col", "arrival_ps", "photon_std_ps", "pixel_std_ps", "shared_modes_ps", "std_ps",
    "std_error_ps", "photons", "photons_std", "background_per_ps", "chi2", "dof", "flags",
    "pulse_index",
)  # fmt: skip


@task
def finish_tiles(job: Job, pieces: Sequence[str], tiles_files: Sequence[str]) -> None:
    """Reconstruct the path from the pulses of all tiles.

    Parameters
    ----------
    job : Job
        The recording.
    pieces : sequence of str
        Files of `sort_piece`, for the counts near the pulses.
    tiles_files : sequence of str
        Files of `fit_pulses_of_tile`, in the order of the tiles.
    """
    from lightflight.reconstruct.from_arrivals import path_from_arrivals

    recording = recording_of(job)
    tiles = tiles_of(recording, job.codes, job.tile_bytes)
    tables = [kept_arrays(Path(file), TILE_KIND, job.key) for file in tiles_files]
    arrivals, blind = _all_pulses(recording, tables)
    near = pixels_near(arrivals.row[arrivals.usable], arrivals.col[arrivals.usable], blind.shape)
    lost = _lost_codes(tables)
    hist = _counts_near(recording, job, tiles, pieces, near, lost)
    timing: CodeClock | None = None
    if job.timing is not None:
        timing = TimingWindow.of(timing_of(job), codes=job.codes)
    if len(lost[0]):
        whole = TimingCalibration.nominal(hist) if timing is None else timing
        timing = ClockWithoutCodes.of(whole, *lost, hist.n_codes)
    with caught_warnings() as said:
        options = reconstruct_options(job.lab)
        options.pop("method", None)  # `check_tiles` has seen to it that it is joint
        # Pixels that are not near hold no counts here, which must not be taken for darkness.
        path = path_from_arrivals(
            hist, arrivals, blind=blind | ~near, camera=job.lab.camera, source=job.lab.source,
            medium=job.lab.medium, timing=timing, **options,
        )  # fmt: skip
    keep_path(job, path, said)


def _all_pulses(
    recording: Recording, tables: Sequence[Mapping[str, NDArray[Any]]]
) -> tuple[Arrivals, NDArray[np.bool_]]:
    """Pulses of all tiles as one table, and the pixels (rows, cols) that tell nothing."""
    from lightflight.timing.pulses.arrivals import Arrivals

    blind = np.concatenate([table["blind"] for table in tables])
    lit = [table for table in tables if "row" in table]
    if not lit:
        raise NothingFoundError("no pixel shows a pulse: every tile is dark or hot")
    columns = {name: np.concatenate([table[name] for table in lit]) for name in _COLUMNS}
    return (
        Arrivals(
            **columns,
            shared_names=tuple(_text(name) for name in lit[0]["shared_names"]),
            shape=recording.shape,
            laser_period_ps=recording.laser_period_ps,
            method="likelihood",
        ),
        blind,
    )


def _lost_codes(tables: Sequence[Mapping[str, NDArray[Any]]]) -> tuple[Indices, Indices]:
    """Pixel and code, (n,) each, of those where tiles found pulses of the background."""
    none = np.zeros(0, dtype=np.int64)
    pixel, code = (
        np.concatenate([none, *(t[name] for t in tables if name in t)])
        for name in ("cut_pixel", "cut_code")
    )
    return pixel, code


def _text(value: object) -> str:
    """Text from an array that went through HDF5, as bytes or not."""
    return value.decode("utf-8") if isinstance(value, bytes) else str(value)


def pixels_near(
    rows: NDArray[np.generic], cols: NDArray[np.generic], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """Pixels within `REACH_PX` of any of some pixels, along either axis.

    Parameters
    ----------
    rows, cols : array of int, shape (n,)
        The pixels.
    shape : (int, int)
        Rows and columns of the camera.

    Returns
    -------
    array of bool, shape (rows, cols)
        True near one.
    """
    from scipy.ndimage import maximum_filter

    mask = np.zeros(shape, dtype=np.uint8)
    mask[rows, cols] = 1
    return np.asarray(maximum_filter(mask, 2 * REACH_PX + 1, mode="constant"), dtype=bool)


def _counts_near(
    recording: Recording,
    job: Job,
    tiles: Tiles,
    pieces: Sequence[str],
    near: NDArray[np.bool_],
    lost: tuple[Indices, Indices],
) -> Histograms:
    """Histograms of the whole camera that hold the counts of the pixels `near`, and no others.

    Codes that are `lost` (pixel, code) hold none.
    Memory that is never written to is not taken: the cube costs what the pixels cost.
    """
    empty = _empty_window(recording, job.codes)
    counts = np.zeros((*recording.shape, empty.n_codes), np.uint32)
    for tile in range(tiles.n):
        first, end = tiles.rows_of(tile)
        wanted = near[first:end].ravel()
        if not wanted.any():
            continue
        # A view on these rows, so that what is added stands in the cube.
        flat = counts[first:end].reshape(-1)
        pixel, code = _joined(pieces, tile)
        for start in range(0, pixel.shape[0], _CHUNK):
            pixels = np.asarray(pixel[start : start + _CHUNK])
            kept = wanted[pixels]
            index = (
                pixels[kept].astype(np.int64) * empty.n_codes + code[start : start + _CHUNK][kept]
            )
            np.add.at(flat, index, 1)
    pixel, code = (one[near.ravel()[lost[0]]] for one in lost)
    counts.reshape(-1, empty.n_codes)[pixel, code] = 0
    counts.setflags(write=False)
    return replace(empty, counts=counts, n_frames=recording.n_frames, truth=recording.truth)


# --- files between tasks ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Joined:
    """Several lists as one, read in parts."""

    parts: tuple[SlicedArray, ...]

    @property
    def shape(self) -> tuple[int, ...]:
        return (sum(part.shape[0] for part in self.parts),)

    @property
    def dtype(self) -> np.dtype[np.generic]:
        return self.parts[0].dtype

    def __getitem__(self, key: slice) -> NDArray[np.generic]:
        start, end, _ = key.indices(self.shape[0])
        found = []
        for part in self.parts:
            length = part.shape[0]
            if start < length and end > 0:
                found.append(np.asarray(part[max(start, 0) : min(end, length)]))
            start, end = start - length, end - length
        return np.concatenate(found) if found else np.empty(0, self.dtype)


def _joined(pieces: Sequence[str], tile: int) -> tuple[SlicedArray, SlicedArray]:
    """Pixel and code of all photons of one tile."""
    from lightflight.files.store import open_record
    from lightflight.formats.stored import StoredArray

    pixels: list[SlicedArray] = []
    codes: list[SlicedArray] = []
    for piece in pieces:
        with open_record(piece, kind=SORTED_KIND) as (file, _):
            start, end = (int(edge) for edge in file["starts"][tile : tile + 2])
            pixels.append(PartOfArray(StoredArray.of(file["pixel"], path=piece), start, end))
            codes.append(PartOfArray(StoredArray.of(file["code"], path=piece), start, end))
    return _Joined(tuple(pixels)), _Joined(tuple(codes))
