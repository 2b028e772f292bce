"""Timing: from histograms to arrival times on one calibrated clock."""
