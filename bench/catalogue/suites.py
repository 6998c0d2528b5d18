"""The suites: literal tables of what is measured and shown. The suite is the configuration.

Whatever can move a value beyond its tolerance stands here; the command line chooses only where, how
much and how fast.
"""

from __future__ import annotations

from dataclasses import replace

from bench.catalogue.suite_types import (
    DETAIL_TABLE,
    IMAGE_TABLE,
    SET_TABLE,
    Limits,
    Procedure,
    Suite,
    TableSpec,
)


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
        "surface-apss alpha-wrap denoised-wrap pc2pix pc2pix@acgan splat-net splat-net@chair "
        "fused-net true-mesh true-mesh@grey constant blank"
    ),
    conditions=("2048", "1024", "512", "noise-0.05", "noise-0.10"),
    classes=("chair",),
    image_metrics=("ssim", "luminance", "contrast", "structure"),
    detail_metrics=_ids("psnr ssim-object lpips silhouette-iou thin-recall thin-precision"),
    set_metrics=("fid", "kid", "fd-views", "fd-views-grey", "fd-alexnet", "kd-alexnet"),
    control_metrics=("azimuth-error-deg", "elevation-error-deg", "retrieval"),
    views=20,
    endless_limit=24,
    limits=Limits(time_s=120.0, memory_gib=4.0),
    grey_methods=("occupancy-net", "splat-net@grey", "fused-net@grey"),
    tables=(
        TableSpec(
            "images",
            "table3_ssim",
            "Table 3: SSIM and its components (higher is better)",
            paper_layout=True,
        ),
        TableSpec(
            "sets",
            "table4_fid",
            "Table 4: distances between sets of images (lower is better)",
            paper_layout=True,
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
            "surface-apss",
            "surface-apss@resolution=300",
            "surface-fit",
            "surface-bpa",
            *(f"surface-bpa@radius={percent}" for percent in (2, 3, 5)),
            *(f"poisson@depth={depth}" for depth in (5, 6)),
            "poisson",
            "poisson@depth=8",
            "alpha-wrap",
            "denoised-wrap@ball=1.5",
            "denoised-wrap",
            *(f"denoised-wrap@ball={spacings}" for spacings in (3, 4)),
            "occupancy-net",
            "pc2pix",
            "pc2pix@paper",
            "splat-net@chair",
            "splat-net@tiny",
            "splat-net",
            "fused-net",
            "splat@spread=0.5",
            "splat",
            "splat@spread=1.5",
            "splat@spread=2",
            "splat-fill",
            "true-mesh",
            "constant",
            "blank",
        ),
        conditions=("2048", "512", "noise-0.05"),
        classes=("chair",),
        image_metrics=("ssim", "luminance", "contrast", "structure"),
        detail_metrics=("psnr", "ssim-object", "lpips", "silhouette-iou"),
        set_metrics=("fd-views", "fd-alexnet"),
        control_metrics=(),
        views=20,
        endless_limit=12,
        limits=Limits(time_s=120.0, memory_gib=4.0),
        frontier=("ssim-object", "lpips", "ssim", "structure", "silhouette-iou", "fd-views"),
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
        methods=(
            "surface-apss",
            "alpha-wrap",
            "denoised-wrap",
            "occupancy-net",
            "pc2pix@all",
            "pc2pix",  # knows chairs only: what one network for all gains or loses on them
            "splat-net@grey",
            "fused-net@grey",
            "true-mesh",
            "blank",
        ),
        conditions=("2048",),
        classes=(  # in the paper's order
            *("airplane", "bench", "cabinet", "car", "chair", "display", "lamp"),
            *("loudspeaker", "rifle", "sofa", "table", "telephone", "vessel"),
        ),
        image_metrics=("ssim", "luminance", "contrast", "structure"),
        detail_metrics=("psnr", "ssim-object", "lpips", "silhouette-iou"),
        set_metrics=("fid", "fd-views", "fd-alexnet"),
        control_metrics=(),
        views=10,
        endless_limit=20,
        limits=Limits(time_s=120.0, memory_gib=4.0),
        class_metrics=(
            *("fid", "kid", "fd-views", "kd-views", "fd-alexnet", "kd-alexnet"),
            *("ssim", "lpips", "silhouette-iou", "class-confidence"),
        ),
        tables=(
            replace(IMAGE_TABLE, paper_layout=True),
            TableSpec("classes", "table5_classes", "Table 5: classes", paper_layout=True),
            DETAIL_TABLE,
            TableSpec("orderings", "table5_orderings", "Which of the paper's orderings hold"),
        ),
        figures="classes",
    ),
    Suite(
        id="beyond-training",
        about="beyond what networks were trained on: where they fall behind, on chairs",
        methods=(
            *("surface-apss", "alpha-wrap", "denoised-wrap"),
            *("pc2pix", "splat-net@chair", "fused-net", "blank"),
        ),
        conditions=(  # each the worse the later, see bench/catalogue/families.py
            *("2048", "1024", "512", "256", "128"),
            *("noise-0.05", "noise-0.10", "noise-0.15", "noise-0.20"),
            *("outliers-0.01", "outliers-0.05", "outliers-0.10"),
            *("missing-0.25", "missing-0.50"),
            *("density-3", "density-10"),
        ),
        classes=("chair",),
        image_metrics=ROBUSTNESS.image_metrics,
        detail_metrics=ROBUSTNESS.detail_metrics,
        set_metrics=("fd-views", "fd-alexnet"),
        control_metrics=(),
        views=10,
        endless_limit=24,
        limits=Limits(time_s=120.0, memory_gib=4.0),
        condition_sweep=("ssim", "lpips", "silhouette-iou", "fd-views"),
        tables=(
            IMAGE_TABLE,
            SET_TABLE,
            DETAIL_TABLE,
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
        "pc2pix@acgan splat-net@chair splat-net@grey splat-net@tiny-grey fused-net "
        "fused-net@grey occupancy-net splat splat-fill true-mesh constant blank"
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
