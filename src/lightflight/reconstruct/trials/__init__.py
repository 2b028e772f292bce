"""Paths with other legs, each fitted to the same recording: one more, one less, unseen.

- second thoughts on a fit: `revise`, on light that no leg explains: `unclaimed`
- legs that nobody saw: `unseen`; arms of a beam splitter: `arms`; legs that another camera
  shows: `images`
- two that explain a recording alike: `rivals`, by how likely it is under each: `marginal`
- a trial that comes to nothing: `outcome`
"""
