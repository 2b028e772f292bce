"""Results in files that other programs open.

`files`: the doors, `write_figure` and `export_path`; `tables`: CSV, Parquet, MATLAB; `vtk`:
ParaView; `gltf`: slides and game engines.
"""

from lightflight._lazy import lazy_names

_NAMES = ("EXPORT_SUFFIXES", "FIGURE_SUFFIXES", "export_path", "write_figure")

__getattr__, __dir__, __all__ = lazy_names(__name__, {"lightflight.view.export.files": _NAMES})
