"""The command line. Results go to stdout, progress and errors to stderr.

Exit status: 0 done, 1 a regression, a machine that cannot run, a training that diverged, a method
that failed on a cloud, a failure that is there no more or a wish that no method meets, 2 something
the user has to mend, 130 interrupted, 141 nobody reads the output any more. Everything but Typer is
imported by the command that needs it, so that `--help` and `list` answer at once.
"""

from __future__ import annotations

import os
import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup


class Commands(TyperGroup):
    """All commands; whatever ends one early becomes one line and an exit status.

    Here and not around `app()`, because Typer itself catches interrupts and broken pipes there.
    """

    def invoke(self, ctx: Any) -> Any:  # click's Context, which some versions of Typer contain
        """Run the command."""
        from bench.tables.markdown import visible
        from data_prep.failures import BadInput
        from learning.divergence import TrainingDiverged

        try:
            result = super().invoke(ctx)
            sys.stdout.flush()
            return result
        except BadInput as error:
            print(f"bench: {visible(str(error))}", file=sys.stderr)
            raise typer.Exit(2) from error
        except TrainingDiverged as error:
            print(f"bench: {visible(str(error))}; a lower learning rate may help", file=sys.stderr)
            raise typer.Exit(1) from error
        except typer.BadParameter as error:  # a value that its option does not take
            command = error.ctx.command_path if error.ctx else "bench"
            told = error.format_message().rstrip(".")
            print(f"bench: {visible(told)}; see '{command} --help'", file=sys.stderr)
            raise typer.Exit(2) from error
        except KeyboardInterrupt as error:
            goes_on = ctx.invoked_subcommand in ("run", "train")
            hint = "; the same command goes on from here" if goes_on else ""
            print(f"bench: interrupted{hint}", file=sys.stderr)
            raise typer.Exit(130) from error
        except BrokenPipeError as error:
            for stream in (sys.stdout, sys.stderr):  # Python flushes them when it ends
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            raise typer.Exit(141) from error  # what other programs end with, killed by SIGPIPE
        except OSError as error:  # a full disk, a folder that may not be written
            told = visible(str(error))
            print(f"bench: {told}; mend it, and the same command goes on", file=sys.stderr)
            raise typer.Exit(2) from error


app = typer.Typer(
    cls=Commands,
    help="Benchmark of pc2pix against surface-reconstruction rendering.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
train_app = typer.Typer(help="Train the networks.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(train_app, name="train")
data_app = typer.Typer(help="Look at datasets.", no_args_is_help=True, rich_markup_mode=None)
app.add_typer(data_app, name="data")

RunDirectory = Annotated[Path, typer.Argument(metavar="DIR", help="The folder of a finished run.")]


class Device(StrEnum):
    """Where networks run."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


SuiteOption = Annotated[str, typer.Option(help="The suite, see 'bench list'.")]
RunDatasetOption = Annotated[
    str,
    typer.Option(
        help="procedural, folder:PATH (sub-folders are classes), shapenet:PATH, modelnet:PATH "
        "or paper:PATH; see 'bench data inspect PATH'."
    ),
]
MethodsOption = Annotated[
    str | None, typer.Option(help="Comma-separated; blank is always measured.")
]
ConditionsOption = Annotated[str | None, typer.Option(help="Comma-separated.")]
LimitOption = Annotated[int | None, typer.Option(help="At most so many objects a class.")]
ViewsOption = Annotated[int | None, typer.Option(help="Views per object.")]
WorkersOption = Annotated[
    int | None, typer.Option(help="Worker processes, one thread each; default: all cores.")
]
DeviceOption = Annotated[Device, typer.Option(help="Where networks run.")]
RunSeedOption = Annotated[int, typer.Option(help="Seed of clouds, views and noise.")]
RunFolderOption = Annotated[
    Path | None, typer.Option(help="The run's folder; default: results/runs/SUITE-DATASET.")
]
ShardOption = Annotated[
    str | None,
    typer.Option(metavar="k/N", help="Only the kth of N parts; 'bench merge' joins them."),
]
InceptionOption = Annotated[
    str | None,
    typer.Option(
        metavar="PATH|download",
        help="Weights for fid: a file, or 'download' (95 MB, once). Default: as downloaded "
        "before, else fid is skipped.",
    ),
]


def main() -> None:
    """Entry point of the console script `bench`."""
    app(prog_name="bench")


@app.command()
def run(
    suite: SuiteOption,
    dataset: RunDatasetOption = "procedural",
    methods: MethodsOption = None,
    conditions: ConditionsOption = None,
    limit: LimitOption = None,
    views: ViewsOption = None,
    workers: WorkersOption = None,
    device: DeviceOption = Device.auto,
    seed: RunSeedOption = 0,
    out: RunFolderOption = None,
    shard: ShardOption = None,
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS|local", help="On a Ray cluster: host:port, auto; see docs/cluster.md."
        ),
    ] = None,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Start over; an old run is renamed, not deleted.")
    ] = False,
    inception_weights: InceptionOption = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what would run, and do nothing.")
    ] = False,
) -> None:
    """Run a suite, or go on with one that was stopped; print its tables."""
    from bench.catalogue.lookup import find
    from bench.catalogue.suites import LATENT, SPEED, STABILITY, SUITES
    from bench.commands.publish import run_suite

    options = _options(
        suite=suite,
        dataset=dataset,
        methods=methods,
        conditions=conditions,
        limit=limit,
        views=views,
        workers=workers,
        device=device,
        seed=seed,
        out=out,
        fresh=fresh,
        shard=shard,
        ray=ray,
        inception_weights=inception_weights,
    )
    chosen = find(suite, (*SUITES, LATENT, STABILITY, SPEED), "suite")
    if dry_run:
        from bench.commands.run import dry_run as tell

        print(tell(options))
        return
    if chosen is LATENT:
        _run_latent(options)
        return
    if chosen is STABILITY:
        _run_stability(options)
        return
    if chosen is SPEED:
        _run_speed(options)
        return
    finished = run_suite(options)
    _print_tables(finished.outputs)
    stages = ", ".join(f"{name} {value:.1f} s" for name, value in finished.seconds.items())
    parts = ", ".join(f"{name} {share:.0%}" for name, share in finished.shares.items())
    print(
        f"{finished.done} items done, {finished.reused} from before, {finished.failed} failed "
        f"({stages})\ntime of the workers: {parts}\nresults in {finished.directory}",
        file=sys.stderr,
    )


@app.command("plan")
def plan_run(
    suite: SuiteOption,
    dataset: RunDatasetOption = "procedural",
    methods: MethodsOption = None,
    conditions: ConditionsOption = None,
    limit: LimitOption = None,
    views: ViewsOption = None,
    workers: WorkersOption = None,
    device: DeviceOption = Device.auto,
    seed: RunSeedOption = 0,
    out: RunFolderOption = None,
    shard: ShardOption = None,
    inception_weights: InceptionOption = None,
    pilot: Annotated[
        int, typer.Option(help="Objects that are measured now, with all methods and conditions.")
    ] = 6,
    also: Annotated[
        str | None,
        typer.Option(metavar="METHODS", help="Further methods to measure, for what they save."),
    ] = None,
    samples: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Keep what was measured, as CSV.")
    ] = None,
) -> None:
    """What a run would cost, or what is left of one: time, disk, memory; and what would save."""
    from bench.commands.plan import Wish, forecast

    options = _options(
        suite=suite,
        dataset=dataset,
        methods=methods,
        conditions=conditions,
        limit=limit,
        views=views,
        workers=workers,
        device=device,
        seed=seed,
        out=out,
        shard=shard,
        inception_weights=inception_weights,
    )
    print(forecast(options, Wish(pilot, _names(also) or (), samples)))


def _options(
    *,
    methods: str | None,
    conditions: str | None,
    workers: int | None,
    device: Device,
    shard: str | None,
    **others: Any,
) -> Any:
    """The wishes for a suite, as `bench.running.protocol.Options`."""
    from bench.running.protocol import Options, read_shard

    if workers is not None and workers < 1:
        raise _bad(f"--workers {workers}: must be at least 1")
    return Options(
        methods=_names(methods),
        conditions=_names(conditions),
        workers=workers,
        device=device.value,
        shard=read_shard(shard) if shard else None,
        **others,
    )


def _print_tables(outputs: Any) -> None:
    for table in outputs.tables:
        print(table.to_markdown())
    print(outputs.cost)
    for table in outputs.further:
        print(table.to_markdown())


def _run_latent(options: Any) -> None:
    from bench.suites.latent.run import run as run_latent

    finished = run_latent(options)
    for table in finished.tables:
        print(table.to_markdown())
    print(f"{finished.seconds:.0f} s\nresults in {finished.directory}", file=sys.stderr)


def _run_stability(options: Any) -> None:
    from bench.suites.stability.expectations import KINDS
    from bench.suites.stability.run import run as run_stability

    finished = run_stability(options)
    print("| matrix | " + " | ".join(KINDS) + " |")
    print("|---" * (len(KINDS) + 1) + "|")
    for matrix in finished.matrices:
        kinds = [outcome.kind for outcome in matrix.outcomes]
        print(f"| {matrix.title} | " + " | ".join(str(kinds.count(k)) for k in KINDS) + " |")
    for matrix in finished.matrices:
        for outcome in matrix.unexpected:
            print(
                f"UNEXPECTED {outcome.subject}, {outcome.case}: {outcome.observed}; "
                f"stated was: {outcome.expected}"
            )
    print(f"{finished.seconds:.0f} s\nresults in {finished.directory}", file=sys.stderr)


def _run_speed(options: Any) -> None:
    from bench.suites.speed.run import run as run_speed

    finished = run_speed(options)
    for table in finished.tables:
        print(table)
    noisy = f", {finished.noisy} while something else ran" if finished.noisy else ""
    print(
        f"{finished.done} measurements taken, {finished.reused} from before, "
        f"{finished.failed} with failures{noisy}; {finished.seconds:.0f} s\n"
        f"results in {finished.directory}",
        file=sys.stderr,
    )


@app.command("list")
def list_all() -> None:
    """Suites, methods and their variants, conditions, metrics and datasets."""
    from bench.catalogue.methods import METHODS, YARDSTICKS, plugin_ids
    from bench.catalogue.metrics import (
        CONTROL_METRICS,
        IMAGE_METRICS,
        KERNEL_METRICS,
        RECOGNITION_METRICS,
        SET_METRICS,
    )
    from bench.catalogue.parameters import KNOBS
    from bench.catalogue.plugins import metric_ids
    from bench.catalogue.suites import LATENT, SPEED, STABILITY, SUITES
    from data_prep.conditions import CONDITIONS

    sections = {
        "suites": [(s.id, s.about) for s in (*SUITES, LATENT, STABILITY, SPEED)],
        "methods": [
            *((m.id, m.source) for m in METHODS),
            *((id_, "of another installed package") for id_ in plugin_ids()),
        ],
        "variants": [
            *((f"{k.method}@{k.name}=", f"{k.low:g} to {k.high:g}: {k.about}") for k in KNOBS),
            *((m.id, m.source) for m in YARDSTICKS),
        ],
        "conditions": [(c.id, c.source) for c in CONDITIONS],
        "metrics": [
            *IMAGE_METRICS.items(),
            *((m.id, m.about) for m in SET_METRICS),
            *((name, about) for name, (_, about) in KERNEL_METRICS.items()),
            *RECOGNITION_METRICS.items(),
            *CONTROL_METRICS.items(),
            *((id_, "of another installed package; see 'bench score'") for id_ in metric_ids()),
        ],
        "datasets": [
            ("procedural", "parametric shapes, nothing to download (the default); test split"),
            ("procedural:validation", "the same, on the split for making choices"),
            ("folder:PATH", "your meshes; sub-folders are classes"),
            ("shapenet:PATH", "ShapeNetCore v1 or v2, split by all.csv where that is there"),
            ("modelnet:PATH", "ModelNet10 or 40, split by folders or by lists"),
            ("paper:PATH", "clouds, 20 pictures each and their cameras, as the paper's code has"),
        ],
    }
    for title, entries in sections.items():
        print(f"{title}:")
        for name, about in entries:
            print(f"  {name:<25} {about}")


@app.command()
def render(
    cloud: Annotated[
        Path,
        typer.Argument(metavar="CLOUD", help="PLY, NPY, XYZ, TXT, CSV, PTS, LAS, LAZ, E57 or PCD."),
    ],
    method: Annotated[
        str, typer.Option(help="What draws it, see 'bench list'; several make a sheet: a,b.")
    ],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="The picture, .png; or a turntable, .gif, .webp, .apng."),
    ],
    azimuth: Annotated[float, typer.Option(help="Degrees; 0 is the front.")] = 30.0,
    elevation: Annotated[float, typer.Option(help="Degrees, -90 to 90; 0 is level.")] = 20.0,
    frames: Annotated[
        int | None, typer.Option(help="Of a turntable, from the azimuth all around; default: 36.")
    ] = None,
    up: Annotated[
        str, typer.Option(help="The file's axis that points up: z for most scans.")
    ] = "y",
    front: Annotated[
        str | None, typer.Option(help="Its axis to the front; default: -z, or -y where z is up.")
    ] = None,
    points: Annotated[
        int | None, typer.Option(help="At most so many, chosen at random; default: all.")
    ] = None,
    device: Annotated[Device, typer.Option(help="Where networks run.")] = Device.auto,
    as_is: Annotated[
        bool, typer.Option("--as-is", help="Do not bring the cloud to the unit sphere.")
    ] = False,
) -> None:
    """Draw a point cloud in a file: exit 1 where the method fails, of several where all do.

    A method gets all points, 120 s and 4 GiB. Of many points pc2pix takes 8 x 1,024, surface-fit
    what the picture can show; for other reconstructions 100,000 are half a minute's work.
    """
    from bench.commands.render import Wish
    from bench.commands.render import render as render_wish
    from bench.rendering.cloud import CloudFile
    from bench.tables.markdown import visible

    methods = _names(method) or ()
    file = CloudFile(cloud, as_is, up, front, points)
    failed = render_wish(Wish(file, methods, azimuth, elevation, out, frames, device.value))
    for name, reason in failed.items():
        print(f"bench: {visible(f'{name}: {reason}')}", file=sys.stderr)
    if len(failed) == len(set(methods)):
        raise typer.Exit(1)
    print(out)


@app.command()
def shrink(
    record: Annotated[
        str,
        typer.Argument(
            metavar="RECORD",
            help="DIR:METHOD/CONDITION/CLASS/OBJECT; of the suite stability DIR:METHOD/CASE. "
            "DIR alone lists some that failed.",
        ),
    ],
    budget_s: Annotated[float, typer.Option(help="Seconds after which the best is kept.")] = 600.0,
    workers: Annotated[
        int | None, typer.Option(help="Worker processes; default: all cores.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; default: DIR/shrunk/RECORD.")
    ] = None,
) -> None:
    """Make a failed record's cloud as small as it can be and still fail: exit 1 if it does not."""
    from bench.rendering import shrink as shrinking
    from bench.running.environment import cores

    if workers is not None and workers < 1:
        raise _bad(f"--workers {workers}: must be at least 1")
    found = shrinking.shrink(record, budget_s, workers or cores(), out)
    if isinstance(found, shrinking.Mended):
        print(f"bench: {found.told}", file=sys.stderr)
        raise typer.Exit(1)
    print(found.told)


@app.command("merge")
def merge(
    directories: Annotated[
        list[Path], typer.Argument(metavar="DIR...", help="The folders of all shards of a run.")
    ],
    out: Annotated[Path, typer.Option(help="The folder of the whole run.")],
) -> None:
    """Put shards ('bench run --shard k/N') together into the run that they are parts of."""
    from bench.commands.publish import merge_shards

    merged = merge_shards(directories, out)
    _print_tables(merged.outputs)
    print(
        f"{merged.jobs} jobs of {len(directories)} shards, {merged.copied} copied now\n"
        f"results in {merged.directory}",
        file=sys.stderr,
    )


@app.command()
def table(directory: RunDirectory) -> None:
    """Make the tables again, from the records alone."""
    from bench.tables.build import read_scored, write_outputs

    made = write_outputs(read_scored(directory))
    for one in (*made.tables, *made.further):
        print(one.to_markdown())


@app.command()
def report(
    directory: RunDirectory,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The file; default: DIR/report.html.")
    ] = None,
) -> None:
    """Make one HTML file of a run: tables, curves, pictures, worst cases, failures; offline."""
    from bench.report.build import write_report
    from bench.tables.build import make_outputs, read_scored

    print(write_report(make_outputs(read_scored(directory)), out))


@app.command("score")
def score_pictures(
    directory: RunDirectory,
    metrics: Annotated[
        str | None, typer.Option(help="Comma-separated; default: all of installed packages.")
    ] = None,
) -> None:
    """Take metrics of other packages of a finished run's pictures; print their tables."""
    from bench.catalogue.plugins import metric_ids
    from bench.commands.results import score

    chosen = _names(metrics) or metric_ids()
    if not chosen:
        raise _bad("no installed package adds a metric; see docs/extending.md")
    for made in score(directory, chosen):
        print(made.to_markdown())


@app.command()
def recommend(
    directory: RunDirectory,
    budget_ms: Annotated[
        float | None, typer.Option(help="Milliseconds for a cloud with all its views.")
    ] = None,
    views: Annotated[
        int | None, typer.Option(help="Pictures of a cloud; default: as many as in the run.")
    ] = None,
    condition: Annotated[
        str | None, typer.Option(help="One of the run's, in full; default: all, in short.")
    ] = None,
    min_ssim: Annotated[float | None, typer.Option(help="The least that will do.")] = None,
) -> None:
    """Which method to take for a budget, or a quality: exit 1 if none will do."""
    from bench.analysis import recommend as advice
    from bench.commands.recommendation import advice_lines, make_wish
    from bench.tables.build import how_timed, read_scored

    run = read_scored(directory)
    manifest = run.manifest
    wish = make_wish(manifest["views"] if views is None else views, budget_ms, min_ssim)
    compared = advice.at_condition(run.compared([advice.METRIC]), condition)
    print(how_timed(manifest))
    given = [advice.advise(comparison, wish) for comparison in compared]
    for line in advice_lines(given, wish, manifest["views"], in_full=condition is not None):
        print(line)
    if not all(one.meets(wish) for one in given):
        raise typer.Exit(1)


@app.command()
def check(
    directories: Annotated[
        list[Path], typer.Argument(metavar="DIR", help="Finished runs; several with --claims.")
    ],
    bless: Annotated[
        bool, typer.Option("--bless", help="Make this run's values the golden ones.")
    ] = False,
    claims: Annotated[
        bool, typer.Option("--claims", help="What the runs say about the paper's claims.")
    ] = False,
) -> None:
    """Compare a run with the golden values: exit 0 if all agree, 1 if one does not."""
    from bench.checking import golden as checks

    if claims:
        _check_claims(directories)
        return
    if len(directories) > 1:
        raise _bad(f"{len(directories)} folders: golden values are of one run; or give --claims")
    (directory,) = directories
    if bless:
        print(f"golden values written to {checks.bless(directory)}")
        return
    verdict = checks.check(directory)
    for line in verdict.remarks:
        print(line)
    for line in verdict.regressions:
        print(f"REGRESSION {line}")
    print(f"{verdict.compared} golden values compared, {len(verdict.regressions)} regressions")
    if verdict.regressions:
        raise typer.Exit(1)


def _check_claims(directories: list[Path]) -> None:
    """Print the checklist, and write it into the first folder."""
    from bench.checking.checklist import check_claims, to_markdown, write_checklist

    made = check_claims(directories)
    print(to_markdown(made))
    print(f"written to {write_checklist(made, directories[0])}", file=sys.stderr)


@app.command()
def doctor() -> None:
    """Check that everything a run needs is here: exit 0 if so, 1 if not."""
    from bench.commands.doctor import examine

    healthy = True
    for finding in examine():
        healthy &= finding.ok
        print(f"{'ok  ' if finding.ok else 'FAIL'} {finding.subject}: {finding.text}", flush=True)
    if not healthy:
        raise typer.Exit(1)


@data_app.command("inspect")
def inspect_data(
    location: Annotated[
        str,
        typer.Argument(metavar="PATH", help="A folder, or a dataset such as shapenet:PATH."),
    ],
    sample: Annotated[int, typer.Option(help="Objects of each class that are read.")] = 10,
    workers: Annotated[
        int | None, typer.Option(help="Worker processes; default: all cores.")
    ] = None,
) -> None:
    """What is understood of a dataset: exit 1 where something is missing or odd."""
    from bench.commands.data import inspect
    from bench.running.environment import cores
    from bench.tables.markdown import visible

    if workers is not None and workers < 1:
        raise _bad(f"--workers {workers}: must be at least 1")
    found = inspect(location, sample, workers or cores())
    for line in found.lines:
        print(visible(line))
    for line in found.irregular:
        print(f"IRREGULAR    {visible(line)}")
    print(f"use          --dataset {shlex.quote(found.spec)}")
    if found.irregular:
        raise typer.Exit(1)


@data_app.command("export")
def export_data(
    dataset: Annotated[str, typer.Option(help="As of 'bench run'.")],
    classes: Annotated[str, typer.Option("--class", help="Comma-separated.")],
    out: Annotated[Path, typer.Option(help="A new folder.")],
    limit: Annotated[int | None, typer.Option(help="At most so many objects a class.")] = None,
    seed: Annotated[int, typer.Option(help="Of clouds and views, as of 'bench run'.")] = 0,
    workers: Annotated[
        int | None, typer.Option(help="Worker processes; default: all cores.")
    ] = None,
) -> None:
    """Write a dataset in the paper's layout: exit 1 where an object cannot be written."""
    from bench.commands.export_paper import export
    from bench.running.environment import cores
    from bench.tables.markdown import visible

    if workers is not None and workers < 1:
        raise _bad(f"--workers {workers}: must be at least 1")
    done = export(dataset, _names(classes) or (), limit, seed, out, workers or cores())
    for line in done.failures:
        print(f"bench: {visible(line)}", file=sys.stderr)
    print(f"{done.written} objects, split {done.split_file}; use --dataset paper:{out}")
    if done.failures:
        raise typer.Exit(1)


class Width(StrEnum):
    """Width of the networks: the paper's, or a quarter of it."""

    lite = "lite"
    paper = "paper"


class Precision(StrEnum):
    """bfloat16 is mixed precision."""

    float32 = "float32"
    bfloat16 = "bfloat16"


class Encoder(StrEnum):
    """Dilated convolutions along the order of the points, or PointNet."""

    paper = "paper"
    pointnet = "pointnet"


class Azimuth(StrEnum):
    """How the networks are told the azimuth."""

    scalar = "scalar"
    sine_cosine = "sine-cosine"


DatasetOption = Annotated[str, typer.Option(help="As of 'bench run'; its train split.")]
ClassOption = Annotated[
    str, typer.Option("--class", help="What to train on: a class, several (a,b), or all.")
]
ObjectsOption = Annotated[
    int | None, typer.Option(help="Objects of each class; default 1500 or all.")
]
StepsOption = Annotated[int, typer.Option(help="Steps in all, those before a resume included.")]
AugmentOption = Annotated[
    bool, typer.Option("--augment", help="Show the encoder noise and fewer points.")
]
BatchOption = Annotated[int, typer.Option(help="Pictures or clouds a step.")]
SeedOption = Annotated[int, typer.Option(help="Seed of initial weights and batches.")]
ThreadsOption = Annotated[int | None, typer.Option(help="CPU threads; default: PyTorch's choice.")]
OutOption = Annotated[Path, typer.Option(help="Folder; a training that is there is continued.")]


@train_app.command("autoencoder")
def train_autoencoder(
    out: OutOption = Path("training/autoencoder"),
    dataset: DatasetOption = "procedural",
    class_name: ClassOption = "chair",
    objects: ObjectsOption = None,
    width: Width = Width.lite,
    encoder: Annotated[
        Encoder, typer.Option(help="The paper's, or one that heeds no order of points.")
    ] = Encoder.paper,
    latent: Annotated[int, typer.Option(help="Length of the code.")] = 32,
    augment: AugmentOption = False,
    steps: StepsOption = 10_000,
    batch: BatchOption = 32,
    learning_rate: Annotated[float, typer.Option(help="Of RMSprop.")] = 1e-4,
    precision: Precision = Precision.float32,
    device: Device = Device.cpu,
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
) -> None:
    """The point-cloud autoencoder (paper, section 3.1)."""
    from bench.commands.train import NetworkOptions, TrainingOptions
    from bench.commands.train import train_autoencoder as train

    options = TrainingOptions(
        dataset, _classes(class_name), objects, steps, batch, augment, precision.value,
        device.value, seed, threads, out,
    )  # fmt: skip
    _print_once(train(options, NetworkOptions(width.value, encoder.value, latent), learning_rate))


@train_app.command("gan")
def train_gan(
    autoencoder: Annotated[Path, typer.Option(help="Checkpoint of the autoencoder.")] = Path(
        "training/autoencoder/checkpoint.safetensors"
    ),
    out: OutOption = Path("training/gan"),
    dataset: DatasetOption = "procedural",
    class_name: ClassOption = "chair",
    objects: ObjectsOption = None,
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 8,
    objective: Annotated[
        str, typer.Option(help="acgan-code, acgan-paper or paired.")
    ] = "acgan-code",
    azimuth: Annotated[
        Azimuth, typer.Option(help="One number as in the paper, or two without a jump.")
    ] = Azimuth.scalar,
    augment: AugmentOption = False,
    steps: StepsOption = 20_000,
    warm_up: Annotated[
        int, typer.Option(help="First steps without the discriminator (paired only).")
    ] = 0,
    batch: BatchOption = 32,
    generator_lr: Annotated[float, typer.Option(help="Adam's learning rate.")] = 1e-4,
    precision: Precision = Precision.float32,
    device: Device = Device.cpu,
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
) -> None:
    """The rendering GAN (paper, section 3.2), on a trained autoencoder."""
    from bench.commands.train import GanOptions, TrainingOptions
    from bench.commands.train import train_gan as train

    options = TrainingOptions(
        dataset, _classes(class_name), objects, steps, batch, augment, precision.value,
        device.value, seed, threads, out,
    )  # fmt: skip
    gan = GanOptions(autoencoder, views, objective, azimuth.value, warm_up, generator_lr)
    _print_once(train(options, gan))


@train_app.command("splat-net")
def train_splat_net(
    out: OutOption = Path("training/splat-net"),
    dataset: DatasetOption = "procedural",
    class_name: ClassOption = "chair",
    objects: ObjectsOption = None,
    size: Annotated[str, typer.Option(help="tiny, default or large.")] = "default",
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 8,
    start: Annotated[
        str | None,
        typer.Option(
            help="Go on from weights: a bundled name, or a file with the grey one beside."
        ),
    ] = None,
    objective: Annotated[str, typer.Option(help="l1 or l1-patch.")] = "l1",
    without: Annotated[
        str | None,
        typer.Option(help="Inputs to leave out: normals,density,flattened,far,discs."),
    ] = None,
    augment: Annotated[bool, typer.Option(help="Show noise and fewer points.")] = True,
    steps: StepsOption = 8000,
    warm_up: Annotated[
        int, typer.Option(help="First steps without the judge of patches (l1-patch only).")
    ] = 0,
    cool_down: Annotated[
        int, typer.Option(help="Last steps, over which the learning rate falls to nothing.")
    ] = 2000,
    batch: BatchOption = 24,
    learning_rate: Annotated[float, typer.Option(help="Of Adam.")] = 2e-3,
    precision: Precision = Precision.float32,
    device: Device = Device.cpu,
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
) -> None:
    """A U-Net that sees the projected points: weights in colour and in grey."""
    from bench.commands.train import SplatNetOptions, TrainingOptions
    from bench.commands.train import train_splat_net as train

    options = TrainingOptions(
        dataset, _classes(class_name), objects, steps, batch, augment, precision.value,
        device.value, seed, threads, out,
    )  # fmt: skip
    splat_net = SplatNetOptions(
        size, objective, views, warm_up, cool_down, learning_rate, _names(without) or (), start
    )
    _print_once(train(options, splat_net))


@train_app.command("views")
def train_views(
    objects: Annotated[int, typer.Option(help="Objects of each class.")] = 500,
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 8,
    epochs: Annotated[int, typer.Option(help="Passes over the pictures.")] = 12,
    seed: SeedOption = 0,
) -> None:
    """The classifier behind fd-views: replaces the bundled weights, hence all goldens."""
    from bench.judges.train_views import train_views as train

    print(train(objects, views, epochs, seed).to_text())


@train_app.command("constant")
def train_constant(
    objects: Annotated[int, typer.Option(help="Number of objects.")] = 1500,
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 8,
    steps: Annotated[int, typer.Option(help="Steps of 64 pictures.")] = 400,
    seed: SeedOption = 0,
) -> None:
    """The best constant picture: replaces the bundled one, hence its golden values."""
    from bench.judges.train_constant import train_constant as train

    print(train(objects, views, steps, seed))


@train_app.command("judge")
def train_judge(
    objects: Annotated[int, typer.Option(help="Number of objects.")] = 1500,
    views: Annotated[int, typer.Option(help="Pictures of each object.")] = 16,
    steps: Annotated[int, typer.Option(help="Steps of 96 pictures.")] = 3000,
    seed: SeedOption = 0,
) -> None:
    """The judge of view and shape: replaces the bundled weights, hence what it measures."""
    from bench.judges.train_judge import train_judge as train

    for name, scores in train(objects, views, steps, seed).items():
        print(f"{name}: {scores}")


@train_app.command("decoder")
def train_decoder(
    weights: Annotated[
        str, typer.Option(help="A bundled name or a file; the decoder is put beside it.")
    ] = "chair",
    out: OutOption = Path("training/decoder"),
    objects: ObjectsOption = None,
    steps: StepsOption = 3000,
    batch: BatchOption = 32,
    precision: Precision = Precision.float32,
    device: Device = Device.cpu,
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
) -> None:
    """A decoder from codes to clouds for trained weights, for the suite latent."""
    from bench.commands.train_decoder import DecoderOptions
    from bench.commands.train_decoder import train_decoder as train

    options = DecoderOptions(
        weights, objects, steps, batch, precision.value, device.value, seed, threads, out
    )
    print(train(options))


def _print_once(path: Path) -> None:
    """Print what a training made, not by every process that took part."""
    from learning.processes import is_first

    if is_first():
        print(path)


def _names(text: str | None) -> tuple[str, ...] | None:
    """The names in a comma-separated list. Raises BadInput for an empty list."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if not names:
        raise _bad(f"'{text}': expected names separated by commas")
    return names


def _classes(text: str) -> tuple[str, ...]:
    """The classes to train on; none stands for all."""
    return () if text == "all" else _names(text) or ()


def _bad(message: str) -> Exception:
    from data_prep.failures import BadInput

    return BadInput(message)


if __name__ == "__main__":
    main()
