"""The types of suites: what a suite declares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bench.catalogue.metrics import JUDGE, extractor_of


@dataclass(frozen=True)
class Limits:
    """The wall time in seconds of a task, and the resident memory in GiB of its worker."""

    time_s: float
    memory_gib: float


TableKind = Literal[
    "images",
    "sets",
    "classes",
    "detail",
    "recognition",
    "orderings",
    "condition sweep",
    "frontier",
    "points",
]

Figures = Literal["robustness", "classes", "condition sweep", "frontier"]

Truth = Literal["coloured", "grey"]
TRUTHS: dict[Truth, str] = {
    "coloured": "the true mesh in its colours",
    "grey": "the true mesh in grey",
}


@dataclass(frozen=True)
class TableSpec:
    """A table of a suite.

    kind          images           means over images by `image_metrics`
                  sets             distances by `set_metrics`
                  classes          both by class and in the mean over classes, `class_metrics`
                  detail           means over images by `detail_metrics`
                  recognition      what the judge recognises, by `control_metrics`
                  orderings        SR against pc2pix in each class, as the paper's Table 5 has them
                  condition sweep  methods along families of conditions
                  frontier         quality against cost
                  points           quality against the number of points
    name          of its files, without suffix
    paper_layout  whether Markdown begins with SR beside PC2PIX and the paper's values
    """

    kind: TableKind
    name: str
    title: str
    paper_layout: bool = False


# Titles do not name the truth: `bench.tables.table.of_truth` adds it to those of all tables.
DETAIL_TABLE = TableSpec(
    "detail", "table_detail", "Detail: the object alone, its outline and its thin parts"
)
IMAGE_TABLE = TableSpec("images", "table_ssim", "SSIM and its components (higher is better)")
SET_TABLE = TableSpec("sets", "table_frechet", "Distances between sets of images (lower is better)")


@dataclass(frozen=True)
class Suite:
    """Methods x conditions x objects x views, the metrics, and the tables and figures of a run.

    classes          the classes of the dataset that take part
    image_metrics    of the paper's table of SSIM
    detail_metrics   further image metrics, in a table of their own
    set_metrics      Fréchet and kernel distances between sets of images
    class_metrics    by class and in the mean over classes, in the paper's Table 5
    control_metrics  what the judge recognises
    views            random views per object
    endless_limit    objects taken from a dataset without end (the procedural one)
    limits           for one method on one cloud with all its views; what takes more has failed
    frontier         metrics that cost is traded for
    condition_sweep  metrics by which methods are compared along `bench.catalogue.families`
    headline         metrics of the table that a run shows while it goes on, and at its end
    truth            true images in the colours of their objects or, by `with_truth` alone, with all
                     faces in neutral grey; points and views are the same
    grey_methods     methods that join the list where the truth is in grey
    timed            whether one worker does all, so that times are taken with nothing beside them
    tables           in the order in which they are shown; without those that a part of a run, or
                     one with few methods, does not give
    figures          the figures in the run's folder
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
    frontier: tuple[str, ...] = ()
    class_metrics: tuple[str, ...] = ()
    condition_sweep: tuple[str, ...] = ()
    headline: tuple[str, ...] = ("ssim-object", "lpips")
    truth: Truth = "coloured"
    grey_methods: tuple[str, ...] = ()
    timed: bool = False
    tables: tuple[TableSpec, ...] = (IMAGE_TABLE, SET_TABLE, DETAIL_TABLE)
    figures: Figures = "robustness"

    @property
    def extractors(self) -> tuple[str, ...]:
        """Return the extractors of the features that the metrics are made from."""
        of_sets = dict.fromkeys(map(extractor_of, self.set_metrics))
        return (*of_sets, *((JUDGE,) if self.control_metrics else ()))

    def table(self, kind: TableKind) -> TableSpec | None:
        """Return the suite's table of a kind; None where it has none."""
        return next((table for table in self.tables if table.kind == kind), None)


@dataclass(frozen=True)
class LatentSuite:
    """Paths between codes and differences of codes, which `bench.suites.latent.run` measures.

    methods        networks with a code: pc2pix with any weights
    pairs          of test chairs of different structural families, joined by a path
    positions      on a path, its two ends included
    triples        sums A - B + C, where A is B with one change
    pool           test chairs that the triples are chosen from
    neighbours     train chairs that the nearest to a sum is chosen from
    azimuth_deg, elevation_deg  of the one view that all images show
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


@dataclass(frozen=True)
class StabilitySuite:
    """A suite of extreme inputs with expected outcomes of methods.

    methods     methods that draw `bench.suites.stability.cases.CASES`
    class_name  class of the one procedural test object
    index       number of that object
    limits      for one method on one case
    """

    id: str
    about: str
    methods: tuple[str, ...]
    class_name: str
    index: int
    limits: Limits


@dataclass(frozen=True)
class SpeedSuite:
    """The cost of images, which `bench.suites.speed.run` measures.

    methods       timed methods, each in a process of its own for each number of threads
    baselines     methods that all others are compared with; the first is the paper's
    conditions    of the clouds
    class_name    class of the objects
    clouds        objects whose clouds are drawn
    views         views of each cloud, drawn in one call
    singles       views that are also drawn one by one, in each round
    warm_ups      rounds over all clouds that are not counted
    least_rounds  fewest counted rounds over all clouds
    most_rounds   most counted rounds over all clouds
    seconds       time after which no further round begins, once there are `least_rounds`
    amortised     numbers of views that the cost per image is given for
    quiet_cores   more cores than these busy with something else: a warning beside the times
    limits        for one measurement
    """

    id: str
    about: str
    methods: tuple[str, ...]
    baselines: tuple[str, ...]
    conditions: tuple[str, ...]
    class_name: str
    clouds: int
    views: int
    singles: int
    warm_ups: int
    least_rounds: int
    most_rounds: int
    seconds: float
    amortised: tuple[int, ...]
    quiet_cores: float
    limits: Limits
