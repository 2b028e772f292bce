"""What of a wider spot is the beam's: the shares of a last leg that fans out, or leaves the focus.

    python benchmarks/own_shares.py                     # 20 laboratories a kind
    python benchmarks/own_shares.py --only soft --labs 40 --first 7500

Laboratories and defects are those of `misfit_labs.py`, a forward model of its own: behind a mirror
that shakes about two axes all that the spot of the last leg is wider is the beam's, across it and
in depth (shares 1 and 1), about one axis across alone (1 and 0), of a lens out of focus none (0 and
0). Paths are fitted by all counts, and no verdict is asked for.

Printed: every laboratory; for each kind and share, over paths with the right number of legs, the
mean error with its standard error, the median of the stated errors, the rms pull with its 95 %
interval, and how many lie more than four stated errors off.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import GeometryError, NothingFoundError
from lightflight.reconstruct.all_counts.corners import statements_of_corners

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.misfit_labs import recording_of
from benchmarks.random_labs import Floats
from benchmarks.refraction import interval
from tests.labs import without_verdict

KINDS = {"fan": (0.7, (1.0, 1.0)), "sheet": (0.7, (1.0, 0.0)), "soft": (0.7, (0.0, 0.0))}
"""Strength of the defect, and the shares across and in depth."""
FAR_STDS = 4.0


def shares_of(kind: str, seed: int) -> tuple[Floats, Floats] | None:
    """Shares (2,) of the last leg and their stated errors; None: another path, or never asked."""
    photon = importlib.import_module("lightflight.reconstruct.all_counts.photon")
    lab, hist, told = recording_of(kind, KINDS[kind][0], seed)
    ends: list[Any] = []

    def kept(ended: Any, counts: Any, covariance: Floats) -> Any:
        ends.append((ended, covariance))
        return statements_of_corners(ended, counts, covariance)

    with pytest.MonkeyPatch.context() as patch:
        without_verdict(patch)
        patch.setattr(photon, "statements_of_corners", kept)
        try:
            path = lf.reconstruct(hist, method="photon", **told)
        except (GeometryError, NothingFoundError):
            return None
    if path.n_legs != len(lab.vertices) - 1 or not ends:
        return None
    ended, covariance = ends[-1]
    layout, places = ended.order.layouts[0], ended.order.places[0]
    if not layout.own_shares:
        return None
    stds = np.sqrt(np.diag(covariance)[places])
    first = layout.own_shares[-1]
    return np.array(ended.points[0].light.own_shares[-1]), stds[first : first + 2]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--labs", type=int, default=20, help="for each kind")
    parser.add_argument("--first", type=int, default=7000, help="first seed")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    lines = []
    for kind in args.only:
        found = []
        for seed in range(args.first, args.first + args.labs):
            one = shares_of(kind, seed)
            words = "-" if one is None else " ".join(
                f"{value:.2f} +- {std:.2f}" for value, std in zip(*one, strict=True)
            )  # fmt: skip
            print(f"{kind} {seed}: {words}", flush=True)
            found += [] if one is None else [one]
        for k, name in enumerate(("across", "in depth")):
            off = np.array([values[k] for values, _ in found]) - KINDS[kind][1][k]
            stated = np.array([stds[k] for _, stds in found])
            pulls = off / stated
            lines.append(
                f"| {kind} | {name} | {len(off)} of {args.labs} | {off.mean():.3f} +- "
                f"{off.std() / np.sqrt(len(off)):.3f} | {np.median(stated):.3f} | "
                f"{interval(pulls**2, 1.0)} | "
                f"{np.count_nonzero(np.abs(pulls) > FAR_STDS)} |"
            )
    print("\n| kind | share | asked for | mean error | stated error | rms pull | > 4 |")
    print("|---|---|---:|---:|---:|---:|---:|")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
