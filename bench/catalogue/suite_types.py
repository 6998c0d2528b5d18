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
class Procedure:
    """A suite with a procedure of its own: its name here, all else beside it in `bench.suites`.

    methods  the default ones
    """

    id: str
    about: str
    methods: tuple[str, ...]
