"""Films: a flight by both clocks, or the recording itself."""
