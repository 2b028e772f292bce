"""Light that a recording without the flight shows too, with that recording given and without.

    python benchmarks/backgrounds.py                          # 4 laboratories of each
    python benchmarks/backgrounds.py --only leak --labs 8 --first 1403

Laboratories of `random_labs.py` with something that has nothing to do with the flight: a leak of
the laser's light, in all pixels at once; a signal of the trigger, at one code of all pixels;
reflections in three walls, as late and as bright as each pixel sees them. Its light is a share of
the brightest pixel's, and it often comes while the flight does: a table top is crossed in a few
pulses' lengths. The background is recorded for as long as the flight, with photons of its own.

A line for each recording, and a table of verdicts, wrong paths (another number of legs, or more
than five stated errors off) and CPU by kind, share and what was given.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lightflight as lf
from benchmarks.random_labs import Lab, drawn_lab, histograms, light_of, pulls_of, told_of
from lightflight.errors import CalibrationError, GeometryError, NothingFoundError

Floats = NDArray[np.float64]

FAR_STDS = 5.0
SHARES = (0.003, 0.03, 0.3)
FRAMES = 10_000_000


def leak(lab: Lab, rng: np.random.Generator) -> Floats:
    """Light that comes to all pixels at once, (rows, cols, codes), one photon a pixel."""
    first, last = lab.edges_ps[[0, -1]]
    at = first + rng.uniform(0.2, 0.8) * (last - first) + lab.delays_ps[..., np.newaxis]
    light: Floats = np.diff(lab.come(lab.edges_ps - at), axis=2)
    return light


def signal(lab: Lab, rng: np.random.Generator) -> Floats:
    """Counts at one code, whatever the delay of a pixel."""
    first, last = lab.edges_ps[[lab.n_codes // 5, 4 * lab.n_codes // 5]]
    share = np.diff(lab.come(lab.edges_ps - rng.uniform(first, last)))
    return np.broadcast_to(share, (*lab.optics.shape, lab.n_codes))


def reflections(lab: Lab, rng: np.random.Generator) -> Floats:
    """Three walls, each of about a third of a photon."""
    rows, cols = np.indices(lab.optics.shape)
    first, last = lab.edges_ps[[0, -1]]
    light = np.zeros((*lab.optics.shape, lab.n_codes))
    for _ in range(3):
        slope = rng.normal(0.0, 20.0, 2)
        at = first + rng.uniform(0.1, 0.9) * (last - first) + slope[0] * rows + slope[1] * cols
        bright = np.exp(rng.normal() + 0.5 * rng.normal() * rows / rows.max())
        come = lab.come(lab.edges_ps - (at + lab.delays_ps)[..., np.newaxis])
        light += bright[..., np.newaxis] * np.diff(come, axis=2) / 3.0
    return light


KINDS = {"leak": leak, "signal": signal, "reflections": reflections}


def recorded(kind: str, share: float, seed: int) -> tuple[Lab, lf.Histograms, lf.Histograms]:
    """A laboratory, its recording, and that of its background."""
    lab = drawn_lab(seed)
    light = light_of(lab)
    flight = light * (lab.photons / light.sum(axis=2).max())
    other = share * lab.photons * KINDS[kind](lab, np.random.default_rng([14, seed]))
    other = other + lab.background * lab.widths
    hist, background = (
        replace(histograms(lab, np.random.default_rng([n, seed]).poisson(mean)), n_frames=FRAMES)
        for n, mean in ((15, flight + other), (16, other))
    )
    return lab, hist, background


def outcome(
    lab: Lab, hist: lf.Histograms, background: lf.Histograms | None
) -> tuple[str, Counter[str]]:
    """What came out, in a line, and what it counts as."""
    try:
        path = lf.reconstruct(hist, background=background, **told_of(lab))
    except (CalibrationError, GeometryError, NothingFoundError) as problem:
        return str(problem), Counter(["refused"])
    right = path.n_legs == len(lab.vertices) - 1
    farthest = float(pulls_of(lab, path)[:, 1].max(initial=0.0)) if right else np.inf
    level, wrong = str(path.verdict.level), farthest > FAR_STDS
    counted = Counter(
        [level, *["wrong"] * wrong, *["wrong, trusted"] * (wrong and level == "trust")]
    )
    return f"{path.n_legs} legs, {level}; farthest {farthest:.1f} stated errors", counted


def main() -> None:
    """Print a line for each recording, then the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--labs", type=int, default=4, help="of each kind and share")
    parser.add_argument("--first", type=int, default=1403, help="first seed")
    parser.add_argument("--given", action="store_true", help="only with the background given")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    table: dict[tuple[str, float, str], tuple[Counter[str], list[float]]] = {}
    for kind in args.only:
        for share in SHARES:
            for seed in range(args.first, args.first + args.labs):
                lab, hist, background = recorded(kind, share, seed)
                for word, given in (("given", background), ("not given", None))[: 2 - args.given]:
                    began = time.process_time()
                    line, counted = outcome(lab, hist, given)
                    seconds = time.process_time() - began
                    print(f"{kind} {share:g}, {word}: {lab.words()}: {line}; {seconds:.1f} s")
                    sys.stdout.flush()
                    row = table.setdefault((kind, share, word), (Counter(), []))
                    row[0].update(counted)
                    row[1].append(seconds)
    columns = ("trust", "check", "contradicted", "refused", "wrong", "wrong, trusted")
    print(f"\n| light | share | background | {' | '.join(columns)} | s of CPU, median |")
    print(f"|---|---:|---|{'---:|' * (len(columns) + 1)}")
    for (kind, share, word), (counted, took) in table.items():
        cells = " | ".join(str(counted[name]) for name in columns)
        print(f"| {kind} | {share:g} | {word} | {cells} | {np.median(took):.1f} |")


if __name__ == "__main__":
    main()
