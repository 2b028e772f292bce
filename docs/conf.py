"""Sphinx: how the pages under docs/ are built (`make docs`). No network is used."""

import sys
from pathlib import Path

import lightflight

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "lightflight"
author = "The lightflight developers"
release = lightflight.__version__
html_title = f"lightflight {release}"

extensions = [
    "myst_parser",
    "numpydoc",
    "offline_math",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_ext", "_templates", "README.md", "gallery/GALLERY_HEADER.rst"]
templates_path = ["_templates"]

myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

# Docstrings write `name` for code, as Markdown does.
default_role = "code"
autosummary_generate = True
autosummary_context = {"exported": lightflight.__all__}  # have pages of their own
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "Floats", "Indices")}
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
add_module_names = False

# Every script of examples/gallery is run, and becomes a page and a notebook
# (decisions/0018).
sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "gallery.Order",
    "image_scrapers": ("gallery.figures_of_block",),
    "capture_repr": (),
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 3600,  # seconds are the machine's, not the reader's
    "download_all_examples": False,
    "thumbnail_size": (400, 280),
}

# "GNU/Linux" and the like never break a build; a missing page or name does.
nitpicky = False

html_theme = "pydata_sphinx_theme"
html_static_path = ["_static"]
html_css_files = ["page.css"]
html_js_files = ["names.js"]
html_show_sourcelink = False
html_copy_source = False
html_sidebars = {"observer": [], "what-can-go-wrong": []}  # pages by themselves
html_context = {"default_mode": "auto"}
html_theme_options = {
    "logo": {"text": "lightflight"},
    "navbar_persistent": ["search-field"],
    "navbar_end": ["theme-switcher"],
    "navbar_align": "left",
    "header_links_before_dropdown": 8,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": True,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
copyright = "The lightflight developers"
