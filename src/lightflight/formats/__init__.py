"""File formats: one thin reader per format, converted to our records at the door."""
