"""Numba kernels: plain arrays in and out, no checks."""
