"""`lightflight paper`: says where the paper's experiments went."""

from __future__ import annotations

import click

_WENT = (
    "the paper's experiments are no longer part of the package: run `make paper` in a checkout of "
    'lightflight, with what followed here as ARGS="..."'
)


@click.command(
    "paper",
    hidden=True,
    context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
)
def command() -> None:
    """Say where the paper's experiments went, and end with exit code 2.

    They are no longer part of the package: run `make paper` in a checkout of lightflight.
    """
    raise ValueError(_WENT)
