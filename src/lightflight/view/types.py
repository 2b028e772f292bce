"""Types that several files of `view` name."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

FilePath = str | os.PathLike[str]
Json = dict[str, Any]
"""An object of a page's data or of a glTF document: JSON nests without end."""
Floats = NDArray[np.float64]
Whole = NDArray[np.int64]
Marks = NDArray[np.bool_]
