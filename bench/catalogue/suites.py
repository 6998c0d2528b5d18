"""The suites: literal tables of what is measured. The suite is the configuration.

Whatever can move a value beyond its tolerance stands here; the command line chooses only where, how
much and how fast.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from bench.catalogue.metrics import JUDGE, extractor_of


@dataclass(frozen=True)
class Limits:
    """What one task may take: wall time in seconds, resident memory of its worker in GiB."""

    time_s: float
    memory_gib: float


@dataclass(frozen=True)
class Suite:
    """Methods x conditions x objects x views, and the metrics taken of them.

    classes          the classes of the dataset that take part
    image_metrics    of the paper's table of SSIM
    detail_metrics   further image metrics, in a table of their own
    set_metrics      Fréchet and kernel distances between sets of images
    class_metrics    by class and in the mean over classes, in the paper's Table 5
    control_metrics  what the judge is asked
    views            random views per object
    endless_limit    objects taken from a dataset without end (the procedural one)
    limits           for one method on one cloud with all its views; what takes more has failed
    frontier         metrics that cost is traded for; where there are any, one worker does all, so
                     that times are taken with nothing beside them
    crossings        metrics by which methods are compared along `bench.catalogue.families`
    headline         metrics of the table that a run shows while it goes on, and at its end
    painted          whether true images have the colours of their objects, else all faces are in
                     neutral grey; points and views are the same
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
    painted: bool = True

    @property
    def extractors(self) -> tuple[str, ...]:
        """Whose features the metrics are made from."""
        own = dict.fromkeys(map(extractor_of, self.set_metrics))
        return (*own, *((JUDGE,) if self.control_metrics else ()))


ROBUSTNESS = Suite(
    id="chair-robustness",
    about="the paper's Tables 3 and 4: fewer points and noise, on chairs",
    methods=(
        "surface-apss",
        "alpha-shape",
        "denoised-alpha",
        "pc2pix",
        "pc2pix@acgan",
        "splat-net",
        "splat-net@grey",
        "splat",
        "true-mesh",
        "true-mesh@grey",
        "constant",
        "blank",
    ),
    conditions=("2048", "1024", "512", "noise-0.05", "noise-0.10"),
    classes=("chair",),
    image_metrics=("ssim", "luminance", "contrast", "structure"),
    detail_metrics=(
        "psnr",
        "ssim-object",
        "lpips",
        "silhouette-iou",
        "thin-recall",
        "thin-precision",
    ),
    set_metrics=("fid", "kid", "fd-views", "fd-views-grey", "fd-alexnet", "kd-alexnet"),
    control_metrics=("azimuth-error-deg", "elevation-error-deg", "retrieval"),
    views=20,
    endless_limit=24,
    limits=Limits(time_s=120.0, memory_gib=4.0),
)

SUITES = (
    ROBUSTNESS,
    replace(
        ROBUSTNESS,
        id="chair-robustness-grey",
        about="the same chairs, clouds and views in neutral grey: drawing without colour",
        methods=(  # that make up no colour
            "surface-apss",
            "surface-bpa",
            "alpha-shape",
            "denoised-alpha",
            "denoised-bpa",
            "splat-net@grey",
            "splat",
            "true-mesh",
            "constant",
            "blank",
        ),
        set_metrics=("fd-views-grey", "fd-alexnet", "kd-alexnet"),
        painted=False,
    ),
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
            *(f"alpha-shape@alpha={percent}" for percent in (2, 3)),
            "alpha-shape",
            "alpha-shape@alpha=8",
            "denoised-alpha",
            *(f"denoised-bpa@strength={strength}" for strength in (0, 0.5)),
            "denoised-bpa",
            "denoised-bpa@strength=2",
            "denoised-poisson",
            "pgr@width=0.5",
            "pgr",
            *(f"pgr@width={width}" for width in (2, 4)),
            "pc2pix@bf16",
            "pc2pix",
            "pc2pix@unfolded",
            "pc2pix@one-by-one",
            "pc2pix@paper-bf16",
            "pc2pix@paper",
            "splat-net@tiny",
            "splat-net@no-normals",
            "splat-net@bf16",
            "splat-net",
            "splat-net@large",
            "splat@spread=0.5",
            "splat",
            "splat@spread=1.5",
            "splat@spread=2",
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
        frontier=("ssim", "structure", "lpips", "silhouette-iou", "fd-views"),
    ),
    Suite(
        id="thirteen-classes",
        about="the paper's Table 5: one network for all classes, class by class",
        methods=(
            "surface-apss",
            "surface-fit",
            "alpha-shape",
            "denoised-alpha",
            "pc2pix@all",
            "pc2pix",  # knows chairs only: what one network for all gains or loses on them
            "splat-net",  # likewise
            "splat",
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
        endless_limit=30,
        limits=Limits(time_s=120.0, memory_gib=4.0),
        class_metrics=(
            *("fid", "kid", "fd-views", "kd-views", "fd-alexnet", "kd-alexnet"),
            *("ssim", "lpips", "silhouette-iou", "class-confidence"),
        ),
    ),
    Suite(
        id="beyond-training",
        about="beyond what networks were trained on: where they fall behind, on chairs",
        methods=(
            *("surface-apss", "surface-fit", "alpha-shape", "denoised-alpha", "denoised-bpa"),
            *("pc2pix", "splat-net", "splat", "blank"),
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
    ),
)


@dataclass(frozen=True)
class LatentSuite:
    """What lies between codes, and what their differences mean: `bench.suites.latent.run` runs it.

    methods        networks with a code: pc2pix with any weights
    pairs          of test chairs of different structural families, joined by a path
    positions      on a path, its two ends included
    triples        A - B + C, where A is B with one change
    pool           test chairs that triples are looked for among
    neighbours     train chairs among which the nearest to a sum is looked for
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
    """Extremes, and what is expected of methods, metrics and number formats there.

    methods     what is put through `bench.suites.stability.cases.CASES`
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
    methods=(
        "surface-apss",
        "surface-fit",
        "surface-bpa",
        "poisson",
        "alpha-shape",
        "denoised-bpa",
        "denoised-alpha",
        "denoised-poisson",
        "pgr",
        "pc2pix",
        "pc2pix@bf16",
        "pc2pix@acgan",
        "splat-net",
        "splat-net@bf16",
        "splat-net@tiny",
        "splat",
        "true-mesh",
        "constant",
        "blank",
    ),
    class_name="chair",
    index=0,
    limits=Limits(time_s=60.0, memory_gib=4.0),
)


@dataclass(frozen=True)
class SpeedSuite:
    """What images cost: `bench.suites.speed.run` takes the times.

    methods       what is timed, each in a process of its own for each number of threads
    rivals        methods that all others are compared with; the first is the paper's
    conditions    of the clouds
    class_name    of the objects
    clouds        objects whose clouds are drawn
    views         of each cloud, drawn in one call
    singles       of these that are also drawn one by one, in each round
    warm_ups      rounds over all clouds that are not counted
    least_rounds  counted rounds over all clouds, at least
    most_rounds   and at most
    seconds       after which no further round is begun, once there are `least_rounds`
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


SPEED = SpeedSuite(
    id="speed",
    about="the paper's 0.02 s against 0.18 s a picture: prepare and draw, cold and warm, amortised",
    methods=(
        "surface-apss",
        "surface-fit",
        "pc2pix",
        "pc2pix@bf16",
        "pc2pix@unfolded",
        "pc2pix@paper",
        "pc2pix@paper-bf16",
        "splat-net",
        "splat-net@bf16",
        "splat-net@no-normals",
        "splat-net@tiny",
        "splat-net@large",
        "splat",
        "true-mesh",
    ),
    baselines=("surface-apss", "surface-fit"),
    conditions=("2048",),
    class_name="chair",
    # As many as an interval over objects needs. Reconstruction takes seconds a cloud: three rounds
    # leave the whole run at some minutes. What takes milliseconds goes on for `seconds`, so that
    # its median is over more than chance, but not beyond `most_rounds`.
    clouds=8,
    views=20,
    singles=5,
    # One: after it libraries have chosen their algorithms for both sizes of a call, and memory is
    # mapped; later rounds were no faster.
    warm_ups=1,
    least_rounds=3,
    most_rounds=100,
    seconds=3.0,
    amortised=(1, 2, 5, 10, 20, 50, 100, 500),
    quiet_cores=0.25,
    limits=Limits(time_s=600.0, memory_gib=8.0),
)

ALL_SUITES = (*SUITES, LATENT, STABILITY, SPEED)
