"""File formats: one thin translator per format, converted to our records at the door.

`lightflight.read` and `lightflight.write` find the format (`registry`). A format is a module
with `FORMATS` (each a `registry.Format`); packages of others add theirs by an entry point of
the group "lightflight.formats" that names one `Format`.

- our own: `lightflight_hdf5` (its layout: `schema`), with `photons` (blocks of them) and `stored`
  (arrays that stay on disk)
- arrays of others: `numpy_files`, `matlab` (v5: `matlab5`), `zarr_cube` (judged by `zarr_store`),
  `hdf5_dataset`, all through `cubes` (which axis is which), `streamed` (slab by slab) and
  `metadata` (what goes along with a cube)
- cameras and counters: `pf32_frames`, `pf32_text`, `ptu`, `sdt`, `spc`, `photon_hdf5`
  (`photon_hdf5_titles`)
- written only: `photon_tables`; read only by the camera's calibration: `point_tables`
- for all: `clock` (hints how codes become times), `isolation` (readers of others, run where they
  can do no harm)
"""
