"""Libraries that look for settings in the current folder find none among recordings.

Numba would take the name of a folder of pickles from there (`.numba_config.yaml`), Matplotlib
programs to run (`matplotlibrc`). Settings in the home folder and the environment stand.
"""

from __future__ import annotations

import importlib
import os
import sys


def import_elsewhere(module: str, settings: str) -> None:
    """Import a module from another folder, where the current one holds settings for it.

    Parameters
    ----------
    module : str
        Its name. Nothing is done where it is imported already.
    settings : str
        Name of the file that it would read.
    """
    if module in sys.modules or not os.path.lexists(settings):
        return
    here = os.getcwd()  # noqa: PTH109  (Path is not needed for anything else here)
    os.chdir(sys.prefix)
    try:
        importlib.import_module(module)
    finally:
        os.chdir(here)


def check_number_of_threads() -> None:
    """Raise ValueError where Numba would not start for what NUMBA_NUM_THREADS says.

    What is no number it passes over itself.
    """
    told = os.environ.get("NUMBA_NUM_THREADS", "")
    try:
        if "numba" in sys.modules or int(told) > 0:
            return
    except ValueError:
        return
    raise ValueError(
        f"NUMBA_NUM_THREADS is {told} in the environment: set it to 1 or more, or unset it"
    )
