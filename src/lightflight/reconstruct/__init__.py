"""Reconstruction: from arrival times and counts to the path (x, y, z, t)."""
