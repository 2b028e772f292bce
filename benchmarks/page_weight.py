"""What a page weighs, on the disk and in the browser: today's beside that of an older commit.

    python benchmarks/page_weight.py --old b9d141e      # of before it drew itself; needs plotly
    python benchmarks/page_weight.py --paths 100

The scene is the paper's, three legs before 32 x 32 pixels, with its recording. "Blocked" is the
time that tasks of more than 50 ms kept the page's only thread, beyond those 50 ms each (total
blocking time), and "long" all of their time, from the start of navigation to two seconds without
such a task; old and new take turns in one browser with software graphics. Medians and ranges.
"""

from __future__ import annotations

import argparse
import io
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

MAKE = """
import sys
from tests.view import fakes
from tests.view.test_page_browser import recording_of
from lightflight.view.page import write_page
from lightflight.view.page.campaign import write_campaign
file, n_paths = sys.argv[1], int(sys.argv[2])
path = fakes.fake_path()
table = path.residuals
pulses = fakes.fake_pulses(
    table["row"], table["col"], table["arrival_ps"], std_ps=75.0, photons=3000.0
)
write_page(
    path, file, recording=recording_of(path), pulses=pulses, arrivals=fakes.fake_arrivals(path)
)
names = [f"{k}.h5" for k in range(n_paths)]
for k, name in enumerate(names):
    fakes.fake_path(seed=k).save(name)
write_campaign(names, "index.html")
"""

LISTEN = """
window.longTasks = [];
new PerformanceObserver((list) => {
  for (const one of list.getEntries()) window.longTasks.push([one.startTime, one.duration]);
}).observe({ type: "longtask", buffered: true });
"""


def make(source: Path, folder: Path, n_paths: int) -> Path:
    """The page and the campaign that a checkout writes; folder must be empty."""
    folder.mkdir()
    page = folder / "page.html"
    words = [sys.executable, "-c", MAKE, str(page), str(n_paths)]
    paths = {"PYTHONPATH": f"{source / 'src'}:{source}"}
    subprocess.run(words, check=True, cwd=folder, env={**os.environ, **paths})
    return page


def checkout(commit: str, folder: Path) -> Path:
    """The sources of a commit."""
    packed = subprocess.run(
        ["git", "archive", commit, "src", "tests"], check=True, cwd=ROOT, capture_output=True
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")
    return folder


def blocked_ms(browser: Any, file: Path) -> tuple[float, float, float]:
    """Blocked time, time of long tasks, and when the page was first drawn; ms."""
    context = browser.new_context(viewport={"width": 1280, "height": 800}, offline=True)
    page = context.new_page()
    page.add_init_script(LISTEN)
    page.goto(file.as_uri())
    page.wait_for_selector("html[data-ready=yes]", timeout=120_000)
    tasks: list[list[float]] = []
    while True:
        page.wait_for_timeout(500)
        tasks, now = page.evaluate("[window.longTasks, performance.now()]")
        if now - max([0.0, *(start + took for start, took in tasks)]) > 2000:
            break
    first = page.evaluate("performance.getEntriesByName('lightflight-first-draw')[0].startTime")
    context.close()
    return sum(took - 50 for _, took in tasks), sum(took for _, took in tasks), first


def size_of_campaign(folder: Path) -> int:
    """Bytes of the index and the pages beside it."""
    pages = folder / "index_pages"
    return (folder / "index.html").stat().st_size + sum(f.stat().st_size for f in pages.iterdir())


def main() -> None:
    """Write the pages, weigh them, print a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--old", help="commit to compare with")
    parser.add_argument("--paths", type=int, default=100, help="paths of the campaign")
    parser.add_argument("--runs", type=int, default=5, help="times each page is opened")
    options = parser.parse_args()
    from tests.view.browser import started_browser

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sources = {"new": ROOT}
        if options.old:
            sources = {"old": checkout(options.old, folder / "source"), **sources}
        pages = {key: make(source, folder / key, options.paths) for key, source in sources.items()}
        taken: dict[str, list[tuple[float, float, float]]] = {key: [] for key in pages}
        with started_browser() as browser:
            for _ in range(options.runs):
                for key, page in pages.items():
                    taken[key].append(blocked_ms(browser, page))
        for key, page in pages.items():
            campaign = size_of_campaign(folder / key) / 1e6
            print(
                f"{key}: page {page.stat().st_size / 1e6:.2f} MB, "
                f"{options.paths} paths {campaign:.1f} MB; ms: "
                + ", ".join(
                    f"{word} {median(column):.0f} ({min(column):.0f} to {max(column):.0f})"
                    for word, column in zip(
                        ("blocked", "long", "first drawn"), zip(*taken[key], strict=True),
                        strict=True,
                    )
                )
            )  # fmt: skip


if __name__ == "__main__":
    main()
