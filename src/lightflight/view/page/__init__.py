"""One offline HTML page about one reconstruction, with both clocks to play with.

`write_page` takes a LightPath (and its recording and clock, where at hand) and writes a file that
needs nothing but a browser: no request leaves it.
"""

from lightflight.view.page.build import page_html, write_page

__all__ = ["page_html", "write_page"]
