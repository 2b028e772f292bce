"""[block] of a set-up: blocks of glass that stand in the beam."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lightflight.blocks import Block
from lightflight.flight import Medium
from lightflight.lab.window import material_of
from lightflight.materials import AIR, Material

_NEEDED = ("center_mm", "normal", "thickness_mm", "diameter_mm")


def blocks_from_table(table: Mapping[str, Any]) -> tuple[Block, ...]:
    """Blocks of a set-up.

    Parameters
    ----------
    table : mapping of str
        [block].

    Returns
    -------
    tuple of Block
        () where the table is empty.

    Raises
    ------
    ValueError
        For keys that are missing or do not go together.
    """
    if not table:
        return ()
    if "blocks" in table:
        stray = sorted(set(table) - {"blocks"})
        if stray:
            raise ValueError(f"give either blocks or {', '.join(stray)}, not both")
        return tuple(map(_block_of_row, np.asarray(table["blocks"], dtype=float)))
    missing = [key for key in _NEEDED if key not in table]
    if missing:
        raise ValueError(f"{missing[0]} is missing: where the block stands, and how large it is")
    glass = material_of(table, "glass")
    if glass is None:
        raise ValueError("glass (or glass_indices) is missing: what the block is of")
    around = material_of(table, "around") or AIR
    return (Block(**{key: table[key] for key in _NEEDED}, glass=glass, around=around),)


def table_from_blocks(medium: Medium) -> dict[str, object]:
    """[block] of a medium; empty where no block stands in the beam."""
    return {"blocks": [_row_of_block(block) for block in medium.blocks]} if medium.blocks else {}


def _block_of_row(row: Any) -> Block:
    return Block(
        row[:3], row[3:6], thickness_mm=row[6], diameter_mm=row[7],
        glass=Material(*row[8:10]), around=Material(*row[10:]),
    )  # fmt: skip


def _row_of_block(block: Block) -> list[float]:
    indices = [
        index for one in (block.glass, block.around) for index in (one.phase_index, one.group_index)
    ]
    place = np.concatenate((np.asarray(block.center_mm), np.asarray(block.normal))).tolist()
    return [*place, block.thickness_mm, block.diameter_mm, *indices]
