"""How the gallery is built: which example comes first, and which figures its page shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

ORDER = (
    "first_path", "numpy_cube", "set_up_file", "clock_calibration", "estimators", "error_sources",
    "haze", "apparent_speed", "outrun_light", "laser_pulse", "photons", "limits", "two_cameras",
)  # fmt: skip
"""From a recording to a path, then what its light does, then before anything is recorded."""


class Order:
    """Sorting key of the examples: `ORDER`, and what is not in it at the end."""

    def __init__(self, src_dir: str) -> None:
        self.src_dir = src_dir

    def __call__(self, filename: str) -> int:
        """Place of a file of the gallery."""
        stem = Path(filename).stem
        return ORDER.index(stem) if stem in ORDER else len(ORDER)


def figures_of_block(block: object, variables: dict[str, Any], settings: dict[str, Any]) -> str:
    """Keep the figures that a block of an example made, and say so in reStructuredText.

    Figures of this package are made without pyplot, which is where sphinx-gallery would look.
    """
    names = variables["example_globals"]
    kept = names.setdefault("__figures_kept__", [])
    files = []
    for figure in [value for value in names.values() if isinstance(value, Figure)]:
        if any(figure is one for one in kept):
            continue
        file = next(variables["image_path_iterator"])
        # At 58 rem of text, 1400 px are two for each of a fine screen.
        figure.savefig(file, dpi=min(200.0, 1400.0 / figure.get_figwidth()))
        kept.append(figure)
        files.append(file)
    return str(figure_rst(files, settings["src_dir"]))
