"""`lightflight versions`: what a bug report needs."""

from __future__ import annotations

import click

from lightflight.cli.console import Fact, print_facts, print_json
from lightflight.cli.options import debug_option, json_option

_PACKAGES = (
    "numpy", "scipy", "numba", "h5py", "click", "rich", "matplotlib", "tomli-w",
    "ptufile", "sdtfile", "tifffile", "opencv-python-headless", "imageio-ffmpeg",
    "dask", "distributed", "zarr", "pyarrow",
)  # fmt: skip


@click.command("versions", short_help="Print what a bug report needs.")
@json_option
@debug_option
def command(*, as_json: bool) -> None:
    """Print the versions of lightflight, Python and the packages it uses.

    \b
    Example:
      lightflight versions --json > versions.json
    """
    import os
    import platform

    from lightflight._version import __version__
    from lightflight.provenance import version_of

    facts = {
        "lightflight": __version__,
        "python": f"{platform.python_version()} ({platform.python_implementation()})",
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "cores": os.cpu_count(),
    } | {name: version_of(name) for name in _PACKAGES}
    if as_json:
        print_json(facts)
    else:
        print_facts(Fact(k, k, v, "not installed" if v is None else None) for k, v in facts.items())
