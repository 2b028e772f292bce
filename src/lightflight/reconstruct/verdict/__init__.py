"""Whether a path may be trusted: what its recording says against it, and what it cannot say.

- `examine`: all `evidence` on a path; `judge`: from evidence to a verdict
- score tests on times and lines: `geometry_tests`, of `candidates`; causes whose `places` are
  looked for: `glass`, `jumps`; on counts: `count_tests`, `count_evidence`
- causes freed in a fit of their own: `freed`; where legs lost their pulses: `lost`; what `free=`
  is to reach: `asked`
- other paths: `detours`, `bent`, `arms`, `hidden`, `doubtful`, `alternatives`
- what is noticed without a test: `bookkeeping`; light taken up, and unseen: `taken_up`,
  `unseen_light`, `lopsided`; what an error that nothing shows moves: `blind`
"""
