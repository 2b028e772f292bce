"""Figures and pages (the only modules that import plotting)."""
