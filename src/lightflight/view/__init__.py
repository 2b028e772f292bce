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

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names
from lightflight.elsewhere import import_elsewhere

import_elsewhere("matplotlib", "matplotlibrc")

if TYPE_CHECKING:
    from lightflight.path.second_view import camera_towards, observe
    from lightflight.view.arrays import to_xarray
    from lightflight.view.export.files import export_path, write_figure
    from lightflight.view.figures.calibration import (
        calibration_figure,
        draw_bad_pixels,
        draw_delay_map,
        draw_gain_map,
        draw_phases,
        draw_response_widths,
    )
    from lightflight.view.figures.camera import (
        draw_camera_picture,
        draw_pixel_histogram,
        pixel_cases_figure,
    )
    from lightflight.view.figures.campaign import (
        campaign_figure,
        draw_repeat_pulls,
        draw_set_point_errors,
        draw_set_points,
    )
    from lightflight.view.figures.demo import demo_figure
    from lightflight.view.figures.fiber import fiber_figure
    from lightflight.view.figures.path import draw_path_3d, draw_path_on_photo
    from lightflight.view.figures.recording import draw_code_sum, draw_counts, recording_figure
    from lightflight.view.figures.timing import (
        draw_pulls,
        draw_residual_map,
        draw_residuals_along,
        draw_time_errors,
        draw_time_std,
        draw_times,
    )
    from lightflight.view.film.flight import MovieSettings, write_movie
    from lightflight.view.film.recording import write_recording_movie
    from lightflight.view.napari_layers import layers_from_histograms, layers_from_path
    from lightflight.view.page import write_page
    from lightflight.view.page.campaign import write_campaign
    from lightflight.view.style import figure_style
    from lightflight.view.viewpoint import Viewpoint

__all__ = [
    "MovieSettings",
    "Viewpoint",
    "calibration_figure",
    "camera_towards",
    "campaign_figure",
    "demo_figure",
    "draw_bad_pixels",
    "draw_camera_picture",
    "draw_code_sum",
    "draw_counts",
    "draw_delay_map",
    "draw_gain_map",
    "draw_path_3d",
    "draw_path_on_photo",
    "draw_phases",
    "draw_pixel_histogram",
    "draw_pulls",
    "draw_repeat_pulls",
    "draw_residual_map",
    "draw_residuals_along",
    "draw_response_widths",
    "draw_set_point_errors",
    "draw_set_points",
    "draw_time_errors",
    "draw_time_std",
    "draw_times",
    "export_path",
    "fiber_figure",
    "figure_style",
    "layers_from_histograms",
    "layers_from_path",
    "observe",
    "pixel_cases_figure",
    "recording_figure",
    "to_xarray",
    "write_campaign",
    "write_figure",
    "write_movie",
    "write_page",
    "write_recording_movie",
]

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "MovieSettings": "lightflight.view.film.flight",
        "Viewpoint": "lightflight.view.viewpoint",
        "calibration_figure": "lightflight.view.figures.calibration",
        "camera_towards": "lightflight.path.second_view",
        "campaign_figure": "lightflight.view.figures.campaign",
        "demo_figure": "lightflight.view.figures.demo",
        "draw_bad_pixels": "lightflight.view.figures.calibration",
        "draw_camera_picture": "lightflight.view.figures.camera",
        "draw_code_sum": "lightflight.view.figures.recording",
        "draw_counts": "lightflight.view.figures.recording",
        "draw_delay_map": "lightflight.view.figures.calibration",
        "draw_gain_map": "lightflight.view.figures.calibration",
        "draw_path_3d": "lightflight.view.figures.path",
        "draw_path_on_photo": "lightflight.view.figures.path",
        "draw_phases": "lightflight.view.figures.calibration",
        "draw_pixel_histogram": "lightflight.view.figures.camera",
        "draw_pulls": "lightflight.view.figures.timing",
        "draw_repeat_pulls": "lightflight.view.figures.campaign",
        "draw_residual_map": "lightflight.view.figures.timing",
        "draw_residuals_along": "lightflight.view.figures.timing",
        "draw_response_widths": "lightflight.view.figures.calibration",
        "draw_set_point_errors": "lightflight.view.figures.campaign",
        "draw_set_points": "lightflight.view.figures.campaign",
        "draw_time_errors": "lightflight.view.figures.timing",
        "draw_time_std": "lightflight.view.figures.timing",
        "draw_times": "lightflight.view.figures.timing",
        "export_path": "lightflight.view.export.files",
        "fiber_figure": "lightflight.view.figures.fiber",
        "figure_style": "lightflight.view.style",
        "layers_from_histograms": "lightflight.view.napari_layers",
        "layers_from_path": "lightflight.view.napari_layers",
        "observe": "lightflight.path.second_view",
        "pixel_cases_figure": "lightflight.view.figures.camera",
        "recording_figure": "lightflight.view.figures.recording",
        "to_xarray": "lightflight.view.arrays",
        "write_campaign": "lightflight.view.page.campaign",
        "write_figure": "lightflight.view.export.files",
        "write_movie": "lightflight.view.film.flight",
        "write_page": "lightflight.view.page",
        "write_recording_movie": "lightflight.view.film.recording",
    },
)
