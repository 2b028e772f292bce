"""Whether a path may be trusted: what its recording says against it, and what it cannot say."""
