"""The likelihood of every count: pixels too dim to show a pulse of their own still count.

- `counts`: one camera's, on their way to a `climb`; `photon`: from a start to the top
- `pooled`: a start in starved light; `strangers`: pulses that are not the path's
"""
