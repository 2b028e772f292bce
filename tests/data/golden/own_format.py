"""A file format of your own: read it, and let `lightflight` read it everywhere.

    python examples/own_format.py -o out/own.h5

The format here is a made-up text file: a line with rows, columns and ps per bin, then one line of
counts per pixel. A package that ships such a reader names it in its `pyproject.toml`:

    [project.entry-points."lightflight.formats"]
    lab-text = "my_package.own_format:FORMAT"

Then `lightflight info my.labtext`, `lf.read` and all commands know it.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import lightflight as lf
from lightflight.formats.registry import Format

HEADER = "# my lab"


def read_lab_text(path: Path, clock: Mapping[str, Any]) -> lf.Histograms:
    """Histograms from a text file; what `clock` says stands over the file."""
    with path.open(encoding="utf-8") as lines:
        next(lines)
        rows, cols, width = next(lines).split()
        counts = np.loadtxt(lines, dtype=np.int64)
    cube = counts.reshape(int(rows), int(cols), -1)
    return lf.Histograms(cube, **{"bin_width_ps": float(width), **clock})


def write_lab_text(hist: lf.Histograms, path: str | os.PathLike[str]) -> None:
    """The file that `read_lab_text` reads."""
    rows, cols = hist.shape
    head = f"{HEADER[2:]}\n{rows} {cols} {hist.bin_width_ps}"
    text = hist.counts.reshape(rows * cols, -1)
    with Path(path).open("w", encoding="utf-8") as out:
        out.write(f"# {head}\n")
        np.savetxt(out, text, fmt="%d")


FORMAT = Format(
    name="lab-text",
    summary="text histograms of my lab",
    suffixes=(".labtext",),
    matches=lambda path, start: start.startswith(HEADER.encode()),
    read=read_lab_text,
)


def main() -> None:
    """Write such a file, read it, and keep it in lightflight's own format."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/own.h5"))
    args = parser.parse_args()
    args.output.parent.mkdir(parents=True, exist_ok=True)

    made = lf.Histograms(np.random.default_rng(1).poisson(4.0, (3, 4, 50)), bin_width_ps=50.0)
    text = args.output.with_suffix(".labtext")
    write_lab_text(made, text)
    hist = FORMAT.read(text, {"laser_period_ps": 2500.0})
    print(f"{hist.shape[0]} x {hist.shape[1]} pixels, {int(hist.photons.sum())} photons")
    lf.write(hist, args.output)


if __name__ == "__main__":
    main()
