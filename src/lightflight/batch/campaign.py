"""The set-up of a campaign: which recordings, which lab, where the results go.

A campaign file is a lab's set-up file (`lightflight.lab`) with a section `[campaign]` and one
`[[groups]]` for each set of repeats. Paths in it are relative to the file.
"""

from __future__ import annotations

import glob
import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightflight.display import Shown
from lightflight.errors import ConfigError
from lightflight.files import toml_tables as config
from lightflight.files.names import readable
from lightflight.files.toml_tables import Key
from lightflight.lab import SECTIONS, Lab, lab_from_table, table_from_lab, toml_from_lab

_PLACEHOLDER = "{set_point_deg}"
_NUMBER = r"([-+]?\d+(?:\.\d+)?)"


def _texts(value: object) -> tuple[str, ...]:
    """Accept one text, or a list of them."""
    found = (value,) if isinstance(value, str) else value
    if not isinstance(found, list | tuple) or not found or not all(map(_is_text, found)):
        raise ValueError('must be text in quotes ("..."), or a list of such')
    return tuple(found)


def _is_text(value: object) -> bool:
    return isinstance(value, str) and bool(value)


def _at_least(least: float, check: config.Check) -> config.Check:
    """Make a check that accepts what `check` accepts, from `least` on."""

    def checked(value: object) -> float:
        number: float = check(value)
        if number < least:
            raise ValueError(f"must be at least {least:g}")
        return number

    return checked


CAMPAIGN_KEYS = (
    Key("title", "heading of the summary", config.text),
    Key("lab", "set-up file of the lab; sections of the campaign's own go before it", config.text),
    Key("timing", "calibration of the clock, from `lightflight calibrate`", config.text),
    Key("background", "recording of the scene without the flight, by the same camera", config.text),
    Key("output", "folder for the results", config.text),
    Key(
        "leg",
        "leg whose elevation is held against the set-point, the first is 1",
        _at_least(1, config.integer),
    ),
    Key("codes", "keep codes start ... end - 1 alone: (start, end)", config.integers(2)),
    Key(
        "piece_megabytes",
        "a longer recording is counted in pieces of this size",
        _at_least(1, config.number),
    ),
    Key(
        "tile_megabytes",
        "largest cube of counts in one task; a larger one is fitted in tiles",
        _at_least(1, config.number),
    ),
)

GROUP_KEYS = (
    Key("name", "name of this set of repeats", config.text),
    Key(
        "recordings",
        "files, or patterns (*, **); {set_point_deg} stands for the set-point in a name",
        _texts,
    ),
    Key("set_point_deg", "elevation that was set up, deg", config.number),
)

CAMPAIGN_SECTIONS: Mapping[str, Sequence[Key]] = {"campaign": CAMPAIGN_KEYS, "groups": GROUP_KEYS}
"""Sections of a campaign file beside those of a lab."""

DEFAULTS = {
    "title": "",
    "timing": None,
    "background": None,
    "output": "results",
    "leg": 1,
    "codes": None,
    "piece_megabytes": 1000.0,
    "tile_megabytes": 64.0,
}
"""What [campaign] says where it says nothing."""


@dataclass(frozen=True)
class Shot:
    """One recording of a campaign.

    Attributes
    ----------
    path : Path
        The file.
    label : str
        Its name in tables: relative to the campaign file where it lies below it.
    name : str
        Name of what is made from it, without suffix; no two shots share one.
    group : str
        Repeats of one scene are of one group.
    set_point_deg : float or None
        Elevation that was set up, deg; None: not stated.
    """

    path: Path
    label: str
    name: str
    group: str
    set_point_deg: float | None


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(Shown):
    """A campaign as it was understood.

    Attributes
    ----------
    shots : tuple of Shot
        Recordings, in the order of the table.
    lab : Lab
        What is known of the lab.
    title : str
        Heading of the summary.
    timing : Path or None
        Calibration of the clock.
    background : Path or None
        Recording without the pulse.
    output : Path
        Folder for the results.
    leg : int
        Leg whose elevation is held against the set-point, the first is 1.
    codes : (int, int) or None
        Codes that are kept, (start, end); None: all.
    piece_megabytes : float
        Recordings longer than this are counted in pieces.
    tile_megabytes : float
        Cubes larger than this are fitted in tiles.
    file : Path
        The campaign file.
    settings : mapping of str
        Everything that results depend on, as plain values.
    """

    shots: tuple[Shot, ...]
    lab: Lab
    title: str
    timing: Path | None
    background: Path | None
    output: Path
    leg: int
    codes: tuple[int, int] | None
    piece_megabytes: float
    tile_megabytes: float
    file: Path
    settings: Mapping[str, object]


def campaign_from_toml(
    path: str | os.PathLike[str],
    *,
    assignments: Iterable[str] = (),
    output: str | os.PathLike[str] | None = None,
) -> Campaign:
    """Campaign from its file, with `section.key=value` assignments laid over it.

    Parameters
    ----------
    path : path-like
        The campaign file, TOML.
    assignments : iterable of str, optional
        As for `lightflight.files.toml_tables.override_table`.
    output : path-like, optional
        Folder for the results, in place of what the file says; relative to the working folder.

    Returns
    -------
    Campaign
        Every recording by name, and all that is known of the lab.

    Raises
    ------
    ConfigError
        For a missing or broken file, an unknown section or key (it names the nearest valid
        one), patterns that match nothing and recordings that are named twice.
    """
    told = list(assignments)
    table = config.override_table(config.table_from_toml(path), told)
    with config.telling_of(told):
        return _campaign_of(table, Path(path), output)


def _campaign_of(
    table: dict[str, Any], path: Path, output: str | os.PathLike[str] | None
) -> Campaign:
    """`campaign_from_toml`, of what the file and the assignments say."""
    where, base = os.fspath(path), path.absolute().parent
    groups = _checked_groups(table.pop("groups", None), where)
    own = _checked_campaign(table.pop("campaign", {}), where)
    _check_other_sections(table, where)
    lab_file = own.pop("lab", None)
    lab = _lab_of(table, None if lab_file is None else base / lab_file, where)
    values = {**DEFAULTS, **own}
    for name in ("timing", "background"):
        values[name] = None if values[name] is None else base / values[name]
    values["output"] = base / values["output"] if output is None else Path(output).absolute()
    codes = values["codes"]
    if codes is not None and not 0 <= codes[0] < codes[1]:
        raise ConfigError(f"{where}: [campaign] codes must be (start, end), start < end: {codes}")
    # A pattern may well reach into the folder of results, or match what is no shot.
    others = [values[k] for k in ("timing", "background", "output") if values[k] is not None]
    return Campaign(
        shots=_shots_of(groups, base, others, where),
        lab=lab,
        file=path,
        settings=_settings_of(lab, codes, values["tile_megabytes"]),
        **values,
    )


def _settings_of(lab: Lab, codes: Sequence[int] | None, tile_megabytes: float) -> dict[str, object]:
    """What results depend on. Pieces are not among it: counts are whole numbers."""
    window = {"codes": None if codes is None else list(codes), "tile_megabytes": tile_megabytes}
    return {**table_from_lab(lab), "campaign": window}


def _checked_campaign(table: object, where: str) -> dict[str, Any]:
    """Keys of [campaign], each as it must be."""
    if not isinstance(table, Mapping):
        raise ConfigError(f"{where}: 'campaign' must be a section, [campaign], got {table!r}")
    return config.checked_table(table, CAMPAIGN_KEYS, section="campaign", where=where)


def _checked_groups(tables: object, where: str) -> list[dict[str, object]]:
    """Keys of every [[groups]]; there is one at least, and each names recordings."""
    if tables is None:
        raise ConfigError(f"{where}: names no recordings: write [[groups]] with recordings = [...]")
    if not isinstance(tables, list) or not all(isinstance(one, Mapping) for one in tables):
        raise ConfigError(f"{where}: groups must be sections in double brackets, [[groups]]")
    groups = []
    for number, table in enumerate(tables, 1):
        group = config.checked_table(table, GROUP_KEYS, section="groups", where=where)
        if "recordings" not in group:
            raise ConfigError(f"{where}: [[groups]] number {number} lacks recordings = [...]")
        groups.append(group)
    return groups


def _check_other_sections(table: Mapping[str, object], where: str) -> None:
    """Unknown sections are refused here, with those of campaigns among the guesses."""
    known = [*CAMPAIGN_SECTIONS, *SECTIONS]
    keys = {key.name: name for name, keys in CAMPAIGN_SECTIONS.items() for key in keys}
    for name in table:
        if name in known:
            continue
        if name in keys:
            raise ConfigError(f"{where}: {name!r} must stand under [{keys[name]}]")
        hint = config.unknown_name_sentence(name, known)
        raise ConfigError(f"{where}: unknown section {name!r}; {hint}")


def _lab_of(table: Mapping[str, object], lab_file: Path | None, where: str) -> Lab:
    """Lab of the campaign's own sections, laid key by key over those of the lab's file."""
    if lab_file is None:
        return lab_from_table(table, where=where)
    merged = config.table_from_toml(lab_file)
    lab_from_table(merged, where=os.fspath(lab_file))  # its own mistakes are its own
    for section, values in table.items():
        if isinstance(values, Mapping) and isinstance(merged.get(section, {}), Mapping):
            merged[section] = {**merged.get(section, {}), **values}
        else:
            merged[section] = values
    return lab_from_table(merged, where=where)


# --- recordings ------------------------------------------------------------------------------


def _shots_of(
    groups: list[dict[str, Any]], base: Path, others: Sequence[Path], where: str
) -> tuple[Shot, ...]:
    """Recordings of all groups; patterns leave out `others` and what lies below them."""
    found: list[tuple[Path, str | None, float | None]] = []
    for group in groups:
        for pattern in group["recordings"]:
            for path, told in _matches(pattern, base, others, where):
                set_point = group.get("set_point_deg", told)
                found.append((path, group.get("name"), set_point))
    paths = [path for path, _, _ in found]
    most = Counter(paths).most_common(1)
    if most and most[0][1] > 1:
        raise ConfigError(f"{where}: {_label(most[0][0], base)} is named twice in [[groups]]")
    names = _names([_label(path, base) for path in paths])
    return tuple(
        Shot(path, _label(path, base), name, _group_name(given, set_point), set_point)
        for (path, given, set_point), name in zip(found, names, strict=True)
    )


def _group_name(given: str | None, set_point_deg: float | None) -> str:
    """Name of a set of repeats: as stated, else by its set-point, else none."""
    if given is not None:
        return given
    return "" if set_point_deg is None else f"{set_point_deg:g} deg"


def _matches(
    pattern: str, base: Path, others: Sequence[Path], where: str
) -> list[tuple[Path, float | None]]:
    """Files of one pattern with the set-point their names tell, by set-point, then by name."""
    outright = _PLACEHOLDER not in pattern and not glob.has_magic(pattern)
    if outright or (base / pattern).exists():
        return [(base / pattern, None)]  # if it is missing, its row says so
    if pattern.count(_PLACEHOLDER) > 1:
        raise ConfigError(f"{where}: recordings {pattern!r} holds {_PLACEHOLDER} more than once")
    whole = os.path.join(glob.escape(str(base)), pattern)  # noqa: PTH118  (keeps a rooted pattern)
    files = map(Path, glob.glob(whole.replace(_PLACEHOLDER, "*"), recursive=True))  # noqa: PTH207
    found = []
    for file in files:
        if any(file.is_relative_to(other) for other in others) or not _may_hold_photons(file):
            continue
        told = _set_point(str(file), whole) if _PLACEHOLDER in pattern else None
        if told is not None or _PLACEHOLDER not in pattern:
            found.append((file, told))
    if not found:
        raise ConfigError(f"{where}: recordings {pattern!r}: no file matches")
    return sorted(found, key=lambda one: (one[1] or 0.0, _natural(one[0].as_posix())))


def _may_hold_photons(path: Path) -> bool:
    """Whether a match gets a row: all but folders that are no Zarr; links into nothing, too."""
    return not path.is_dir() or path.suffix.lower() == ".zarr"


def _set_point(file: str, pattern: str) -> float | None:
    """The number that stands for the placeholder; None where there is none."""
    before, after = (_expression(part) for part in pattern.split(_PLACEHOLDER))
    told = re.fullmatch(before + _NUMBER + after, file)
    return None if told is None else float(told.group(1))


def _expression(pattern: str) -> str:
    """Regular expression of the part of a glob pattern before or after the placeholder."""
    parts = re.split(r"(\*\*/?|\*|\?|\[[^]]*\])", pattern)
    meaning = {"*": "[^/]*", "**": ".*", "**/": "(?:.*/)?", "?": "[^/]"}
    return "".join(
        meaning.get(part, part.replace("[!", "[^") if k % 2 else re.escape(part))
        for k, part in enumerate(parts)
    )


def _natural(text: str) -> list[tuple[int, int | str]]:
    """Sort key under which run2 comes before run10."""
    parts = re.split(r"(\d+)", text)
    return [(0, int(part)) if part.isdigit() else (1, part) for part in parts]


def _label(path: Path, base: Path) -> str:
    """Name of a recording in tables: relative to the campaign file where it lies below it."""
    path, base = Path(os.path.normpath(path)), Path(os.path.normpath(base))
    short = path.relative_to(base) if path.is_relative_to(base) else path
    return readable(short.as_posix())


def _stem(label: str) -> str:
    """A label without its suffix."""
    return str(Path(label).with_suffix("")).strip("/")


def _names(labels: Sequence[str]) -> list[str]:
    """File names for what is made from each recording: its label, folders and all."""
    names = [re.sub(r"[^\w.+-]+", "_", _stem(label)) for label in labels]
    times = Counter(names)
    # By digest, not by number: a name must not change when recordings are added to the campaign.
    return [
        name if times[name] == 1 else f"{name}-{hashlib.sha256(label.encode()).hexdigest()[:8]}"
        for name, label in zip(names, labels, strict=True)
    ]


# --- for --dry-run ---------------------------------------------------------------------------


def toml_from_campaign(campaign: Campaign) -> str:
    """Text of a campaign file that gives the same campaign, every default and file spelled out.

    Parameters
    ----------
    campaign : Campaign
        As it was understood.

    Returns
    -------
    str
        TOML; paths are absolute, patterns are the files they matched.
    """
    import tomli_w

    own = {
        name: value if not isinstance(value, tuple) else list(value)
        for name in DEFAULTS
        if (value := getattr(campaign, name)) is not None
    }
    own = {k: os.fspath(v) if isinstance(v, Path) else v for k, v in own.items()}
    groups: dict[tuple[str, float | None], list[str]] = {}
    for shot in campaign.shots:
        groups.setdefault((shot.group, shot.set_point_deg), []).append(os.fspath(shot.path))
    tables = [
        {"name": name, "recordings": files}
        | ({} if set_point is None else {"set_point_deg": set_point})
        for (name, set_point), files in groups.items()
    ]
    head = tomli_w.dumps({"campaign": own, "groups": tables})
    return f"{head}\n{toml_from_lab(campaign.lab)}"
