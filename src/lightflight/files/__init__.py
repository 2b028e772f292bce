"""Our own files, and what every file is asked before it is believed.

- any file, whole or not at all: `whole_file`; what HDF5 writes to: `disk_file`
- our versioned HDF5: `store`; Parquet: `parquet`
- set-up files: `toml_tables`
- checks before memory is taken: `filecheck`
"""
