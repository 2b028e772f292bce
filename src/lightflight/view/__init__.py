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
- `figure_of`: that of any record by its name; `plan_figure`;
- `demo_figure`: one page about one reconstruction; `fiber_figure`: without a metric scale.

Pages and films: `write_page`, `write_campaign`; `write_movie`, `write_recording_movie`; `observe`
says what another camera would see, `camera_towards` places one. For other programs: `export_path`,
`write_figure`, `to_xarray`, `dataframe_of`, and for napari `layers_from_path` and
`layers_from_histograms`.

Everything is loaded when it is first used: importing this package costs nothing.
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names
from lightflight.elsewhere import import_elsewhere

import_elsewhere("matplotlib", "matplotlibrc")

if TYPE_CHECKING:
    from lightflight.path.second_view import camera_towards as camera_towards, observe as observe
    from lightflight.view.arrays import to_xarray as to_xarray
    from lightflight.view.export.files import (
        export_path as export_path,
        write_figure as write_figure,
    )
    from lightflight.view.figures.calibration import (
        calibration_figure as calibration_figure,
        draw_bad_pixels as draw_bad_pixels,
        draw_delay_map as draw_delay_map,
        draw_gain_map as draw_gain_map,
        draw_phases as draw_phases,
        draw_response_widths as draw_response_widths,
    )
    from lightflight.view.figures.camera import (
        draw_camera_picture as draw_camera_picture,
        draw_pixel_histogram as draw_pixel_histogram,
        pixel_cases_figure as pixel_cases_figure,
    )
    from lightflight.view.figures.campaign import (
        campaign_figure as campaign_figure,
        draw_repeat_pulls as draw_repeat_pulls,
        draw_set_point_errors as draw_set_point_errors,
        draw_set_points as draw_set_points,
    )
    from lightflight.view.figures.demo import demo_figure as demo_figure
    from lightflight.view.figures.fiber import fiber_figure as fiber_figure
    from lightflight.view.figures.path import (
        draw_path_3d as draw_path_3d,
        draw_path_on_photo as draw_path_on_photo,
    )
    from lightflight.view.figures.plan import plan_figure as plan_figure
    from lightflight.view.figures.pulls import draw_pulls as draw_pulls
    from lightflight.view.figures.recording import (
        draw_code_sum as draw_code_sum,
        draw_counts as draw_counts,
        recording_figure as recording_figure,
    )
    from lightflight.view.figures.timing import (
        draw_residual_map as draw_residual_map,
        draw_residuals_along as draw_residuals_along,
        draw_time_errors as draw_time_errors,
        draw_time_std as draw_time_std,
        draw_times as draw_times,
    )
    from lightflight.view.film.flight import (
        MovieSettings as MovieSettings,
        write_movie as write_movie,
    )
    from lightflight.view.film.recording import write_recording_movie as write_recording_movie
    from lightflight.view.napari_layers import (
        layers_from_histograms as layers_from_histograms,
        layers_from_path as layers_from_path,
    )
    from lightflight.view.page import write_page as write_page
    from lightflight.view.page.campaign import write_campaign as write_campaign
    from lightflight.view.records import dataframe_of as dataframe_of, figure_of as figure_of
    from lightflight.view.style import figure_style as figure_style
    from lightflight.view.viewpoint import Viewpoint as Viewpoint


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.path.second_view": ("camera_towards", "observe"),
        "lightflight.view.arrays": ("to_xarray",),
        "lightflight.view.export.files": ("export_path", "write_figure"),
        "lightflight.view.figures.calibration": (
            "calibration_figure",
            "draw_bad_pixels",
            "draw_delay_map",
            "draw_gain_map",
            "draw_phases",
            "draw_response_widths",
        ),
        "lightflight.view.figures.camera": (
            "draw_camera_picture",
            "draw_pixel_histogram",
            "pixel_cases_figure",
        ),
        "lightflight.view.figures.campaign": (
            "campaign_figure",
            "draw_repeat_pulls",
            "draw_set_point_errors",
            "draw_set_points",
        ),
        "lightflight.view.figures.demo": ("demo_figure",),
        "lightflight.view.figures.fiber": ("fiber_figure",),
        "lightflight.view.figures.path": ("draw_path_3d", "draw_path_on_photo"),
        "lightflight.view.figures.pulls": ("draw_pulls",),
        "lightflight.view.figures.recording": ("draw_code_sum", "draw_counts", "recording_figure"),
        "lightflight.view.figures.timing": (
            "draw_residual_map",
            "draw_residuals_along",
            "draw_time_errors",
            "draw_time_std",
            "draw_times",
        ),
        "lightflight.view.film.flight": ("MovieSettings", "write_movie"),
        "lightflight.view.film.recording": ("write_recording_movie",),
        "lightflight.view.figures.plan": ("plan_figure",),
        "lightflight.view.records": ("dataframe_of", "figure_of"),
        "lightflight.view.napari_layers": ("layers_from_histograms", "layers_from_path"),
        "lightflight.view.page": ("write_page",),
        "lightflight.view.page.campaign": ("write_campaign",),
        "lightflight.view.style": ("figure_style",),
        "lightflight.view.viewpoint": ("Viewpoint",),
    },
)
