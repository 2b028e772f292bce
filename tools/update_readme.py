"""Write the measured part of README.md: run the demo, put its table and its figure there.

    .venv/bin/python tools/update_readme.py            # runs the demo, rewrites the block
    .venv/bin/python tools/update_readme.py --check    # only says whether the block is there

No number between the two marks is ever typed by hand.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
README = REPOSITORY / "README.md"
PICTURE = REPOSITORY / "docs" / "images" / "demo.png"
BEGIN, END = "<!-- demo:begin (tools/update_readme.py) -->", "<!-- demo:end -->"
PICTURE_WIDTH_PX = 1400


def demo_results(folder: Path) -> dict[str, Any]:
    """Run the demo in a process of its own; its JSON."""
    done = subprocess.run(
        [sys.executable, "-m", "lightflight", "demo", "-o", str(folder), "--json"],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    results: dict[str, Any] = json.loads(done.stdout)
    return results


def table_from_results(results: dict[str, Any]) -> str:
    """Markdown table of the demo's rows."""

    def cell(value: float | None, digits: str) -> str:
        return "not stated" if value is None else format(value, digits)

    lines = [
        "| result | prior | photons per pixel | position, rms | time, rms |",
        "|---|---|---:|---:|---:|",
    ]
    lines += [
        f"| {row['result']} | {row['prior']} | {cell(row['photons_per_pixel'], ',.0f')} "
        f"| {cell(row['position_rms_mm'], '.2f')} mm | {cell(row['event_time_rms_ps'], '.2f')} ps |"
        for row in results["rows"]
    ]
    return "\n".join(lines)


def with_block(text: str, block: str) -> str:
    """README text with the block between the marks replaced."""
    before, _, rest = text.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise SystemExit(f"README.md has no block between {BEGIN} and {END}")
    return f"{before}{BEGIN}\n{block}\n{END}{after}"


def save_picture(source: Path) -> None:
    """Put the demo's figure, smaller, where the README shows it."""
    from PIL import Image

    with Image.open(source) as picture:
        height = round(picture.height * PICTURE_WIDTH_PX / picture.width)
        small = picture.convert("RGB").resize((PICTURE_WIDTH_PX, height), Image.Resampling.LANCZOS)
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    palette = small.quantize(
        256, method=Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE
    )
    palette.save(PICTURE, optimize=True)


def main() -> None:
    """Rewrite the block, or check that there is one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing")
    text = README.read_text(encoding="utf-8")
    if parser.parse_args().check:
        with_block(text, "")
        return
    with tempfile.TemporaryDirectory() as folder:
        results = demo_results(Path(folder))
        save_picture(Path(folder) / "demo.png")
    README.write_text(with_block(text, table_from_results(results)), encoding="utf-8")
    print(table_from_results(results))


if __name__ == "__main__":
    main()
