"""Random numbers: one independent stream per physical component, block and chunk.

A switched-off defect draws nothing from its own stream and leaves every other stream as it was:
two recordings that differ in one defect differ in nothing else. Chunks have streams of their
own, so the number of threads cannot change a recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightflight.arguments import shown

# A stream's key is its place in this tuple: append, never reorder, or old seeds change meaning.
COMPONENTS = (
    "number", "position", "row", "col", "beam", "pulse", "trigger", "response", "tail",
    "efficiency", "crosstalk", "afterpulse", "drift", "occupancy", "background", "frame",
    "gain", "phase", "skew", "dark_rate", "screaming", "sensitivity", "dead", "dust",
)  # fmt: skip


@dataclass(frozen=True)
class Streams:
    """All random streams of one recording (or of one camera's defects).

    Attributes
    ----------
    seed : int
        Any integer >= 0.
    """

    seed: int

    def __post_init__(self) -> None:
        seed: object = self.seed
        if not isinstance(seed, int | np.integer) or isinstance(seed, bool):
            raise TypeError(f"seed must be a whole number, got {shown(self.seed)}")
        if self.seed < 0:
            raise ValueError(f"seed must be >= 0, got {self.seed}")

    def generator(self, component: str, *key: int) -> np.random.Generator:
        """The generator of one component; the same at every call.

        Parameters
        ----------
        component : str
            One of `COMPONENTS`.
        *key : int
            Numbers of the block and of the chunk, where there are such.

        Returns
        -------
        Generator
            Independent of those of all other components and keys.
        """
        place = COMPONENTS.index(component)
        return np.random.default_rng(
            np.random.SeedSequence(int(self.seed), spawn_key=(place, *key))
        )
