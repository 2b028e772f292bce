"""What the names of films and exports may end in; here, where asking for it loads nothing."""

from __future__ import annotations

TABLE_SUFFIXES = (".csv", ".parquet")
"""Tables of a path."""

EXPORT_SUFFIXES = (*TABLE_SUFFIXES, ".mat", ".vtu", ".glb")
"""Formats a path can be exported to."""

MOVIE_SUFFIXES = (".mp4", ".gif")
"""Formats of films."""
