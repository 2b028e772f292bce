"""One thing that was tried: how far each estimator was from the truth, as plain values to keep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Case:
    """One thing tried, and how far each estimator was from the truth."""

    topic: str
    """Which wish of the discussion it belongs to."""
    name: str
    """What was tried."""
    quantity: str
    """What the numbers are, unit included."""
    errors: Mapping[str, float]
    """By estimator; NaN where it found nothing."""
    bound: float
    """Cramér-Rao bound; NaN where there is none to compare with."""
    note: str
    """What to know about it, or why an estimator failed."""


def case_of(
    topic: str,
    name: str,
    quantity: str,
    errors: Mapping[str, float],
    *,
    bound: float | None = None,
    note: str = "",
) -> dict[str, Any]:
    """A case as plain values; NaN becomes None."""
    return {
        "topic": topic,
        "name": name,
        "quantity": quantity,
        "errors": {k: None if not np.isfinite(v) else float(v) for k, v in errors.items()},
        "bound": bound,
        "note": note,
    }


def case_from_values(values: Mapping[str, Any]) -> Case:
    """A case from what `case_of` gave; None becomes NaN."""
    errors = {k: float("nan") if v is None else v for k, v in values["errors"].items()}
    bound = float("nan") if values["bound"] is None else values["bound"]
    return Case(**{**values, "errors": errors, "bound": bound})
