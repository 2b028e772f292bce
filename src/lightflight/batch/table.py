"""The table of a campaign: one row per recording, as CSV or Parquet.

Rows are made from path files alone, and hold no clock times: the same paths give the same table,
byte for byte, however many runs and workers it took to make them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lightflight import flags
from lightflight.batch.campaign import Shot
from lightflight.display import Card, Drawn, Tabled
from lightflight.errors import GeometryError
from lightflight.files.tables import pyarrow, write_csv, write_parquet
from lightflight.path.error import path_error
from lightflight.path.verdict import Level
from lightflight.provenance import NUMERIC_PACKAGES

if TYPE_CHECKING:
    from lightflight.path.light_path import LightPath

DONE, FAILED = "done", "failed"

_TEXTS = (
    "recording", "group", "status", "reason", "method", "prior", "flags", "warnings", "verdict",
    "findings", "forks",
)  # fmt: skip
_VERSIONS = ("lightflight", "python", *NUMERIC_PACKAGES)
_WHOLE = (
    "n_legs", "n_pulses", "n_rejected", "dof", "n_explained", "n_found", "n_legs_unseen",
    "n_branches",
)  # fmt: skip
_FIRST = (
    "recording", "group", "set_point_deg", "status", "reason", "method", "prior", "converged",
    "n_legs", "n_pulses", "n_rejected", "residual_rms_ps", "error_floor_ps", "chi2", "dof",
    "flags", "warnings", "emission_time_ps", "emission_time_std_ps", "true_position_rms_mm",
    "true_event_time_rms_ps",
)  # fmt: skip
_OF_LEG = ("angle_deg", "angle_std_deg", "angle_photon_std_deg", "paper_angle_deg", "length_mm")
_OF_VERTEX = ("x_mm", "y_mm", "z_mm", "event_time_ps")
_OF_VERTEX_STD = ("x_std_mm", "y_std_mm", "z_std_mm", "event_time_std_ps")
_LAST = ("sha256", *_VERSIONS)
_VERDICT = ("verdict", "findings", "verdict_p_value", "n_explained", "n_found")
"""Behind all others: columns that are new to a table are put last."""
_UNSEEN = "n_legs_unseen"
"""Last of all, and only where a path has such legs."""
_BRANCHES, _FORKS = "n_branches", "forks"
"""Behind even these, and only where a path forks: which leg begins at which vertex, both counted as
in the names of the columns."""


@dataclass(frozen=True)
class Repeats:
    """Elevations of one leg in all recordings of one group that gave it.

    Attributes
    ----------
    name : str
        Name of the group.
    set_point_deg : float or None
        Elevation that was set up, deg.
    angle_deg : array of float
        (n,), elevation, deg.
    std_deg : array of float
        (n,), its total one-sigma error, deg.
    photon_std_deg : array of float
        (n,), the share of it that differs from repeat to repeat, deg.
    """

    name: str
    set_point_deg: float | None
    angle_deg: NDArray[np.float64]
    std_deg: NDArray[np.float64]
    photon_std_deg: NDArray[np.float64]

    @property
    def mean_deg(self) -> float:
        """Mean, weighted by the photons' errors; NaN without a repeat."""
        if not self.angle_deg.size:
            return math.nan
        return float(np.average(self.angle_deg, weights=self._weights))

    @property
    def mean_std_deg(self) -> float:
        """Error of the mean: what repeats share does not average out; NaN without a repeat."""
        if not self.angle_deg.size:
            return math.nan
        weights = self._weights / self._weights.sum()
        shared = np.maximum(self.std_deg**2 - self.photon_std_deg**2, 0.0)
        return math.sqrt(
            float(
                np.sum((weights * self.photon_std_deg) ** 2) + np.average(shared, weights=weights)
            )
        )

    @property
    def scatter_deg(self) -> float:
        """Standard deviation of the repeats; NaN for fewer than two."""
        return float(np.std(self.angle_deg, ddof=1)) if self.angle_deg.size > 1 else math.nan

    @property
    def _weights(self) -> NDArray[np.float64]:
        """Weights of the mean: photons' information, 1/deg^2; equal where one has none."""
        good = np.isfinite(self.photon_std_deg) & (self.photon_std_deg > 0)
        if not good.all():
            return np.ones_like(self.angle_deg)
        return np.asarray(self.photon_std_deg**-2.0)

    @property
    def pulls(self) -> NDArray[np.float64]:
        """(n,), distance from the mean in standard errors of that distance; none for n < 2.

        Repeats share the errors of calibration and set-up: those of the photons alone count.
        The mean moves with each repeat, hence 1 - w_i / sum w.
        """
        if self.angle_deg.size < 2:
            return np.empty(0)
        weights = self._weights
        expected = self.photon_std_deg * np.sqrt(1.0 - weights / weights.sum())
        with np.errstate(divide="ignore", invalid="ignore"):
            pulls = (self.angle_deg - self.mean_deg) / expected
        return np.asarray(pulls[np.isfinite(pulls)])


@dataclass(frozen=True, repr=False)
class CampaignTable(Drawn, Tabled):
    """One row per recording, in the order of the campaign.

    Attributes
    ----------
    rows : tuple[mapping of str, ...]
        Values by column; a column that a row does not know is absent from it.
    """

    rows: tuple[Mapping[str, Any], ...]

    def _card(self) -> Card:
        levels = ", ".join(f"{n} {level}" for level, n in self.n_by_verdict.items())
        return Card(
            "CampaignTable",
            [
                ("recordings", f"{len(self.rows)}, of which {self.n_failed} failed"),
                ("verdicts", levels),
                ("columns", str(len(self.columns))),
            ],
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of the longest path, fixed ones first and last."""
        n_legs = max((row.get("n_legs", 0) for row in self.rows), default=0)
        legs = [f"leg{k + 1}_{name}" for k in range(n_legs) for name in _OF_LEG]
        vertices = [
            f"vertex{k}_{name}"
            for k in range(n_legs + 1 if n_legs else 0)
            for name in (*_OF_VERTEX, *_OF_VERTEX_STD)
        ]
        unseen = (_UNSEEN,) if any(row.get(_UNSEEN) for row in self.rows) else ()
        forked = (_BRANCHES, _FORKS) if any(row.get(_BRANCHES) for row in self.rows) else ()
        return (*_FIRST, *legs, *vertices, *_LAST, *_VERDICT, *unseen, *forked)

    @property
    def n_failed(self) -> int:
        """Recordings that gave no path."""
        return sum(row["status"] == FAILED for row in self.rows)

    @property
    def n_by_verdict(self) -> dict[str, int]:
        """Paths by the level of their verdict."""
        levels = [row.get("verdict") for row in self.rows]
        return {str(level): levels.count(level) for level in Level}

    def repeats(self, leg: int = 1) -> tuple[Repeats, ...]:
        """Elevations of a leg, group by group.

        Parameters
        ----------
        leg : int, optional
            Which leg, the first is 1.

        Returns
        -------
        tuple of Repeats
            In the order of the table; a group whose paths have no such leg is empty.
        """
        groups: dict[tuple[str, float | None], list[Mapping[str, object]]] = {}
        for row in self.rows:
            found = groups.setdefault((row["group"], row.get("set_point_deg")), [])
            if f"leg{leg}_angle_deg" in row:
                found.append(row)

        def column(rows: list[Mapping[str, object]], name: str) -> NDArray[np.float64]:
            return np.array([row[f"leg{leg}_{name}"] for row in rows], dtype=np.float64)

        return tuple(
            Repeats(
                name,
                set_point,
                column(rows, "angle_deg"),
                column(rows, "angle_std_deg"),
                column(rows, "angle_photon_std_deg"),
            )
            for (name, set_point), rows in groups.items()
        )


# --- rows ------------------------------------------------------------------------------------


def row_from_failure(shot: Shot, reason: str) -> dict[str, object]:
    """Row of a recording that gave no path.

    Parameters
    ----------
    shot : Shot
        The recording.
    reason : str
        Why, in one sentence.

    Returns
    -------
    dict of str
        Values by column.
    """
    return {**_names_of(shot), "status": FAILED, "reason": reason}


def row_from_path(shot: Shot, path: LightPath) -> dict[str, object]:
    """Row of a recording and its path.

    Parameters
    ----------
    shot : Shot
        The recording.
    path : LightPath
        As it was kept: its provenance tells versions, warnings and digest.

    Returns
    -------
    dict of str
        Values by column; a column that is not known is absent.
    """
    good, std = path.goodness, path.vertex_std
    made = path.provenance
    row = {
        **_names_of(shot),
        "status": DONE,
        "method": path.method,
        "prior": path.prior,
        "converged": good.converged,
        "n_legs": path.n_legs,
        "n_pulses": good.n_pulses,
        "n_rejected": good.n_rejected,
        "residual_rms_ps": good.residual_rms_ps,
        "error_floor_ps": good.error_floor_ps,
        "chi2": good.chi2,
        "dof": good.dof,
        "flags": _flags_of(path),
        "warnings": " / ".join(made.get("warnings", ())),
        "emission_time_ps": path.emission_time_ps,
        "emission_time_std_ps": float(std[0, 3]),
        "sha256": made["inputs"][0]["sha256"],
        "lightflight": made["lightflight"],
        "python": made["python"],
        **made["packages"],
        **_verdict_of(path),
    }
    if path.unseen_legs:
        row[_UNSEEN] = len(path.unseen_legs)
    if path.forks:
        row[_BRANCHES] = len(path.ends) - 1
        row[_FORKS] = " ".join(f"leg{leg + 1}=vertex{vertex}" for leg, vertex in path.forks)
    for k, leg in enumerate(_legs_of(path)):
        row |= {f"leg{k + 1}_{name}": value for name, value in leg.items()}
    for k in range(path.n_legs + 1):
        place = (*path.vertices_mm[k], path.vertex_times_ps[k], *std[k])
        names = (*_OF_VERTEX, *_OF_VERTEX_STD)
        row |= {f"vertex{k}_{name}": float(v) for name, v in zip(names, place, strict=True)}
    return row | _truth_of(path)


def _names_of(shot: Shot) -> dict[str, object]:
    """What a recording is called, and what was set up for it."""
    names: dict[str, object] = {"recording": shot.label, "group": shot.group}
    return names if shot.set_point_deg is None else names | {"set_point_deg": shot.set_point_deg}


def _verdict_of(path: LightPath) -> dict[str, object]:
    """Level, names of the findings in their order, and how much of the recording is explained."""
    verdict = path.verdict
    row: dict[str, object] = {
        "verdict": str(verdict.level),
        "findings": " ".join(finding.name for finding in verdict.findings),
        "verdict_p_value": verdict.p_value,
    }
    if path.explained is not None:
        row |= {"n_explained": path.explained.n_pulses, "n_found": path.explained.n_found}
    return row


def _flags_of(path: LightPath) -> str:
    """How many pulses bear which flag, as "name=n"."""
    counted = flags.count_flags(path.residuals["flags"])
    return " ".join(f"{name}={n}" for name, n in counted.items())


def _legs_of(path: LightPath) -> list[dict[str, float]]:
    """Angles (deg) and lengths (mm) of each leg, with the photons' share of the error."""
    # The same formula for the angles' errors, with the photons' covariance in place of all.
    photon = path.covariance_parts.get("photon", path.covariance)
    alone = replace(path, covariance=photon)
    return [
        {
            "angle_deg": leg.angle_deg,
            "angle_std_deg": leg.angle_std_deg,
            "angle_photon_std_deg": by_photons.angle_std_deg,
            "paper_angle_deg": leg.paper_angle_deg,
            "length_mm": leg.length_mm,
        }
        for leg, by_photons in zip(path.legs, alone.legs, strict=True)
    ]


def _truth_of(path: LightPath) -> dict[str, float]:
    """Distance from the truth, where a simulation knows it."""
    if path.truth is None:
        return {}
    try:
        error = path_error(path, path.truth, path.camera)
    except (GeometryError, AttributeError):  # another camera, or a truth without a path
        return {}
    return {
        "true_position_rms_mm": error.position_rms_mm,
        "true_event_time_rms_ps": error.event_time_rms_ps,
    }


# --- files -----------------------------------------------------------------------------------


def write_table_csv(table: CampaignTable, file: str | os.PathLike[str]) -> None:
    """Write the table as CSV: one header line, units in the names, UTF-8; whole or not at all."""
    columns = table.columns
    write_csv(columns, ([_cell(row.get(name)) for name in columns] for row in table.rows), file)


def _cell(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return f"{value:.9g}" if math.isfinite(value) else ""
    return str(value)


def write_table_parquet(table: CampaignTable, file: str | os.PathLike[str]) -> None:
    """Write the table as Parquet; whole or not at all.

    Raises
    ------
    MissingExtraError
        Without pyarrow.
    """
    pa = pyarrow()

    def type_of(name: str) -> Any:
        if name == "converged":
            return pa.bool_()
        if name in _WHOLE:
            return pa.int64()
        return pa.string() if name in (*_TEXTS, *_LAST) else pa.float64()

    def values(name: str) -> Sequence[object]:
        return [_without_nan(row.get(name)) for row in table.rows]

    columns = {name: pa.array(values(name), type_of(name)) for name in table.columns}
    write_parquet([columns], file)


def _without_nan(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value
