"""Parquet tables need an extra: the one place that asks for it."""

from __future__ import annotations

from typing import Any

from lightflight.errors import MissingExtraError


def pyarrow_modules() -> tuple[Any, Any]:
    """(pyarrow, pyarrow.parquet). Raises MissingExtraError where they are not installed."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError(
            'Parquet needs pyarrow, which is not installed: pip install "lightflight[batch]", '
            "or write a .csv"
        ) from error
    return pa, pq
