"""Write the measured parts of docs/explanation/paper.md and README.md from the paper's experiments.

    .venv/bin/python tools/update_paper_page.py                      # half an hour, then the page
    .venv/bin/python tools/update_paper_page.py --folder out/paper   # goes on with a run there

No number between the two marks is ever typed by hand; figures go to docs/images.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from blocks import write_block
from update_pictures import keep

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "explanation" / "paper.md"
README = ROOT / "README.md"
FIGURES = (
    "fig2", "fig4", "fig5a", "fig5b", "fig5c", "fig6", "contributions", "discussion",
)  # fmt: skip


def write_page(folder: Path) -> None:
    """Put table and figures of a finished run into the documentation."""
    for name in FIGURES:
        keep(folder / f"{name}.png", f"paper-{name}.png")
    write_block(PAGE, "paper", (folder / "table.md").read_text(encoding="utf-8"))
    table = json.loads((folder / "table.json").read_text(encoding="utf-8"))
    write_block(README, "paper", headlines(table))


def headlines(table: dict[str, Any]) -> str:
    """Markdown table of the rows that have a short name."""
    columns = ("reported", "paper", "joint", "bound", "factor")
    lines = [
        "| | the paper | `paper` | `joint` | bound | factor |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {row['short']} | {' | '.join(_cell(row, name) for name in columns)} |"
        for row in table["rows"]
        if row["short"]
    ]
    made = f"{table['lightflight']}, seed {table['seed']}, {table['made_utc']}"
    return "\n".join([*lines, "", f"`make paper ARGS=table`, {made}."])


def _cell(row: dict[str, Any], name: str) -> str:
    value = row[name]
    if value is None:
        return "–"
    return f"{value:.0f} ×" if name == "factor" else f"{value:.3g} {row['unit']}"


def main() -> None:
    """Run the experiments, rewrite the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, help="of a run to go on with, and to keep")
    parser.add_argument("--quick", action="store_true", help="a minute instead of half an hour")
    parser.add_argument("--finished", action="store_true", help="take the folder as it is")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (args.folder or Path(temporary)).resolve()
        if not args.finished:
            words = [sys.executable, "-m", "studies.zheng2020", "-o", str(folder)]
            subprocess.run(words + ["--quick"] * args.quick, check=True, cwd=ROOT)
        write_page(folder)


if __name__ == "__main__":
    main()
