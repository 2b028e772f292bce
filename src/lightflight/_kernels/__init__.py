"""Numba kernels: plain arrays in and out, no checks."""

from lightflight.elsewhere import import_elsewhere

import_elsewhere("numba", ".numba_config.yaml")
