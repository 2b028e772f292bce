"""Draw the pictures of the documentation: docs/images, from the pages and from docs/figures.

    .venv/bin/python tools/update_pictures.py                          # all but the fibre's
    .venv/bin/python tools/update_pictures.py --fibre lift_derived.h5  # those too

The tutorial is followed in a temporary folder and its pictures are taken from there; the schemes
of the explanation are drawn by the functions of `tools/schemes.py`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
WIDTH_PX = 1400

TUTORIAL = {
    "clock.png": "tutorial-clock.png",
    "path.png": "tutorial-path.png",
    "two-clocks.png": "tutorial-times.png",
}
FIBRE = {
    "LinearFiber.png": "tutorial-fibre-straight.png",
    "CurveFiber.png": "tutorial-fibre-curved.png",
}


def keep(file: Path, name: str) -> None:
    """Put a picture into docs/images, at most 1400 px wide, in 128 colours."""
    with Image.open(file) as picture:
        small = picture.convert("RGB")
    if small.width > WIDTH_PX:
        height = round(small.height * WIDTH_PX / small.width)
        small = small.resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
    small.quantize(128).save(IMAGES / name, optimize=True)
    print(f"docs/images/{name}: {(IMAGES / name).stat().st_size / 1024:.0f} kB")


def main() -> None:
    """Draw everything."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--fibre", type=Path, help="lift_derived.h5")
    args = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    from tests.docs.pages import DOCS, Page
    from tools.schemes import SCHEMES

    start = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name, draw in SCHEMES.items():
            draw().savefig(f"{name}.png", dpi=160)
            keep(Path(f"{name}.png"), f"{name}.png")
        Page(DOCS / "tutorial" / "first-path.md").run()
        for made, name in TUTORIAL.items():
            keep(Path(made), name)
        if args.fibre is not None:
            script = str(ROOT / "examples" / "fibre_recordings.py")
            file = str((start / args.fibre).resolve())
            subprocess.run([sys.executable, script, file, "-o", "."], check=True)
            for made, name in FIBRE.items():
                keep(Path(made), name)
        os.chdir(start)


if __name__ == "__main__":
    main()
