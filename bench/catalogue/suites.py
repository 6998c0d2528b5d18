"""The suites: tables in code that say what a run measures and shows.

Every setting that can move a value beyond its tolerance stands here. The command line chooses where
a run is carried out, with how much data and how fast. It also chooses whether true images are in
colours or in grey. A cloud has no colours, so that a score against true images in colours depends
in part on whether a method happens to guess the lightness; in grey it depends on the shape alone.
A third question gives clouds the colours of their objects, as scanners do.
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
    """The time and memory that a task may use before it is ended and counts as failed."""

    time_s: float  # seconds by the clock
    memory_gib: float  # resident memory of the worker that does the task


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

Truth = Literal["coloured", "grey", "coloured-clouds"]
TRUTHS: dict[Truth, str] = {
    "coloured": "the true mesh in its colours",
    "grey": "the true mesh in grey",
    "coloured-clouds": "the true mesh in its colours, from clouds with colours",
}


@dataclass(frozen=True)
class TableSpec:
    """A table that a suite declares.

    kind          images           the means over objects of the suite's `image_metrics`
                  sets             its `set_metrics`, which are distances between sets of images
                  classes          its `class_metrics` in each class, and their means over classes
                  detail           the means over objects of its `detail_metrics`
                  recognition      its `control_metrics`: what the judge recognises in images
                  orderings        whether the surface reconstruction of the paper (SR) or pc2pix is
                                   ahead in each class, beside the paper's Table 5
                  condition sweep  how methods compare along families of conditions
                  frontier         quality against cost
                  points           quality against the number of points
    name          the name of its files, without suffix
    paper_layout  whether its Markdown begins with the two methods of the paper, SR and PC2PIX, side
                  by side with the paper's values
    """

    kind: TableKind
    name: str
    title: str
    paper_layout: bool = False


_paper_table = partial(TableSpec, paper_layout=True)
# No title says whether true images are in colours or in grey: `bench.tables.table.of_protocol` adds
# that to the titles of all tables.
DETAIL_TABLE = TableSpec(
    "detail", "table_detail", "Detail: the object alone, its outline and its thin parts"
)
IMAGE_TABLE = TableSpec("images", "table_ssim", "SSIM and its components (higher is better)")
CLASS_TABLE = TableSpec("classes", "table_classes", "Classes")
SET_TABLE = TableSpec("sets", "table_frechet", "Distances between sets of images (lower is better)")


@dataclass(frozen=True)
class Suite:
    """The protocol of a run: it measures every method at every condition on every object and view.

    A suite also declares the metrics, and the tables and figures that show them.

    classes          the classes of the dataset whose objects are drawn; () for all that it has
    image_metrics    the metrics of the paper's table of SSIM
    detail_metrics   further metrics of single images, which have a table of their own
    set_metrics      Fréchet and kernel distances between sets of images
    class_metrics    the metrics that the table of classes shows, as the paper's Table 5 does
    control_metrics  the metrics of what the judge recognises in an image
    views            the number of random views of each object
    endless_limit    the number of objects of each class that are taken from a dataset that can
                     make any number of them, as the procedural one can
    limits           what one method may use for one cloud with all its views
    frontier         the metrics whose values are compared with the cost of an image
    condition_sweep  the metrics by which methods are compared along families of conditions
    headline         the metrics of the short table that a run prints while it goes on, and at its
                     end
    truth            whether true images have the colours of their objects, or all faces in neutral
                     grey, or clouds have the colours of their objects, too. Only `with_truth` sets
                     another than the first. Points and views are the same with all
    default_truth    the truth of a run that asks for none
    grey_methods     methods that are added to `methods` where no method has to make up colours
    timed            whether a single worker does all jobs, so that no other job disturbs its times
    tables           the tables, in the order in which they are shown. A run lacks those that its
                     objects or methods do not suffice for
    figures          the set of figures that is drawn into the run's folder
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
    default_truth: Truth = "coloured"
    grey_methods: tuple[str, ...] = ()
    timed: bool = False
    tables: tuple[TableSpec, ...] = (IMAGE_TABLE, SET_TABLE, DETAIL_TABLE)
    figures: Figures = "robustness"

    @property
    def extractors(self) -> tuple[str, ...]:
        """Return the ids of the extractors whose features the metrics of the suite need."""
        extractors = list(dict.fromkeys(map(extractor_of, self.set_metrics)))
        if self.control_metrics:
            extractors.append(JUDGE)
        return tuple(extractors)

    @property
    def metrics(self) -> tuple[str, ...]:
        """Return the metrics that the tables of the suite show."""
        return (
            *self.image_metrics,
            *self.detail_metrics,
            *self.set_metrics,
            *self.class_metrics,
            *self.control_metrics,
        )

    def table(self, kind: TableKind) -> TableSpec | None:
        """Return the suite's table of a kind; None where it has none."""
        return next((table for table in self.tables if table.kind == kind), None)


@dataclass(frozen=True)
class Procedure:
    """A suite that measures something else than images of objects under conditions.

    Its package in `bench.suites` has the code; here are the facts that lists of suites need.

    methods  the methods that it measures by default
    """

    id: str
    about: str
    methods: tuple[str, ...]


def _ids(text: str) -> tuple[str, ...]:
    """Return the ids in a text, where they stand with spaces between them."""
    return tuple(text.split())


RECOGNITION_TABLE = TableSpec(
    "recognition",
    "table_control",
    "Control: does the image show the view and the object that it should?",
)
OWN_MESHES = "own-meshes"  # the suite that a folder of any classes is measured by
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
        methods=(  # the variants of a method in the order of their values: the figure joins them
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
            IMAGE_TABLE,
            SET_TABLE,
            DETAIL_TABLE,
            TableSpec("frontier", "frontier", "Quality against cost"),
            TableSpec("points", "points", "Quality against the number of points"),
        ),
        figures="frontier",
    ),
    Suite(
        id="thirteen-classes",
        about="the paper's Table 5: one network for all classes, class by class",
        # pc2pix was trained on chairs alone. Beside pc2pix@all it shows what one network for all
        # classes gains or loses on chairs.
        methods=_ids(
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
        # The conditions of a kind stand in the order of FAMILIES of bench/catalogue/conditions.py.
        # Scans are no family, for nothing numeric lies between them and the whole cloud.
        conditions=_ids(
            "2048 1024 512 256 128 8192 32768 noise-0.05 noise-0.10 noise-0.15 noise-0.20 "
            "outliers-0.01 outliers-0.05 outliers-0.10 missing-0.25 missing-0.50 density-3 "
            "density-10 three-views one-side"
        ),
        detail_metrics=ROBUSTNESS.detail_metrics,
        set_metrics=_ids("fd-views fd-alexnet"),
        views=10,
        endless_limit=24,
        condition_sweep=_ids("ssim lpips silhouette-iou fd-views"),
        tables=(
            IMAGE_TABLE,
            SET_TABLE,
            DETAIL_TABLE,
            TableSpec("condition sweep", "crossings", "Beyond what the networks were trained on"),
        ),
        figures="condition sweep",
    ),
    Suite(
        id=OWN_MESHES,
        about="all classes of your own folder of meshes, clean, sparse and noisy",
        methods=_ids(
            "surface-apss alpha-wrap denoised-wrap occupancy-net pc2pix@all splat-net fused-net "
            "true-mesh blank"
        ),
        conditions=_ids("2048 512 noise-0.05 noise-0.10"),
        classes=(),
        detail_metrics=_ids("psnr ssim-object lpips silhouette-iou"),
        set_metrics=("fd-alexnet",),  # the judges know the classes of their training alone
        views=8,
        endless_limit=4,
        class_metrics=_ids("ssim lpips silhouette-iou fd-alexnet"),
        default_truth="grey",  # a cloud tells the shape, and rarely the colours
        grey_methods=_ids("splat-net@grey fused-net@grey"),
        tables=(IMAGE_TABLE, CLASS_TABLE, DETAIL_TABLE),
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
    about="the paper's 0.02 s against 0.18 s an image: prepare and draw, amortised",
    methods=_ids(
        "surface-apss surface-fit pc2pix pc2pix@paper splat-net@chair denoised-wrap "
        "occupancy-net fused-net@grey splat splat-fill true-mesh"
    ),
)
PROCEDURES = (LATENT, STABILITY, SPEED)
ALL_SUITES = (*SUITES, *PROCEDURES)
# Metrics that are left out where true images are in grey: their networks were trained on images in
# colours.
_COLOUR_METRICS = {"fid", "kid", "fd-views", "kd-views", "class-confidence"}
CEILING = "true-mesh"  # the method that draws the true mesh in its colours
_GREY_METRICS = {"fd-views": "fd-views-grey"}  # metrics that others replace in grey
# The fields of a suite that may name metrics of _COLOUR_METRICS.
_METRIC_FIELDS = ("set_metrics", "class_metrics", "frontier", "condition_sweep")
# Tables in place of those whose names and titles have the number of a table of the paper, for the
# paper has no true images in grey, and no clouds with colours.
_UNNUMBERED: dict[TableKind, TableSpec] = {
    "images": IMAGE_TABLE,
    "sets": SET_TABLE,
    "classes": CLASS_TABLE,
}


def with_truth(suite: Suite, truth: Truth | None) -> Suite:
    """Return the suite with another truth; None means true images in colours.

    In grey, and where clouds have colours, methods that make up colours are left out and
    `grey_methods` are added. The paper's values and the check of the paper's orderings are left
    out, too, and in grey metrics that need colours. Raises BadInput for an unknown truth.
    """
    if truth is None or truth == "coloured":
        return suite
    if truth not in TRUTHS:
        raise unknown(truth, list(TRUTHS), "truth")
    about, metrics = f"{suite.about}; here of clouds with colours", {}
    if truth == "grey":
        about = f"{suite.about}; here in grey"
        metrics = {field: _metrics_in_grey(getattr(suite, field)) for field in _METRIC_FIELDS}
    tables = []
    for table in suite.tables:
        if table.kind == "orderings":  # which needs the paper's values, that are of colours
            continue
        tables.append(replace(_UNNUMBERED.get(table.kind, table), paper_layout=False))
    return replace(
        suite,
        about=about,
        methods=_methods_of(suite, truth),
        tables=tuple(tables),
        truth=truth,
        **metrics,
    )


def left_out(suite: Suite, truth: Truth) -> dict[str, str]:
    """Return the methods of a suite that a truth other than "coloured" leaves out, with reasons.

    Reference methods are kept, except in grey `true-mesh@grey`, whose images are those of
    `true-mesh` then.
    """
    in_grey = truth == "grey" and CEILING in suite.methods
    reasons = {}
    for method in map(find_method, suite.methods):
        if method.color == "invented" and method.kind != "reference":
            reasons[method.id] = "makes up colours"
        elif in_grey and method.sees_mesh and method.color == "none":
            reasons[method.id] = f"is {CEILING} in grey"
    return reasons


def _methods_of(suite: Suite, truth: Truth) -> tuple[str, ...]:
    reasons = left_out(suite, truth)
    kept = [method for method in suite.methods if method not in reasons]
    references = [method for method in kept if find_method(method).kind == "reference"]
    competing = [method for method in kept if method not in references]
    return tuple(dict.fromkeys((*competing, *suite.grey_methods, *references)))


def _metrics_in_grey(metrics: Sequence[str]) -> tuple[str, ...]:
    """Return metrics with those of colours replaced or left out, each once."""
    names = [_GREY_METRICS.get(metric, metric) for metric in metrics]
    return tuple(dict.fromkeys(name for name in names if name not in _COLOUR_METRICS))


def stored_suite(manifest: Mapping[str, Any]) -> Suite:
    """Return the suite that the manifest of a run names, with the run's true images.

    Raises BadInput where the suite or the truth is unknown.
    """
    return with_truth(find(str(manifest.get("suite")), SUITES, "suite"), manifest.get("truth"))


def truth_entry(suite: Suite) -> dict[str, Truth]:
    """Return the entry "truth" that a manifest gets; empty where true images are in colours."""
    return {"truth": suite.truth} if suite.truth != "coloured" else {}
