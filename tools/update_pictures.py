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
EXAMPLES = {"light_against_error": "example-light.png", "three_cameras": "example-cameras.png"}
FIBRE = {
    "LinearFiber.png": "tutorial-fibre-straight.png",
    "CurveFiber.png": "tutorial-fibre-curved.png",
}


def keep(file: Path, name: str) -> None:
    """Put a picture into docs/images, at most 1400 px wide, in 256 colours."""
    with Image.open(file) as picture:
        small = picture.convert("RGB")
    if small.width > WIDTH_PX:
        height = round(small.height * WIDTH_PX / small.width)
        small = small.resize((WIDTH_PX, height), Image.Resampling.LANCZOS)
    # Maximum coverage keeps the rare colours: a colour bar stays smooth.
    palette = small.quantize(
        256, method=Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE
    )
    palette.save(IMAGES / name, optimize=True)
    print(f"docs/images/{name}: {(IMAGES / name).stat().st_size / 1024:.0f} kB")


def run_example(name: str, *words: str) -> None:
    """Run a script of examples/ in the present folder."""
    subprocess.run([sys.executable, str(ROOT / "examples" / f"{name}.py"), *words], check=True)


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
        Page(DOCS / "how-to" / "light-out-of-the-picture.md").run()
        keep(Path("unseen.png"), "unseen-legs.png")
        Page(DOCS / "how-to" / "follow-split-light.md").run()
        keep(Path("split.png"), "split-light.png")
        for example, name in EXAMPLES.items():
            run_example(example, "-o", name)
            keep(Path(name), name)
        if args.fibre is not None:
            run_example("fibre_recordings", str((start / args.fibre).resolve()), "-o", ".")
            for made, name in FIBRE.items():
                keep(Path(made), name)
        os.chdir(start)


if __name__ == "__main__":
    main()
