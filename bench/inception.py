"""`FidInception` by the name that other people's scripts rely on."""

from bench.metrics.inception import FidInception

__all__ = ["FidInception"]
