"""The command line: each command reads records, calls one public function, writes a record.

Only click and the standard library are imported here and at the top of the command files, so
that `lightflight --help` answers at once.
"""

from __future__ import annotations

import click

from lightflight._version import __version__
from lightflight.cli.commands import (
    batch,
    calibrate,
    check,
    convert,
    demo,
    export,
    info,
    init,
    movie,
    paper,
    plan,
    plot,
    reconstruct,
    simulate,
    versions,
    view,
)
from lightflight.cli.errors import EXIT_CODES, SpeakingGroup
from lightflight.cli.options import debug_option

_EPILOG = """\b
A first look, without a lab:
  lightflight demo

\b
With a lab:
  lightflight init
  lightflight info recording.h5
  lightflight calibrate --code-density bright.h5 --flat flat.h5 -o calibration.h5
  lightflight check lab.toml recording.h5 --timing calibration.h5
  lightflight reconstruct recording.h5 --lab lab.toml --timing calibration.h5 -o path.h5
  lightflight view path.h5 --recording recording.h5 --timing calibration.h5

\b
Exit codes:
""" + "\n".join(f"  {code:>3}  {meaning}" for code, meaning in EXIT_CODES.items())


@click.group(
    cls=SpeakingGroup,
    epilog=_EPILOG,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, message="lightflight %(version)s")
@debug_option
def main() -> None:
    """Turn the photons of a SPAD camera into the 4D path of a laser pulse, with error bars.

    Tables go to stdout (--json for programs), files where -o says, progress and warnings to
    stderr.
    """


_COMMANDS = (
    demo, paper, init, plan, simulate, info, convert, calibrate, check, reconstruct, batch, view,
    movie, plot, export, versions,
)  # fmt: skip

for _module in _COMMANDS:
    main.add_command(_module.command)
