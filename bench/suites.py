"""The suites: literal tables of what is measured. The suite is the configuration.

Whatever can move a value beyond its tolerance stands here; the command line chooses only where, how
much and how fast.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Suite:
    """Methods x conditions x objects x views, and the metrics taken of them.

    classes       the classes of the dataset that take part
    views         random views per object
    endless_limit objects taken from a dataset without end (the procedural one)
    time_limit_s  for one method on one cloud with all its views; what takes longer has failed
    """

    id: str
    about: str
    methods: tuple[str, ...]
    conditions: tuple[str, ...]
    classes: tuple[str, ...]
    image_metrics: tuple[str, ...]
    set_metrics: tuple[str, ...]
    views: int
    endless_limit: int
    time_limit_s: float


SUITES = (
    Suite(
        id="chair-robustness",
        about="the paper's Tables 3 and 4: fewer points and noise, on chairs",
        methods=("surface-apss", "pc2pix", "splat", "true-mesh", "blank"),
        conditions=("2048", "1024", "512", "noise-0.05", "noise-0.10"),
        classes=("chair",),
        image_metrics=("ssim", "luminance", "contrast", "structure"),
        set_metrics=("fid", "fd-views"),
        views=20,
        endless_limit=24,
        time_limit_s=120.0,
    ),
)
