"""The suites: literal tables of what is measured and shown. The suite is the configuration.

Whatever can move a value beyond its tolerance stands here; the command line chooses only where, how
much and how fast. Of the truth it chooses the colours: a cloud has none, so against truth in
colours a part of every score is luck with the lightness; in grey only the shape counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.metrics import JUDGE, extractor_of
from data_prep.failures import unknown


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

    kind          images           means over objects by `image_metrics`
                  sets             distances by `set_metrics`
                  classes          both by class and in the mean over classes, `class_metrics`
                  detail           means over objects by `detail_metrics`
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


_paper_table = partial(TableSpec, paper_layout=True)
# Titles do not name the truth: `bench.tables.table.of_protocol` adds it to those of all tables.
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
    condition_sweep  metrics by which methods are compared along families of conditions
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
    detail_metrics: tuple[str, ...]
    set_metrics: tuple[str, ...]
    views: int
    endless_limit: int
    classes: tuple[str, ...] = ("chair",)
    image_metrics: tuple[str, ...] = ("ssim", "luminance", "contrast", "structure")
    control_metrics: tuple[str, ...] = ()
    limits: Limits = Limits(time_s=120.0, memory_gib=4.0)
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

    @property
    def metrics(self) -> tuple[str, ...]:
        """Return the metrics that the tables of the suite show."""
        of_images = (*self.image_metrics, *self.detail_metrics)
        return (*of_images, *self.set_metrics, *self.class_metrics, *self.control_metrics)

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


def _ids(text: str) -> tuple[str, ...]:
    """Return the ids in a text, which spaces separate."""
    return tuple(text.split())


RECOGNITION_TABLE = TableSpec(
    "recognition",
    "table_control",
    "Control: does the image show the view and the object that it should?",
)
ROBUSTNESS = Suite(
    id="chair-robustness",
    about="the paper's Tables 3 and 4: fewer points and noise, on chairs",
    methods=_ids(
        "surface-apss alpha-wrap denoised-wrap splat-fill pc2pix pc2pix@acgan splat-net "
        "splat-net@chair fused-net true-mesh true-mesh@grey constant blank"
    ),
    conditions=_ids("2048 1024 512 noise-0.05 noise-0.10"),
    detail_metrics=_ids("psnr ssim-object lpips silhouette-iou thin-recall thin-precision"),
    set_metrics=_ids("fid kid fd-views fd-views-grey fd-alexnet kd-alexnet"),
    control_metrics=_ids("azimuth-error-deg elevation-error-deg retrieval"),
    views=20,
    endless_limit=24,
    grey_methods=_ids("occupancy-net splat-net@grey fused-net@grey"),
    tables=(
        _paper_table(
            "images", "table3_ssim", "Table 3: SSIM and its components (higher is better)"
        ),
        _paper_table(
            "sets", "table4_fid", "Table 4: distances between sets of images (lower is better)"
        ),
        DETAIL_TABLE,
        RECOGNITION_TABLE,
    ),
)
SUITES = (
    ROBUSTNESS,
    Suite(
        id="speed-accuracy",
        about="quality against cost: every method over its parameters, and the frontier",
        methods=(  # the values of a parameter in order: the figure joins them
            *(f"surface-apss@resolution={cells}" for cells in (25, 50, 75, 100, 150)),
            *_ids("surface-apss surface-apss@resolution=300 surface-fit surface-bpa"),
            *(f"surface-bpa@radius={percent}" for percent in (2, 3, 5)),
            *_ids("poisson@depth=5 poisson@depth=6 poisson poisson@depth=8 alpha-wrap"),
            *_ids("denoised-wrap@ball=1.5 denoised-wrap denoised-wrap@ball=3 denoised-wrap@ball=4"),
            *_ids("occupancy-net pc2pix splat-net@chair splat-net"),
            *_ids("fused-net splat@spread=0.5 splat splat@spread=1.5 splat@spread=2 splat-fill"),
            *_ids("true-mesh constant blank"),
        ),
        conditions=_ids("2048 512 noise-0.05"),
        detail_metrics=_ids("psnr ssim-object lpips silhouette-iou"),
        set_metrics=_ids("fd-views fd-alexnet"),
        views=20,
        endless_limit=12,
        frontier=_ids("ssim-object lpips ssim structure silhouette-iou fd-views"),
        timed=True,
        tables=(
            *(IMAGE_TABLE, SET_TABLE, DETAIL_TABLE),
            TableSpec("frontier", "frontier", "Quality against cost"),
            TableSpec("points", "points", "Quality against the number of points"),
        ),
        figures="frontier",
    ),
    Suite(
        id="thirteen-classes",
        about="the paper's Table 5: one network for all classes, class by class",
        methods=_ids(  # pc2pix knows chairs only: what one network for all gains or loses on them
            "surface-apss alpha-wrap denoised-wrap occupancy-net pc2pix@all pc2pix splat-net@grey "
            "fused-net@grey true-mesh blank"
        ),
        conditions=("2048",),
        classes=_ids(  # in the paper's order
            "airplane bench cabinet car chair display lamp loudspeaker rifle sofa table telephone "
            "vessel"
        ),
        detail_metrics=_ids("psnr ssim-object lpips silhouette-iou"),
        set_metrics=_ids("fid fd-views fd-alexnet"),
        views=10,
        endless_limit=20,
        class_metrics=_ids(
            "fid kid fd-views kd-views fd-alexnet kd-alexnet ssim lpips silhouette-iou "
            "class-confidence"
        ),
        tables=(
            replace(IMAGE_TABLE, paper_layout=True),
            _paper_table("classes", "table5_classes", "Table 5: classes"),
            DETAIL_TABLE,
            TableSpec("orderings", "table5_orderings", "Which of the paper's orderings hold"),
        ),
        figures="classes",
    ),
    Suite(
        id="beyond-training",
        about="beyond what networks were trained on: where they fall behind, on chairs",
        methods=_ids(
            "surface-apss alpha-wrap denoised-wrap splat-fill pc2pix splat-net@chair fused-net "
            "blank"
        ),
        conditions=_ids(  # each the worse the later, see FAMILIES in bench/catalogue/conditions.py
            "2048 1024 512 256 128 noise-0.05 noise-0.10 noise-0.15 noise-0.20 outliers-0.01 "
            "outliers-0.05 outliers-0.10 missing-0.25 missing-0.50 density-3 density-10"
        ),
        detail_metrics=ROBUSTNESS.detail_metrics,
        set_metrics=_ids("fd-views fd-alexnet"),
        views=10,
        endless_limit=24,
        condition_sweep=_ids("ssim lpips silhouette-iou fd-views"),
        tables=(
            *(IMAGE_TABLE, SET_TABLE, DETAIL_TABLE),
            TableSpec("condition sweep", "crossings", "Beyond what the networks were trained on"),
        ),
        figures="condition sweep",
    ),
)
LATENT = Procedure(
    id="latent",
    about="the paper's Figures 5 and 6: paths between codes, and A - B + C",
    methods=("pc2pix",),
)
STABILITY = Procedure(
    id="stability",
    about="extreme clouds and views: images, an invariant or a named failure",
    methods=_ids(
        "surface-apss surface-fit surface-bpa poisson alpha-wrap denoised-wrap pc2pix "
        "pc2pix@acgan splat-net@chair splat-net@grey fused-net fused-net@grey occupancy-net "
        "upsampled-wrap splat splat-fill true-mesh constant blank"
    ),
)
SPEED = Procedure(
    id="speed",
    about="the paper's 0.02 s against 0.18 s an image: prepare and draw, cold and warm, amortised",
    methods=_ids(
        "surface-apss surface-fit pc2pix pc2pix@paper splat-net@chair denoised-wrap "
        "occupancy-net fused-net@grey splat splat-fill true-mesh"
    ),
)
PROCEDURES = (LATENT, STABILITY, SPEED)  # which make their tables themselves
ALL_SUITES = (*SUITES, *PROCEDURES)
# The networks behind these were trained on images in colours.
_OF_COLOURS = {"fid", "kid", "fd-views", "kd-views", "class-confidence"}
CEILING = "true-mesh"
_IN_GREY = {"fd-views": "fd-views-grey"}
_WITH_METRICS_OF_SETS = ("set_metrics", "class_metrics", "frontier", "condition_sweep")
# Tables of the paper, which has no truth in grey, under names that do not number them.
_UNNUMBERED: dict[TableKind, TableSpec] = {
    "images": IMAGE_TABLE,
    "sets": SET_TABLE,
    "classes": TableSpec("classes", "table_classes", "Classes"),
}


def with_truth(suite: Suite, truth: str | None) -> Suite:
    """Return the suite with true images in colours or in grey; None leaves it as it is.

    In grey, the list of methods has none that makes up colours and those of `grey_methods`, and
    there are no metrics that need colours, none of the paper's values and no check of its
    orderings. Raises BadInput for an unknown truth.
    """
    if truth is None or truth == "coloured":
        return suite
    if truth not in TRUTHS:
        raise unknown(truth, list(TRUTHS), "truth")
    return replace(
        suite,
        about=f"{suite.about}; here in grey",
        methods=_methods_in_grey(suite),
        **{name: _metrics_in_grey(getattr(suite, name)) for name in _WITH_METRICS_OF_SETS},
        tables=tuple(
            replace(_UNNUMBERED.get(table.kind, table), paper_layout=False)
            for table in suite.tables
            if table.kind != "orderings"
        ),
        truth="grey",
    )


def left_out_in_grey(suite: Suite) -> dict[str, str]:
    """Return the methods that the suite's default list does not have in grey, with the reasons.

    Reference methods stay, but for the grey twin of `true-mesh`.
    """
    reasons = {}
    for method in map(find_method, suite.methods):
        if method.color == "invented" and method.kind != "reference":
            reasons[method.id] = "makes up colours"
        elif method.sees_mesh and method.color == "none" and CEILING in suite.methods:
            reasons[method.id] = f"is {CEILING} in grey"
    return reasons


def _methods_in_grey(suite: Suite) -> tuple[str, ...]:
    left = left_out_in_grey(suite)
    kept = [method for method in suite.methods if method not in left]
    references = [method for method in kept if find_method(method).kind == "reference"]
    compete = [method for method in kept if method not in references]
    return tuple(dict.fromkeys((*compete, *suite.grey_methods, *references)))


def _metrics_in_grey(metrics: Sequence[str]) -> tuple[str, ...]:
    names = (_IN_GREY.get(metric, metric) for metric in metrics)
    return tuple(dict.fromkeys(name for name in names if name not in _OF_COLOURS))


def stored_suite(manifest: Mapping[str, Any]) -> Suite:
    """Return the suite of a run, with the truth of the run. Raises BadInput for unknown ones."""
    return with_truth(find(str(manifest.get("suite")), SUITES, "suite"), manifest.get("truth"))


def truth_entry(suite: Suite) -> dict[str, Truth]:
    """Return the entry of manifests for the truth; none for colours."""
    return {"truth": suite.truth} if suite.truth != "coloured" else {}
