"""The metrics of the benchmark, by the names that other people's scripts may rely on.

Pure functions in float64. Importing this module needs NumPy only: what must run a network
first (the features of a Fréchet distance) lives in a module of its own (`bench.inception`).
"""

from __future__ import annotations

from bench.frechet import frechet_distance
from bench.ssim import ssim

__all__ = ["frechet_distance", "ssim"]
