"""Write the measured part of docs/explanation/paper.md from the paper's experiments.

    .venv/bin/python tools/update_paper_page.py                      # half an hour, then the page
    .venv/bin/python tools/update_paper_page.py --folder out/paper   # goes on with a run there

No number between the two marks is ever typed by hand; figures go to docs/images.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from update_pictures import keep

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "explanation" / "paper.md"
BEGIN, END = "<!-- paper:begin (tools/update_paper_page.py) -->", "<!-- paper:end -->"
FIGURES = (
    "fig2", "fig4", "fig5a", "fig5b", "fig5c", "fig6", "contributions", "discussion",
)  # fmt: skip


def with_block(text: str, block: str) -> str:
    """Page with the block between the marks replaced."""
    before, _, rest = text.partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise SystemExit(f"{PAGE.name} has no block between {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{block.strip()}\n\n{END}{after}"


def write_page(folder: Path) -> None:
    """Put table and figures of a finished run into the documentation."""
    for name in FIGURES:
        keep(folder / f"{name}.png", f"paper-{name}.png")
    table = (folder / "table.md").read_text(encoding="utf-8")
    PAGE.write_text(with_block(PAGE.read_text(encoding="utf-8"), table), encoding="utf-8")


def main() -> None:
    """Run the experiments, rewrite the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, help="of a run to go on with, and to keep")
    parser.add_argument("--quick", action="store_true", help="a minute instead of half an hour")
    parser.add_argument("--finished", action="store_true", help="take the folder as it is")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.folder or Path(temporary)
        if not args.finished:
            words = [sys.executable, "-m", "lightflight", "paper", "all", "-o", str(folder)]
            subprocess.run(words + ["--quick"] * args.quick, check=True)
        write_page(folder)


if __name__ == "__main__":
    main()
