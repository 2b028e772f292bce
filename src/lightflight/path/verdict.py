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
    DRAWN_CURVE = "drawn_curve"
    LEG_COUNT = "leg_count"
    HAZE = "haze"
    HALO = "halo"
    GLARE = "glare"
    OTHER_PULSE = "other_pulse"
    INDEX = "index"
    FOCAL_LENGTH = "focal_length"
    DISTORTION = "distortion"
    POSE = "pose"
    WINDOW = "window"
    BLOCK = "block"
    CLOCK_OFFSET = "clock_offset"
    CLOCK_SCALE = "clock_scale"
    CLOCK_DRIFT = "clock_drift"
    WALK = "walk"
    PILE_UP = "pile_up"
    UNITS = "units"
    ORIENTATION = "orientation"
    CALIBRATION = "calibration"
    ALTERNATIVE = "alternative"
    NOT_EXAMINED = "not_examined"


class Level(StrEnum):
    """How far a path may be relied on."""

    TRUST = "trust"
    CHECK = "check"
    CONTRADICTED = "contradicted"


MEANING = {
    Level.TRUST: "nothing in the recording speaks against this path",
    Level.CHECK: "see what is named before you rely on this path",
    Level.CONTRADICTED: "the recording contradicts this path, its errors do not hold",
}
"""What each level says, in the words of every output."""


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

    def __str__(self) -> str:
        return f"{self.name}{self._clearly}: {self.sentence}; {self.remedy}"

    @property
    def _clearly(self) -> str:
        """How clearly it was seen; nothing for what is no test."""
        return f" ({self.sigma:.2g} \u03c3)" if self.sigma else ""


def noted(name: FindingName, sentence: str, remedy: str) -> Finding:
    """What was seen by no test, and asks that the path be checked."""
    return Finding(name, sentence, 0.0, remedy, Severity.CHECK)


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
        size = f"{_two_digits(self.size)} {self.unit}".rstrip()
        return f"{self.name} up to {size}, which moves a vertex by {_two_digits(self.moves_mm)} mm"


def _two_digits(value: float) -> str:
    """Two digits, without an exponent for what is large."""
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


@dataclass(frozen=True, repr=False)
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

    @property
    def headline(self) -> str:
        """The level, what it means, and the chance that all is well and looks as bad."""
        of_tests = f" (p = {self.p_value:.2g} over {self.n_tests} tests)" if self.n_tests else ""
        return f"{self.level}: {MEANING[self.level]}{of_tests}"

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it in words: the headline, the findings in order, what it is blind to."""
        found = tuple(f"{k}. {one}" for k, one in enumerate(self.findings, start=1))
        return (self.headline, *found, *((self.blind_line,) if self.blind_to else ()))

    @property
    def blind_line(self) -> str:
        """What would go unseen in more than half of all recordings, and what it moves."""
        return f"blind to {'; '.join(map(str, self.blind_to))}" if self.blind_to else ""

    def __repr__(self) -> str:
        return "\n".join(self.lines)

    def __str__(self) -> str:
        said = "; ".join(finding.sentence for finding in self.findings)
        return f"{self.level}: {said}" if said else str(self.level)

    def to_json(self) -> dict[str, object]:
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
                BlindSpot(
                    FindingName(one["name"]),
                    float(one["size"]),
                    str(one["unit"]),
                    float(one["moves_mm"]),
                )
                for one in plain["blind_to"]
            ),
            p_value=float("nan") if p_value is None else float(p_value),
            n_tests=int(plain["n_tests"]),
        )


def _finding(plain: Mapping[str, Any]) -> Finding:
    return Finding(
        FindingName(plain["name"]),
        str(plain["sentence"]),
        float(plain["sigma"]),
        str(plain["remedy"]),
        Severity(plain["severity"]),
    )


_WARNS = {
    Level.CHECK: "check this path before you rely on it",
    Level.CONTRADICTED: "the recording contradicts this path",
}


def warning_of(verdict: Verdict) -> str:
    """One sentence that warns of a path that is not to be trusted; the first finding tells why."""
    said = verdict.findings[0].sentence if verdict.findings else "its tests say so together"
    others = len(verdict.findings) - 1
    more = f", and {others} more in path.verdict" if others > 0 else ""
    return f"{_WARNS[verdict.level]}: {said}{more}"


NOT_EXAMINED = Verdict(
    Level.CHECK,
    (
        noted(
            FindingName.NOT_EXAMINED,
            "no recording was held against this path",
            "reconstruct it from its recording with this version",
        ),
    ),
)
"""Of a path made by hand or read from a file that carries no verdict."""
