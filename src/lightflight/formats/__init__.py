"""File formats: one thin translator per format, converted to our records at the door.

`lightflight.read` and `lightflight.write` find the format (`registry`). A format is a module
with `FORMATS` (each a `registry.Format`); packages of others add theirs by an entry point of
the group "lightflight.formats" that names one `Format`.

What all formats share: `clock` (the hints that say how codes become times), `cubes` (axes of
arrays whose order is not known), `stored` (arrays that stay on disk), `isolation` (readers of
others, run where they can do no harm).
"""
