"""What an error that nothing shows moves: vertices as they follow a fit, beyond what is stated."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.flight import Medium
from lightflight.path.verdict import BlindSpot, FindingName
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.fit.least_squares import Solution
from lightflight.reconstruct.model.geometry import vertex_time_jacobian

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Vertices:
    """The m vertices of a path as they follow its p free parameters.

    Attributes
    ----------
    by_free : array of float, shape (3m, p)
        mm.
    stated_mm : array of float, shape (m,)
        Their stated errors, all three coordinates together.
    """

    by_free: Floats
    stated_mm: Floats

    @classmethod
    def of(cls, fit: JointFit, solution: Solution, medium: Medium) -> Vertices:
        """Those of a solution with the freedom of a fit."""
        m = len(solution.state.vertices_mm)
        places = np.arange(4 * m).reshape(m, 4)[:, :3].ravel()
        by_free = vertex_time_jacobian(solution.state, medium)[places] @ fit.freedom.basis
        p = by_free.shape[1]
        variance = np.diag(by_free @ solution.covariance[:p, :p] @ by_free.T)
        stated = np.sqrt(np.maximum(variance, 0.0))
        return cls(by_free, np.linalg.norm(stated.reshape(m, 3), axis=1))

    def moved_mm(self, steps: Floats) -> Floats:
        """How far steps (p, ...) of the free parameters move each vertex, (m, ...)."""
        moved = self.by_free @ steps
        moved_mm: Floats = np.linalg.norm(moved.reshape(-1, 3, *moved.shape[1:]), axis=1)
        return moved_mm

    def spot(self, name: FindingName, size: float, unit: str, moved_mm: Floats) -> BlindSpot | None:
        """An error that moves vertices by `moved_mm` (m,) unseen; None: by no more than stated."""
        worst = int(np.argmax(moved_mm - self.stated_mm))
        if moved_mm[worst] <= self.stated_mm[worst]:
            return None
        return BlindSpot(name, size, unit, float(moved_mm[worst]))


def farthest(spots: Iterable[BlindSpot | None]) -> tuple[BlindSpot, ...]:
    """Of some blind spots that which moves a vertex most, alone; () of none."""
    told = [spot for spot in spots if spot is not None]
    return tuple(sorted(told, key=lambda spot: -spot.moves_mm)[:1])
