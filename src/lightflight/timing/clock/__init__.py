"""The calibrated clock: a record, its code edges, and the shapes of pulses it records."""
