"""Figures: each takes records and Axes, or makes a Figure and returns it."""
