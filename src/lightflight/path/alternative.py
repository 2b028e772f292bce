"""Another path that explains the same recording, and how likely the recording makes it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lightflight.errors import LimitError

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

MOST_ALTERNATIVES = 20
"""Of one path: each is drawn and stored like the path itself."""


@dataclass(frozen=True, eq=False, repr=False)
class Alternative:
    """Another path that explains the same recording about as well.

    Attributes
    ----------
    path : LightPath
        The other path, whole: vertices, errors, residuals. It has no alternatives of its own, and
        no verdict: what the tests say of the one path they say of the other.
    log_evidence : float
        Natural log of how many times likelier the recording is under it than under the path that
        holds it, whatever the numbers of either; negative where it is less likely. What was thought
        of the two beforehand is not in it.
    says : str
        What is different, in a few words.
    """

    path: LightPath
    log_evidence: float
    says: str

    def __post_init__(self) -> None:
        if not math.isfinite(self.log_evidence):
            raise ValueError(f"log_evidence must be finite, got {self.log_evidence}")
        if self.path.alternatives:
            raise ValueError("an alternative has no alternatives of its own")

    @property
    def odds_in_words(self) -> str:
        """How likely the recording is under it, against the path that holds it."""
        ratio = math.exp(min(abs(self.log_evidence), 700.0))
        # One digit: the approximation is good to a few tenths of the ratio.
        times = f"{ratio:.0f}" if 9.5 <= ratio < 1e4 else f"{ratio:.1g}"
        if times == "1":
            return "as likely"
        return f"{times} times {'more' if self.log_evidence > 0 else 'less'} likely"

    def __str__(self) -> str:
        return f"{self.says} ({self.odds_in_words})"

    def __repr__(self) -> str:
        return f"Alternative({self})"


def checked_alternatives(alternatives: Iterable[Alternative]) -> tuple[Alternative, ...]:
    """Alternatives of a path, the likeliest first.

    Parameters
    ----------
    alternatives : iterable of Alternative
        In any order.

    Returns
    -------
    tuple of Alternative

    Raises
    ------
    LimitError
        For more than `MOST_ALTERNATIVES`.
    ValueError
        For anything else.
    """
    listed = tuple(alternatives)
    if not all(isinstance(one, Alternative) for one in listed):
        raise ValueError(f"alternatives must be Alternative records, got {listed!r:.60}")
    if len(listed) > MOST_ALTERNATIVES:
        raise LimitError(f"a path has at most {MOST_ALTERNATIVES} alternatives, got {len(listed)}")
    return tuple(sorted(listed, key=lambda one: -one.log_evidence))
