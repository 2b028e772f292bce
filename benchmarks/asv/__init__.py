"""What asv follows from commit to commit: see asv.conf.json."""
