"""Campaigns: many recordings, or a huge one in pieces, reconstructed on Dask.

- the set-up file and what it names: `campaign` (`campaign_from_toml`, `Campaign`)
- one recording on a worker: `job` says what to do, `work` does it, whole, in `pieces` or in `tiles`
  (each with a `window` of the clock)
- what tasks leave for each other and for the next run: `kept`; what was warned of: `warnings_said`
- one row per recording: `table` (`CampaignTable`, `Repeats`)
- all of it on workers, resumed where it stopped: `runner` (`run_campaign`), `cluster`

Results do not depend on the number of workers: what a task does follows from the recording and
the set-up alone. Everything a task makes is a file that appears whole or not at all, so that
whatever ends a run, the next one goes on from there. Only `cluster` imports Dask.
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.batch.campaign import (
        Campaign as Campaign,
        campaign_from_toml as campaign_from_toml,
    )
    from lightflight.batch.runner import (
        Status as Status,
        StoppedError as StoppedError,
        run_campaign as run_campaign,
    )
    from lightflight.batch.table import CampaignTable as CampaignTable, Repeats as Repeats


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.batch.campaign": ("Campaign", "campaign_from_toml"),
        "lightflight.batch.runner": ("Status", "StoppedError", "run_campaign"),
        "lightflight.batch.table": ("CampaignTable", "Repeats"),
    },
)
