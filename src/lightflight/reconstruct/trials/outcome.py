"""A trial that comes to nothing: why a path with other legs was not fitted.

Second thoughts on the number of legs try many paths, most of them wrong. That one cannot be fitted
is an answer, not an error: the search goes on with the next.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import TypeVar

import numpy as np

from lightflight.errors import GeometryError, NothingFoundError

Fit = TypeVar("Fit")


class NoFit(Enum):
    """Why a trial path has no fit."""

    NO_GEOMETRY = "its legs cannot follow one another, or do not cross the picture"
    NOTHING_FOUND = "too few pulses lie on it, or a leg has too few pixels"
    SINGULAR = "its matrices cannot be solved"
    TOLD = "it would part a leg whose length is told"
    NOT_COMPUTABLE = "a waypoint names a vertex it has not, or a table of it is empty"


def fit_or_reason(attempt: Callable[[], Fit]) -> Fit | NoFit:
    """What `attempt` gives, or why it gives nothing.

    Parameters
    ----------
    attempt : callable
        Fits one trial path.

    Returns
    -------
    Fit or NoFit
        Its fit, or the reason.
    """
    # All four are ValueErrors, LinAlgError too: the narrow ones must be asked first.
    try:
        return attempt()
    except GeometryError:
        return NoFit.NO_GEOMETRY
    except NothingFoundError:
        return NoFit.NOTHING_FOUND
    except np.linalg.LinAlgError:
        return NoFit.SINGULAR
    except ValueError:
        return NoFit.NOT_COMPUTABLE
