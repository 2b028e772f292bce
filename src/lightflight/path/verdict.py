"""The verdict on a path: whether it may be trusted, what contradicts it, and what it cannot see."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class FindingName(StrEnum):
    """What can be wrong with a path, its recording or its set-up; the names stay."""

    PRIOR = "prior"
    SOURCE = "source"
    UNEXPLAINED_LIGHT = "unexplained_light"
    SHAPE = "shape"
    TREND = "trend"
    SCATTER = "scatter"
    UNSEEN_LEG = "unseen_leg"
    CURVED_LEG = "curved_leg"
    LEG_COUNT = "leg_count"
    HAZE = "haze"
    HALO = "halo"
    GLARE = "glare"
    OTHER_PULSE = "other_pulse"
    INDEX = "index"
    FOCAL_LENGTH = "focal_length"
    DISTORTION = "distortion"
    POSE = "pose"
    CLOCK_OFFSET = "clock_offset"
    CLOCK_SCALE = "clock_scale"
    CLOCK_DRIFT = "clock_drift"
    WALK = "walk"
    PILE_UP = "pile_up"
    UNITS = "units"
    ORIENTATION = "orientation"
    CALIBRATION = "calibration"
    NOT_EXAMINED = "not_examined"


class Level(StrEnum):
    """How far a path may be relied on."""

    TRUST = "trust"
    CHECK = "check"
    CONTRADICTED = "contradicted"


class Severity(StrEnum):
    """What a finding does to a verdict."""

    CHECK = "check"
    CONTRADICTED = "contradicted"


@dataclass(frozen=True)
class Finding:
    """One thing that speaks against a path, or a cause that may lie behind it.

    Attributes
    ----------
    name : FindingName
        What it is.
    sentence : str
        What was seen.
    sigma : float
        How clearly it was seen, as that of a normal deviate; 0 where it is no test.
    remedy : str
        What to do.
    severity : Severity
        What it does to the verdict.
    """

    name: FindingName
    sentence: str
    sigma: float
    remedy: str
    severity: Severity


@dataclass(frozen=True)
class BlindSpot:
    """An error that this recording cannot show, though it moves the path.

    Attributes
    ----------
    name : FindingName
        What may be off.
    size : float
        By how much it may be off and be seen in fewer than half of all recordings.
    unit : str
        Of `size`.
    moves_mm : float
        How far that moves the vertex that it moves most.
    """

    name: FindingName
    size: float
    unit: str
    moves_mm: float

    def __str__(self) -> str:
        return f"{self.name} {self.size:.2g} {self.unit}: {self.moves_mm:.2g} mm"


@dataclass(frozen=True)
class Verdict:
    """Whether a path may be trusted.

    Attributes
    ----------
    level : Level
        "trust", "check" or "contradicted".
    findings : tuple of Finding
        What speaks against it, the most likely cause first.
    blind_to : tuple of BlindSpot
        What could move the path by more than its stated error and would not be seen.
    p_value : float
        Chance that a recording with nothing wrong looks at least as bad, over all tests; NaN
        without any.
    n_tests : int
        Number of tests.
    """

    level: Level
    findings: tuple[Finding, ...] = ()
    blind_to: tuple[BlindSpot, ...] = ()
    p_value: float = float("nan")
    n_tests: int = 0

    def __str__(self) -> str:
        said = "; ".join(finding.sentence for finding in self.findings)
        return f"{self.level}: {said}" if said else str(self.level)

    def to_json(self) -> dict[str, Any]:
        """The verdict as plain JSON types."""
        plain = asdict(self)
        plain["p_value"] = self.p_value if self.n_tests else None
        return plain

    @classmethod
    def from_json(cls, plain: Mapping[str, Any]) -> Verdict:
        """The verdict that `to_json` wrote."""
        p_value = plain["p_value"]
        return cls(
            level=Level(plain["level"]),
            findings=tuple(_finding(one) for one in plain["findings"]),
            blind_to=tuple(
                BlindSpot(**{**one, "name": FindingName(one["name"])}) for one in plain["blind_to"]
            ),
            p_value=float("nan") if p_value is None else float(p_value),
            n_tests=int(plain["n_tests"]),
        )


def _finding(plain: Mapping[str, Any]) -> Finding:
    return Finding(
        **{
            **plain,
            "name": FindingName(plain["name"]),
            "severity": Severity(plain["severity"]),
        }
    )


NOT_EXAMINED = Verdict(
    Level.CHECK,
    (
        Finding(
            FindingName.NOT_EXAMINED,
            "no recording was held against this path",
            0.0,
            "reconstruct it from its recording with this version",
            Severity.CHECK,
        ),
    ),
)
"""Of a path made by hand or read from a file that carries no verdict."""
