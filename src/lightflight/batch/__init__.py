"""Campaigns: many recordings, or a huge one in pieces, reconstructed on Dask.

- the set-up file and what it names: `campaign` (`campaign_from_toml`, `Campaign`)
- one recording, whole, in pieces or in tiles: `work`, `pieces`, `tiles`, `window`
- one row per recording: `table` (`CampaignTable`)
- all of it on workers, resumed where it stopped: `run` (`run_campaign`), `cluster`

Results do not depend on the number of workers: what a task does follows from the recording and
the set-up alone. Everything a task makes is a file that appears whole or not at all, so that
whatever ends a run, the next one goes on from there. Only `cluster` imports Dask.
"""
