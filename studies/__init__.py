"""Studies made with lightflight: they import the package, are run from a checkout."""
