"""A figure of which most stands still: that is drawn once, the rest anew in every frame."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lightflight.view import style
from lightflight.view.film.encode import Frame


class Stage:
    """The figure of a film, of so many pixels; what moves in it is drawn with `animated=True`."""

    def __init__(self, size_px: tuple[int, int], *, inches_wide: float) -> None:
        width, height = size_px
        wide_mm = style.MM_PER_INCH * inches_wide
        self.figure = style.new_figure(wide_mm, wide_mm * height / width)
        self.figure.set_dpi(width / inches_wide)
        self.canvas: Any = self.figure.canvas  # what Agg adds to a canvas carries no types

    def keep_background(self) -> None:
        """Draw what stands still, and remember its pixels: text and grids cost most of a frame."""
        self.canvas.draw()
        self.background = self.canvas.copy_from_bbox(self.figure.bbox)

    def keep_all_but(self, axes: Axes) -> None:
        """Draw what stands still while `axes` turn, and remember its pixels."""
        axes.set_visible(False)
        self.canvas.draw()
        axes.set_visible(True)
        self.still = self.canvas.copy_from_bbox(self.figure.bbox)

    def renew(self, axes: Axes) -> None:
        """Draw `axes` over what `keep_all_but` kept, as the background of frames to come."""
        self.canvas.restore_region(self.still)
        self.figure.draw_artist(axes)
        self.background = self.canvas.copy_from_bbox(self.figure.bbox)

    def snapshot(self, moving: Iterable[tuple[Axes | Figure, Artist]]) -> Frame:
        """A frame (height, width, 3), uint8: the background and these over it, in their order."""
        self.canvas.restore_region(self.background)
        for place, artist in moving:
            place.draw_artist(artist)
        return np.asarray(self.canvas.buffer_rgba())[..., :3].copy()
