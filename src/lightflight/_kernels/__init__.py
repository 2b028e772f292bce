"""Numba kernels: plain arrays in and out, no checks."""

from lightflight.elsewhere import check_number_of_threads, import_elsewhere

check_number_of_threads()
import_elsewhere("numba", ".numba_config.yaml")
