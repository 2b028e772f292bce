"""A LightPath as tables, as facts and as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lightflight.cli.console import (
    Fact,
    print_facts,
    print_headline,
    print_sentences,
    print_table,
    with_error,
)
from lightflight.cli.errors import NotTrustedError
from lightflight.cli.options import RECORD_SUFFIXES

if TYPE_CHECKING:
    from lightflight.path.alternative import Alternative
    from lightflight.path.light_path import LightPath


def path_facts(path: LightPath) -> list[Fact]:
    """How a path was found and how well it explains the recording.

    Parameters
    ----------
    path : LightPath
        The path.

    Returns
    -------
    list of Fact
        Estimator, prior, residuals, and the distance from the truth where it is known.
    """
    good = path.goodness
    facts = [
        Fact("estimator", "method", path.method),
        Fact("prior", "prior", path.prior),
        Fact("legs", "n_legs", path.n_legs),
        *_fork_facts(path),
        Fact("emission time", "emission_time_ps", path.emission_time_ps,
             f"{with_error(path.emission_time_ps, float(path.vertex_std[0, 3]))} ps"),
        Fact("pulses used", "n_pulses", good.n_pulses,
             f"{good.n_pulses:,} ({good.n_rejected:,} left out as outliers)"),
        Fact("residuals (rms)", "residual_rms_ps", good.residual_rms_ps,
             f"{good.residual_rms_ps:.2f} ps"),
        Fact("chi2 / degrees of freedom", "reduced_chi2", good.reduced_chi2, good.chi2_in_words),
    ]  # fmt: skip
    if good.error_floor_ps > 0:
        facts.append(
            Fact("extra scatter", "error_floor_ps", good.error_floor_ps, good.floor_in_words)
        )
    if not good.converged:
        facts.append(Fact("converged", "converged", False, "NO: do not trust the errors"))
    return [*facts, *truth_facts(path)]


def _fork_facts(path: LightPath) -> list[Fact]:
    """On how many branches the light goes, and where they leave; nothing of a chain."""
    if not path.forks:
        return []
    where = ", ".join(f"leg {leg + 1} begins at vertex {vertex}" for leg, vertex in path.forks)
    n_branches = len(path.ends) - 1
    return [Fact("branches", "n_branches", n_branches, f"{n_branches}: {where}")]


def truth_facts(path: LightPath) -> list[Fact]:
    """How far a path is from the truth, where a simulation knows it.

    Parameters
    ----------
    path : LightPath
        The path, with the `truth` of its recording.

    Returns
    -------
    list of Fact
        Rms of position (mm) and event time (ps) in view, or why they cannot be told; none for a
        real recording.
    """
    if path.truth is None:
        return []
    if not hasattr(path.truth, "vertices_mm"):
        return [Fact("simulated truth", "truth", None, "knows no path to compare with")]
    from lightflight.errors import GeometryError
    from lightflight.path.error import path_error

    try:
        error = path_error(path, path.truth, path.camera)
    except GeometryError as reason:  # the set-up's camera is not the one that was simulated
        return [Fact("simulated truth", "truth", None, f"not compared with: {reason}")]
    return [
        Fact("position error in view (rms)", "position_rms_mm", error.position_rms_mm,
             f"{error.position_rms_mm:.3f} mm from the simulated truth"),
        Fact("time error in view (rms)", "event_time_rms_ps", error.event_time_rms_ps,
             f"{error.event_time_rms_ps:.3f} ps from the simulated truth"),
    ]  # fmt: skip


def print_verdict(path: LightPath) -> None:
    """Print what may be relied on: level, findings, what they leave unseen, what was exact.

    Parameters
    ----------
    path : LightPath
        The path.
    """
    verdict = path.verdict
    print_headline(verdict)
    if verdict.findings:
        print_table(
            ("finding", "what was seen", "what to do", "σ"),
            [
                (
                    f"{k}  {finding.name}",
                    finding.sentence,
                    finding.remedy,
                    f"{finding.sigma:.1f}" if finding.sigma else "–",
                )
                for k, finding in enumerate(verdict.findings, start=1)
            ],
            n_text_columns=3,
        )
    facts = []
    if verdict.findings:
        # Of the first: the page holds all names.
        page = f"what-can-go-wrong#{verdict.findings[0].name}, in the documentation"
        facts.append(Fact("what it means", "page", page, page))
    if path.explained is not None:
        facts.append(Fact("explains", "explained", path.explained, str(path.explained)))
    exact = [price.replace(" exact:", ":", 1) for price in path.prices]
    others = [_other_answer(one) for one in path.alternatives]
    for head, lines in (
        ("other answers", others), ("blind to", verdict.blind_to), ("taken as exact", exact),
    ):  # fmt: skip
        facts += [Fact("" if k else head, head, line, str(line)) for k, line in enumerate(lines)]
    if facts:
        print_facts(facts)


def _other_answer(other: Alternative) -> str:
    """What is different in another answer, how likely it is, and how its legs rise."""
    angles = (with_error(one.angle_deg, one.angle_std_deg) for one in other.path.legs)
    return f"{other}: elevation {', '.join(angles)} deg"


def print_path(path: LightPath) -> None:
    """Print verdict, facts, vertices, legs and statements to stdout.

    Parameters
    ----------
    path : LightPath
        The path.
    """
    print_verdict(path)
    print_facts(path_facts(path))
    print_table(
        ("vertex", "x (mm)", "y (mm)", "z (mm)", "event time (ps)"),
        [
            (
                _vertex_name(path, i),
                *(with_error(v, s) for v, s in zip(position, std[:3], strict=True)),
                with_error(time, std[3]),
            )
            for i, (position, time, std) in enumerate(
                zip(path.vertices_mm, path.vertex_times_ps, path.vertex_std, strict=True)
            )
        ],
    )
    # Of a chain each leg goes from the vertex of its number to the next.
    forked = bool(path.forks)
    print_table(
        ("leg", "elevation (deg)", "paper's angle (deg)", "length (mm)"),
        [
            (
                f"{i + 1}  {leg.start_vertex} to {leg.end_vertex}" if forked else str(i + 1),
                with_error(leg.angle_deg, leg.angle_std_deg) if leg.seen else "unseen",
                f"{leg.paper_angle_deg:.3f}" if leg.seen else "",
                f"{leg.length_mm:.2f}" if leg.seen else "open",
            )
            for i, leg in enumerate(path.legs)
        ],
    )
    print_sentences(
        f"After leg {gap.after_leg + 1} the light was out of the picture: {gap.in_words}."
        for gap in path.gaps
    )
    print_sentences(path.statements)


def _vertex_name(path: LightPath, i: int) -> str:
    """Number of a vertex and what lies there."""
    if i in path.open_vertices:
        return f"{i}  mirror, open"
    if i == 0:
        return "0  source" if path.source.position_mm is not None else "0  entry into view"
    if i in {vertex for _, vertex in path.forks}:
        return f"{i}  splitter"
    if {i - 1, i} & set(path.legs_in_glass):
        return f"{i}  face of glass"
    return f"{i}  exit from view" if i in path.ends else f"{i}  corner"


def json_from_verdict(path: LightPath) -> dict[str, Any]:
    """The verdict on a path, and what belongs to it, for programs.

    Parameters
    ----------
    path : LightPath
        The path.

    Returns
    -------
    dict of str
        `verdict` as path files hold it, `explained` (None where not known), `prices`,
        `second_pulse` (None: none), and `alternatives`, other paths that explain the recording.
    """
    return {
        "verdict": path.verdict.to_json(),
        "explained": None if path.explained is None else asdict(path.explained),
        "prices": path.prices,
        "second_pulse": None if path.second_pulse is None else asdict(path.second_pulse),
        "alternatives": [
            {
                "says": other.says,
                "log_evidence": other.log_evidence,
                "vertices_mm": other.path.vertices_mm,
                "vertex_times_ps": other.path.vertex_times_ps,
                "vertex_std_mm": other.path.vertex_std[:, :3],
                "vertex_time_std_ps": other.path.vertex_std[:, 3],
            }
            for other in path.alternatives
        ],
    }


def refuse_unless_trusted(path: LightPath | None, *, strict: bool) -> None:
    """End a command that was asked to be strict, once everything is written.

    Parameters
    ----------
    path : LightPath or None
        The path; None: there is none to judge.
    strict : bool
        False: any verdict will do.

    Raises
    ------
    NotTrustedError
        For "check" and "contradicted" alike, and without a path.
    """
    if strict and path is None:
        raise NotTrustedError("--strict: there is no path, so there is no verdict on it")
    if strict and path is not None and path.verdict.level != "trust":
        raise NotTrustedError(f"--strict: {path.verdict}")


def json_from_path(path: LightPath) -> dict[str, Any]:
    """Everything a program wants to know of a path.

    Parameters
    ----------
    path : LightPath
        The path.

    Returns
    -------
    dict of str
        Names end in their units; lists follow the order of flight.
    """
    facts = {fact.key: fact.value for fact in path_facts(path)}
    return (
        json_from_verdict(path)
        | facts
        | {
            "chi2": path.goodness.chi2,
            "chi2_with_floor": path.goodness.chi2_with_floor,
            "dof": path.goodness.dof,
            "n_rejected": path.goodness.n_rejected,
            "error_floor_ps": path.goodness.error_floor_ps,
            "converged": path.goodness.converged,
            "vertices_mm": path.vertices_mm,
            "vertex_times_ps": path.vertex_times_ps,
            "vertex_std_mm": path.vertex_std[:, :3],
            "vertex_time_std_ps": path.vertex_std[:, 3],
            "legs": [
                {
                    "angle_deg": leg.angle_deg,
                    "angle_std_deg": leg.angle_std_deg,
                    "paper_angle_deg": leg.paper_angle_deg,
                    "direction": leg.direction,
                    "length_mm": leg.length_mm,
                    "seen": leg.seen,
                    "number": leg.number,
                    "parent": leg.parent,
                    "start_vertex": leg.start_vertex,
                    "end_vertex": leg.end_vertex,
                }
                for leg in path.legs
            ],
            "forks": path.forks,
            "gaps": [asdict(gap) | {"farthest_mm": gap.farthest_mm} for gap in path.gaps],
            "statements": path.statements,
        }
    )


def write_path(path: LightPath, output: Path) -> None:
    """Write a path as what the suffix of a file says; whole or not at all.

    Parameters
    ----------
    path : LightPath
        The path.
    output : Path
        A path file (.h5 .hdf5), points along it (.csv), else a figure.
    """
    suffix = output.suffix.lower()
    if suffix in RECORD_SUFFIXES:
        path.save(output)
    elif suffix == ".csv":
        from lightflight.view.export.tables import write_csv

        write_csv(path, output)
    else:
        from lightflight.view.export.files import write_figure
        from lightflight.view.figures.demo import demo_figure

        write_figure(demo_figure(path), output)
