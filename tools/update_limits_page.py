"""Write the measured tables of docs/explanation/limits.md from the rows of a benchmark.

    .venv/bin/python benchmarks/accuracy_limits.py --only legs --runs 1025 --json out/legs.json
    .venv/bin/python tools/update_limits_page.py out/legs.json [more.json ...]

No number between the marks is ever typed by hand. A table that the files do not hold stays.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from blocks import with_block

PAGE = Path(__file__).resolve().parents[1] / "docs" / "explanation" / "limits.md"

Rows = list[dict[str, Any]]
Lines = list[str]

PRIORS = {"known": "source and emission time known", "emission fitted": "emission time fitted"}
QUANTITIES = ("angles", "corners x y z", "corners t")


def legs(rows: Rows) -> Lines:
    """One leg in full light, by prior and estimator."""
    return [
        "| prior | estimator | mean abs(error) | / bound | pull |",
        "|---|---|---:|---:|---:|",
        *(
            f"| {PRIORS[r['prior']]} | `{r['method']}` | {r['degrees']:.4f}\u00b0 "
            f"| {r['in_bounds']:.3f} | {r['pull']:.2f} |"
            for r in rows
        ),
    ]


def starved(rows: Rows) -> Lines:
    """One leg in hardly any light, by photons and estimator."""
    lines = [
        "| photons in the brightest pixel | estimator | mean abs(error) | / bound | pull |",
        "|---:|---|---:|---:|---:|",
    ]
    for r in rows:
        head = f"| {r['photons']:g} | `{r['method']}` |"
        if r["degrees"] is None:
            lines.append(f"{head} finds nothing | | |")
        else:
            lines.append(
                f"{head} {r['degrees']:.3f}\u00b0 | {r['in_bounds']:.2f} | {r['pull']:.2f} |"
            )
    return lines


def steep(rows: Rows) -> Lines:
    """Steep legs, one line per elevation."""
    by_case = {(r["elevation_deg"], r["prior"], r["method"]): r for r in rows}
    lines = [
        "| elevation | error, mean abs | / bound, `joint` | `photon` | pull "
        "| / bound, emission fitted |",
        "|---:|---:|---:|---:|---:|---:|",
    ]
    for angle in dict.fromkeys(r["elevation_deg"] for r in rows):
        joint = by_case[angle, "known", "joint"]
        others = by_case[angle, "known", "photon"], by_case[angle, "emission fitted", "joint"]
        lines.append(
            f"| {angle:+.0f}\u00b0 | {joint['degrees']:.2g}\u00b0 | {joint['in_bounds']:.2f} "
            f"| {others[0]['in_bounds']:.2f} | {joint['pull']:.2f} | {others[1]['in_bounds']:.2f} |"
        )
    return [line.replace("| -", "| \u2212") for line in lines]


def coverage(rows: Rows) -> Lines:
    """Shares of truths within the 68 % and 95 % intervals, by clock and light."""
    by_case = {(r["clock"], r["photons"], r["quantity"]): r for r in rows}
    lines = ["| clock | photons | angles | corners x, y, z | corners t |", "|---|---:|---|---|---|"]
    for clock, photons in dict.fromkeys((r["clock"], r["photons"]) for r in rows):
        shares = (by_case[clock, photons, quantity] for quantity in QUANTITIES)
        cells = " | ".join(f"{100 * r['in_68']:.1f} / {100 * r['in_95']:.1f}" for r in shares)
        lines.append(f"| {clock} | {photons:,.0f} | {cells} |")
    return lines


TABLES: dict[str, Callable[[Rows], Lines]] = {
    "legs": legs,
    "starved": starved,
    "steep": steep,
    "coverage": coverage,
}


def block_of_table(name: str, results: dict[str, Any]) -> str:
    """Markdown of one table, with what made it."""
    made = f"{results['lightflight']}, {results['made_utc']}"
    command = f"benchmarks/accuracy_limits.py --only {name} --runs {results['runs']}"
    return "\n".join([*TABLES[name](results["tables"][name]), "", f"`{command}`, {made}."])


def main() -> None:
    """Put every table that the given files hold on the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="+", help="files of accuracy_limits.py --json")
    text = PAGE.read_text(encoding="utf-8")
    for file in parser.parse_args().results:
        results = json.loads(file.read_text(encoding="utf-8"))
        for name in results["tables"]:
            if name in TABLES:
                text = with_block(text, name, block_of_table(name, results))
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
