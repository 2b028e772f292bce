"""Frames into a film: MP4 (encoder from the `view` extra) or GIF, whole or not at all.

Or as they are: numbered pictures in a folder.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from lightflight.errors import optional_package
from lightflight.files.whole_file import atomic_path
from lightflight.view.suffixes import MOVIE_SUFFIXES
from lightflight.view.types import FilePath

Frame = NDArray[np.uint8]
Progress = Callable[[int, int], None]

SMALLEST_PX, LARGEST_PX = 160, 7680
_MOST_FRAMES = 10_000
"""Minutes of drawing, and of film; what times in a file ask for has no end."""


def check_movie(file: FilePath, *, size_px: tuple[int, int], frames_per_second: float) -> None:
    """Refuse a film that cannot be made, before any frame is drawn.

    Parameters
    ----------
    file : path
        Where to write.
    size_px : (int, int)
        Width and height of a frame, px; even.
    frames_per_second : float
        Of the film.

    Raises
    ------
    ValueError
        For an unknown suffix, an odd, tiny or huge size, or a frame rate that is not positive.
    MissingExtraError
        For MP4 without imageio-ffmpeg.
    """
    suffix = Path(file).suffix.lower()
    if suffix not in MOVIE_SUFFIXES:
        raise ValueError(
            f"cannot write a movie to {Path(file).name}: its name must end in .mp4 or .gif"
        )
    width, height = size_px
    for name, value in (("width", width), ("height", height)):
        if not SMALLEST_PX <= value <= LARGEST_PX or value % 2:
            raise ValueError(
                f"the {name} of a movie must be even and from {SMALLEST_PX} to {LARGEST_PX} px, "
                f"got {value}"
            )
    if not 1.0 <= frames_per_second <= 120.0:
        raise ValueError(f"frames_per_second must be 1 to 120, got {frames_per_second:g}")
    # Asked for now: drawing takes minutes, and would end in the error.
    if suffix == ".mp4":
        _encoder()


def check_length(n_frames: float, *, shorter: str) -> None:
    """Refuse a film without end, before any frame is drawn.

    Parameters
    ----------
    n_frames : float
        How many frames it would have; may be infinite.
    shorter : str
        What makes it shorter, for the message.

    Raises
    ------
    ValueError
        For more than ten thousand frames.
    """
    if not n_frames <= _MOST_FRAMES:
        raise ValueError(
            f"the film would have {n_frames:.3g} frames, more than {_MOST_FRAMES}: give {shorter}"
        )


def _encoder() -> ModuleType:
    return optional_package(
        "imageio_ffmpeg",
        "MP4 needs imageio-ffmpeg, which is not installed: "
        'pip install "lightflight[view]", or write a .gif',
    )


def write_frames(
    frames: Iterable[Frame],
    file: FilePath,
    *,
    n_frames: int,
    size_px: tuple[int, int],
    frames_per_second: float,
    progress: Progress | None = None,
) -> None:
    """Encode frames (height, width, 3) as the suffix of `file` says.

    Parameters
    ----------
    frames : iterable of arrays
        Pictures (height, width, 3).
    file : path
        Where to write.
    n_frames : int
        How many will come, for `progress(done, in all)`.
    size_px : (int, int)
        Width and height, px; even.
    frames_per_second : float
        Of the film.
    progress : callable, optional
        Called with (frames done, in all).
    """
    check_movie(file, size_px=size_px, frames_per_second=frames_per_second)
    told = _telling(frames, n_frames, progress)
    with atomic_path(file) as fresh:
        if Path(file).suffix.lower() == ".gif":
            _write_gif(told, fresh, frames_per_second)
        else:
            _write_mp4(told, fresh, size_px, frames_per_second)


def _telling(frames: Iterable[Frame], n_frames: int, progress: Progress | None) -> Iterator[Frame]:
    for k, frame in enumerate(frames):
        yield frame
        if progress is not None:
            progress(k + 1, n_frames)


def _write_mp4(
    frames: Iterable[Frame], file: Path, size_px: tuple[int, int], frames_per_second: float
) -> None:
    writer = _encoder().write_frames(
        str(file),
        size_px,
        fps=frames_per_second,
        codec="libx264",
        quality=None,
        macro_block_size=2,
        ffmpeg_log_level="error",
        # crf 18: no visible loss on thin lines; faststart: plays while it downloads.
        output_params=["-crf", "18", "-preset", "medium", "-movflags", "+faststart"],
    )
    # A generator must be started before it takes a frame.
    writer.send(None)
    try:
        for frame in frames:
            writer.send(np.ascontiguousarray(frame))
    finally:
        writer.close()


def _write_gif(frames: Iterable[Frame], file: Path, frames_per_second: float) -> None:
    from PIL import Image

    pictures = iter(frames)
    first = Image.fromarray(next(pictures))
    # One palette for all frames, so that colours do not flicker; ramps of the colours that only
    # later frames hold are shown to it too.
    palette = Image.fromarray(np.vstack((np.asarray(first), _ramps(first.width)))).quantize(
        255, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE
    )

    def reduced() -> Iterator[Image.Image]:
        for frame in pictures:
            picture = Image.fromarray(frame)
            yield picture.quantize(palette=palette, dither=Image.Dither.NONE)

    first.quantize(palette=palette, dither=Image.Dither.NONE).save(
        file,
        format="GIF",
        save_all=True,
        append_images=reduced(),
        # Browsers slow down GIFs whose frames last less than 20 ms.
        duration=max(20, round(1000.0 / frames_per_second)),
        loop=0,
        optimize=False,
    )


def _ramps(width: int) -> Frame:
    """Strips (96, width, 3) of the colours of pulses and counts, from faint to full."""
    from lightflight.view import style

    along = np.linspace(0.0, 1.0, width)
    strips = [style.count_colormap()(along)[:, :3], style.time_colormap()(along)[:, :3]]
    white = np.ones(3)
    for color in (style.EVENT, style.ARRIVAL):
        full = np.array([int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)])
        strips.append(white + along[:, np.newaxis] * (full - white))
    rows = np.repeat(np.stack(strips), 24, axis=0)
    return np.asarray(np.rint(255 * rows), dtype=np.uint8)
