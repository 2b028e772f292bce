"""Pictures of records: figures, pages, movies, exports (the only modules that import plotting).

Figures take records and Axes (or make a Figure) and return it:

- `draw_path_3d`, `draw_path_on_photo`: the path in space;
- `draw_times`, `draw_time_errors`, `draw_time_std`: the two clocks (paper Fig. 6b);
- `draw_residuals_along`, `draw_residual_map`, `draw_pulls`;
- `draw_camera_picture`, `draw_pixel_histogram`, `pixel_cases_figure` (paper Fig. 2b, 2c);
- `calibration_figure` and its parts `draw_gain_map`, `draw_phases`, `draw_delay_map`,
  `draw_response_widths`, `draw_bad_pixels`;
- `recording_figure` and its parts `draw_counts`, `draw_code_sum`: before anything is fitted;
- `campaign_figure` and its parts `draw_set_points`, `draw_set_point_errors`, `draw_repeat_pulls`;
- `demo_figure`: one page about one reconstruction; `fiber_figure`: without a metric scale.

Pages and films: `write_page`, `write_campaign`; `write_movie`, `write_recording_movie`; `observe`
says what another camera would see, `camera_towards` places one. For other programs: `export_path`,
`write_figure`, `to_xarray`, and for napari `layers_from_path` and `layers_from_histograms`.

Everything is loaded when it is first used: importing this package costs nothing.
"""

import importlib
from typing import Any

_MODULE_FROM_NAME = {
    "MovieSettings": "movie",
    "Viewpoint": "projection",
    "camera_towards": "observation",
    "calibration_figure": "figures_calibration",
    "campaign_figure": "figures_campaign",
    "demo_figure": "figures_demo",
    "draw_bad_pixels": "figures_calibration",
    "draw_camera_picture": "figures_camera",
    "draw_code_sum": "figures_recording",
    "draw_counts": "figures_recording",
    "draw_delay_map": "figures_calibration",
    "draw_gain_map": "figures_calibration",
    "draw_path_3d": "figures_path",
    "draw_path_on_photo": "figures_path",
    "draw_phases": "figures_calibration",
    "draw_pixel_histogram": "figures_camera",
    "draw_pulls": "figures_timing",
    "draw_repeat_pulls": "figures_campaign",
    "draw_residual_map": "figures_timing",
    "draw_residuals_along": "figures_timing",
    "draw_response_widths": "figures_calibration",
    "draw_set_point_errors": "figures_campaign",
    "draw_set_points": "figures_campaign",
    "draw_time_errors": "figures_timing",
    "draw_time_std": "figures_timing",
    "draw_times": "figures_timing",
    "export_path": "export",
    "fiber_figure": "figures_fiber",
    "figure_style": "style",
    "layers_from_histograms": "napari_layers",
    "layers_from_path": "napari_layers",
    "observe": "observation",
    "pixel_cases_figure": "figures_camera",
    "recording_figure": "figures_recording",
    "to_xarray": "arrays",
    "write_campaign": "page.campaign",
    "write_figure": "export",
    "write_movie": "movie",
    "write_page": "page",
    "write_recording_movie": "movie_recording",
}

__all__ = sorted(_MODULE_FROM_NAME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    if name not in _MODULE_FROM_NAME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_MODULE_FROM_NAME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
