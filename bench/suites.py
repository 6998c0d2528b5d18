"""The suites: literal tables of what is measured. The suite is the configuration.

Whatever can move a value beyond its tolerance stands here; the command line chooses only where, how
much and how fast.
"""

from __future__ import annotations

from dataclasses import dataclass

from bench.isolation import Limits
from bench.metric_table import JUDGE


@dataclass(frozen=True)
class Suite:
    """Methods x conditions x objects x views, and the metrics taken of them.

    classes          the classes of the dataset that take part
    image_metrics    of the paper's table of SSIM
    detail_metrics   further image metrics, in a table of their own
    set_metrics      Fréchet distances
    control_metrics  what the judge is asked
    views            random views per object
    endless_limit    objects taken from a dataset without end (the procedural one)
    limits           for one method on one cloud with all its views; what takes more has failed
    """

    id: str
    about: str
    methods: tuple[str, ...]
    conditions: tuple[str, ...]
    classes: tuple[str, ...]
    image_metrics: tuple[str, ...]
    detail_metrics: tuple[str, ...]
    set_metrics: tuple[str, ...]
    control_metrics: tuple[str, ...]
    views: int
    endless_limit: int
    limits: Limits

    @property
    def extractors(self) -> tuple[str, ...]:
        """Whose features the metrics are made from."""
        return (*self.set_metrics, *((JUDGE,) if self.control_metrics else ()))


SUITES = (
    Suite(
        id="chair-robustness",
        about="the paper's Tables 3 and 4: fewer points and noise, on chairs",
        methods=(
            "surface-apss",
            "pc2pix",
            "pc2pix@acgan",
            "splat",
            "true-mesh",
            "constant",
            "blank",
        ),
        conditions=("2048", "1024", "512", "noise-0.05", "noise-0.10"),
        classes=("chair",),
        image_metrics=("ssim", "luminance", "contrast", "structure"),
        detail_metrics=("ssim-object", "thin-recall", "thin-precision"),
        set_metrics=("fid", "fd-views", "fd-views-grey"),
        control_metrics=("azimuth-error-deg", "elevation-error-deg", "retrieval"),
        views=20,
        endless_limit=24,
        limits=Limits(time_s=120.0, memory_gib=4.0),
    ),
)


@dataclass(frozen=True)
class LatentSuite:
    """What lies between codes, and what their differences mean: `bench.latent` runs it.

    methods        networks with a code: pc2pix with any weights
    pairs          of test chairs of different structural families, joined by a path
    positions      on a path, its two ends included
    triples        A - B + C, where A is B with one change
    pool           test chairs that triples are looked for among
    neighbours     train chairs among which the nearest to a sum is looked for
    azimuth_deg, elevation_deg  of the one view that all pictures show
    shown          pairs and triples in the figures
    """

    id: str
    about: str
    methods: tuple[str, ...]
    pairs: int
    positions: int
    triples: int
    pool: int
    neighbours: int
    azimuth_deg: float
    elevation_deg: float
    shown: int


LATENT = LatentSuite(
    id="latent",
    about="the paper's Figures 5 and 6: paths between codes, and A - B + C",
    methods=("pc2pix",),
    pairs=50,
    positions=8,
    triples=60,
    pool=800,
    neighbours=500,
    azimuth_deg=30.0,
    elevation_deg=20.0,
    shown=5,
)


@dataclass(frozen=True)
class StabilitySuite:
    """Extremes, and what is expected of methods, metrics, number formats and libraries there.

    methods     what is put through `bench.stability_cases.CASES`
    class_name  of the one procedural test object
    index       its number
    limits      for one method on one case
    """

    id: str
    about: str
    methods: tuple[str, ...]
    class_name: str
    index: int
    limits: Limits


STABILITY = StabilitySuite(
    id="stability",
    about="extreme clouds, views, pictures and features: a value, an invariant or a named failure",
    methods=SUITES[0].methods,
    class_name="chair",
    index=0,
    limits=Limits(time_s=60.0, memory_gib=4.0),
)
