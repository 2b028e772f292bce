"""Let `python -m lightflight` do what `lightflight` does."""

import os
import sys

if __name__ == "__main__":
    # Python puts the current folder first: a json.py among recordings would run in its own's place.
    # Without pathlib, which would be loaded from there, too.
    home = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120
    try:
        here = os.getcwd()  # noqa: PTH109
    except OSError:  # it was taken away
        here = ""
    if sys.path[0] in ("", here) and sys.path[0] != home:
        del sys.path[0]

from lightflight.cli import main

if __name__ == "__main__":
    main(prog_name="lightflight")
