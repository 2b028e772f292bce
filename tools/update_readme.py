"""Write the measured part of README.md: run the demo, put its table and its figure there.

    .venv/bin/python tools/update_readme.py            # runs the demo, rewrites the block
    .venv/bin/python tools/update_readme.py --check    # only says whether its blocks are there

No number between the two marks is ever typed by hand.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from blocks import with_block, write_block
from update_pictures import keep

from lightflight._version import __version__

REPOSITORY = Path(__file__).resolve().parents[1]
README = REPOSITORY / "README.md"


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
    date = datetime.now(UTC).date().isoformat()
    lines += ["", f"`lightflight demo`, {__version__}, seed {results['seed']}, {date}."]
    return "\n".join(lines)


def main() -> None:
    """Rewrite the block, or check that there is one."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="change nothing")
    text = README.read_text(encoding="utf-8")
    if parser.parse_args().check:
        for name in ("demo", "paper"):
            with_block(text, name, "")
        return
    with tempfile.TemporaryDirectory() as folder:
        results = demo_results(Path(folder))
        keep(Path(folder) / "demo.png", "demo.png")
    write_block(README, "demo", table_from_results(results))
    print(table_from_results(results))


if __name__ == "__main__":
    main()
