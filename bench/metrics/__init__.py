"""The metrics of the benchmark for scripts of other people: these names stay as they are.

Each module is imported when its metric is first used, as `bench list` needs none of them.
`bench.metrics.inception` has the network whose features the Fréchet distance compares.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.metrics.frechet import frechet_distance
    from bench.metrics.lpips_network import lpips
    from bench.metrics.peak_signal_to_noise import psnr
    from bench.metrics.structural_similarity import ssim

__all__ = ["frechet_distance", "lpips", "psnr", "ssim"]

_MODULES = {
    "frechet_distance": "frechet",
    "lpips": "lpips_network",
    "psnr": "peak_signal_to_noise",
    "ssim": "structural_similarity",
}


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> object:
    """Return a metric, from the module that has it.

    Raises AttributeError for other names.
    """
    if name not in _MODULES:
        raise AttributeError(f"module 'bench.metrics' has no attribute '{name}'")
    return getattr(import_module(f"bench.metrics.{_MODULES[name]}"), name)
