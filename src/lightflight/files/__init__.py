"""Our own files, and what every file is asked before it is believed.

- any file, whole or not at all: `whole_file`; what HDF5 writes to: `disk_file`; what killed
  writers left: `litter`; names that are no UTF-8: `names`
- our versioned HDF5: `store`, with a digest over everything: `digest`; tables: `tables`; what JSON
  can hold: `json_values`
- set-up files: `toml_tables`
- arrays that stay in their file: `mapped`
- checks before memory is taken, and who is to blame for what is raised: `filecheck`
- how every child process is started: `children`
"""
