"""The runs that the documentation quotes, and the files in `results/docs` that are made of them.

    python -m studies.measurements                      # the command of every run
    python -m studies.measurements NAME [--meshes PATH] [--out DIR] [further options of bench run]

The second command carries out a run, or continues the one in DIR, and writes into `results/docs`:

NAME.csv              the values in the run's tables of quality
NAME-differences.csv  comparisons of networks with the best classical method, object by object, as
                      `bench compare` makes them
NAME-rivals.csv       the same with `fused-net@grey` in place of the best classical method
further files         other tables of the run that pages quote
measured.csv          date, commit and processor of every run

The run `costs` writes the table of costs, `results/costs.csv`. `claims` is no run: it reads the
runs in `results/runs` that claims are about, and writes `results/claims.md`. PATH is the folder of
real meshes, see docs/datasets.md.
"""

from __future__ import annotations

import argparse
import csv
import io
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from bench.analysis.pairs import compare_methods
from bench.analysis.paper import AVERAGE
from bench.analysis.run import Run, read_run
from bench.catalogue.chosen import BEST_CLASSICAL, COSTS
from bench.catalogue.methods import find_method, role
from bench.catalogue.suites import SUITES
from bench.records.folder import read_manifest
from bench.tables.build import tables
from bench.tables.differences import differences_table
from bench.tables.quality import further_tables
from bench.tables.table import TABLES, csv_text
from data_prep.files.atomic_write import write_whole
from studies.documents import NUMBERS

FIRST = ("ssim", "ssim-object", "lpips")  # metrics of most tables and comparisons
JUDGES = ("ssim", "lpips", "st-lpips", "dists", "flip")  # metrics of `headline`
_RUN_COLUMNS = ("run_a", "run_b")  # columns of comparisons with folders of runs, which are left out
FULL = "2048"  # the condition of whole clouds without noise
# Metrics of the suite `speed`: the processor's time, which other programs disturb less than the
# time on the clock.
ONE_VIEW, FURTHER_VIEW = "picture-of-1-core-ms", "further-view-core-ms"
RUNS = Path("results/runs")  # where runs are kept, each in a folder of its name
MEASURED = "measured.csv"
COSTS_RUN, CLAIMS = "costs", "claims"
CLAIMED = ("known-chairs", "thirteen-classes", "speed-of-pc2pix", "latent")  # runs with claims
CLAIMS_FILE = "claims.md"
# Parts of the options of several runs.
_CLASSES = "--suite thirteen-classes"
_REAL = f"{_CLASSES} --dataset folder:PATH"
_ON_MESHES = f"{_REAL} --conditions 2048,512,noise-0.05,noise-0.10 --views 4"
BEST_LEARNED = "fused-net@grey"
_CLASSICAL = "surface-apss,alpha-wrap,denoised-wrap,splat-fill"
_ON_CHAIRS = f"{_CLASSICAL},pc2pix,splat-net@chair,fused-net,blank"
GREY = f"splat-net@grey,{BEST_LEARNED}"
_COMPARED_IN_GREY = ("splat-net@grey", BEST_LEARNED, "occupancy-net")
_COMPARED_ON_CHAIRS = ("splat-net@chair", "fused-net", "pc2pix")


class QuotedRun(NamedTuple):
    """A run and what is written of it for the documentation.

    options   of `bench run`, with PATH for the folder of real meshes
    compared  methods that are compared with the best classical method
    metrics   of the file of values and of the comparisons; if there are none, all metrics of the
              run and the comparisons of FIRST
    copied    further tables of the run, each with the name of the file that it becomes
    rivals    methods that `fused-net@grey` is compared with
    surfaces  whether `bench surface` measures the meshes of the run; no other values are written
    """

    options: str
    compared: tuple[str, ...] = ()
    metrics: tuple[str, ...] = ()
    copied: tuple[tuple[str, str], ...] = ()
    rivals: tuple[str, ...] = ()
    surfaces: bool = False


MEASUREMENTS: Mapping[str, QuotedRun] = {
    "known-chairs": QuotedRun("--suite chair-robustness"),  # for the claims alone
    "known-chairs-grey": QuotedRun("--suite chair-robustness --truth grey", _COMPARED_IN_GREY),
    "sealed": QuotedRun(
        "--suite chair-robustness --dataset procedural:sealed --limit 60 --views 10 --methods "
        f"{_CLASSICAL},pc2pix,pc2pix@acgan,splat-net@chair,fused-net,true-mesh,blank",
        _COMPARED_ON_CHAIRS,
    ),
    "novel-families": QuotedRun(
        "--suite chair-robustness --dataset procedural:novel-families --limit 24 --views 10 "
        f"--methods {_ON_CHAIRS}",
        _COMPARED_ON_CHAIRS,
    ),
    "beyond-training": QuotedRun(
        "--suite beyond-training --limit 12",
        _COMPARED_ON_CHAIRS,
        copied=(("crossings", "beyond-training-crossings"),),
    ),
    "thirteen-classes": QuotedRun(
        _CLASSES,
        _COMPARED_IN_GREY,
        copied=(("table5_orderings", "thirteen-classes-orderings"),),
    ),
    "real-meshes-grey": QuotedRun(
        f"{_ON_MESHES} --truth grey --metrics invented-holes,invented-parts "
        f"--methods {_CLASSICAL},occupancy-net,upsampled-wrap,splat,pc2pix,pc2pix@all,{GREY},blank",
        (*_COMPARED_IN_GREY, "upsampled-wrap", "pc2pix@all"),
        FIRST,
        (("tails", "real-meshes-grey-tails"),),
        rivals=("splat-net@grey", "occupancy-net", "upsampled-wrap"),
    ),
    "dense-and-scanned": QuotedRun(
        f"{_REAL} --limit 1 --truth grey --conditions 2048,8192,32768,three-views,one-side "
        f"--views 4 --methods surface-fit,splat,{_CLASSICAL},pc2pix@all,occupancy-net,"
        f"{GREY},blank",
        metrics=FIRST,
    ),
    "coloured-clouds": QuotedRun(
        f"{_REAL} --limit 1 --truth coloured-clouds --conditions 2048,32768 --views 4 --methods "
        f"surface-fit,alpha-wrap,splat,splat-fill,occupancy-net,{GREY},fused-net,blank",
        metrics=FIRST,
    ),
    "headline": QuotedRun(
        f"{_REAL} --truth grey --conditions 2048,noise-0.10 --views 2 "
        "--metrics st-lpips,dists,flip "
        f"--methods alpha-wrap,denoised-wrap,splat-fill,occupancy-net,{GREY},blank",
        _COMPARED_IN_GREY,
        JUDGES,
    ),
    "surfaces": QuotedRun(
        f"{_ON_MESHES} --limit 3 --truth grey --methods surface-apss,surface-fit,surface-bpa,"
        "poisson,alpha-wrap,denoised-wrap,occupancy-net,upsampled-wrap,blank",
        copied=(("surface_ranks", "surface-ranks"),),
        surfaces=True,
    ),
    "latent": QuotedRun(
        "--suite latent",
        copied=(("latent_interpolation", "latent-paths"), ("latent_arithmetic", "latent-sums")),
    ),
    "stability": QuotedRun(
        "--suite stability",
        copied=(("stability_methods", "stability"), ("observations", "stability-observations")),
    ),
    "speed-of-pc2pix": QuotedRun(  # for the claims alone, which take eight clouds or more
        "--suite speed --device cpu --limit 8 --methods surface-apss,pc2pix,pc2pix@paper"
    ),
    COSTS_RUN: QuotedRun(
        "--suite speed --device cpu --limit 4 --methods surface-apss,surface-fit,surface-bpa,"
        "poisson,alpha-wrap,denoised-wrap,pc2pix,pc2pix@paper,splat-net,splat-net@grey,"
        "splat-net@chair,points2pix,occupancy-net,upsampled-wrap,fused-net,fused-net@grey,splat,"
        "splat-fill,true-mesh,constant,blank",
    ),
}


def differences_of(name: str) -> str:
    """Return the name of the file of a measurement's comparisons with the best classical method."""
    return f"{name}-differences.csv"


def rivals_of(name: str) -> str:
    """Return the name of the file of a measurement's comparisons with `fused-net@grey`."""
    return f"{name}-rivals.csv"


def values(run: Run, metrics: Iterable[str]) -> str:
    """Return the tables of quality of a run as the text of one CSV file.

    metrics  those that are written; all if there are none

    Tables of further metrics have no line for the mean over classes; it is added, without an
    interval.
    """
    rows = [row for table in tables(run) for row in _rows(table.to_csv())]
    for table in further_tables(run):
        of_classes = _rows(table.to_csv())
        rows += [*of_classes, *_averages(pd.DataFrame(of_classes), list(of_classes[0]))]
    wanted = set(metrics)
    return _written([row for row in rows if not wanted or row["metric"] in wanted])


def _averages(of_classes: pd.DataFrame, columns: list[str]) -> list[dict[str, str]]:
    """Return a row for the mean over classes of each method and condition.

    Columns that have the same text for all classes keep it, and others are empty.
    """
    averages = []
    for _, rows in of_classes.groupby(["method", "condition"], sort=False):
        average = {}
        for name in columns:
            average[name] = rows[name].iloc[0] if rows[name].nunique() == 1 else ""
        average["class"] = AVERAGE
        average["value"] = f"{rows['value'].astype(float).mean():.6f}"
        averages.append(average)
    return averages


def differences(
    directory: Path,
    methods: Iterable[str],
    metrics: Sequence[str] = FIRST,
    reference: str = BEST_CLASSICAL,
) -> str:
    """Return comparisons of methods with a reference method as the text of one CSV file.

    directory  of the run
    """
    rows: list[dict[str, str]] = []
    for method in methods:
        pair = compare_methods(directory, (reference, method), metrics)
        for row in _rows(differences_table(pair).to_csv()):
            rows.append({name: text for name, text in row.items() if name not in _RUN_COLUMNS})
    return _written(rows)


def costs(directory: Path) -> str:
    """Return the text of the table of costs, a CSV file.

    Times are those of a run of the suite `speed` in `directory`. Scores are the mean of SSIM and
    1 - LPIPS on real meshes, of methods without colours.
    """
    speed = pd.read_csv(directory / TABLES / "speed.csv", dtype={"condition": str})
    speed = speed[(speed["condition"] == FULL) & (speed["threads"] == 1)].dropna(subset="value")
    ms = speed.pivot(index="method", columns="metric", values="value").sort_values(ONE_VIEW)
    rows = pd.read_csv(NUMBERS / "real-meshes-grey.csv", dtype={"condition": str})
    rows = rows[(rows["condition"] == FULL) & (rows["class"] == AVERAGE)]
    values = rows.pivot(index="method", columns="metric", values="value")
    scores = (values["ssim"] + 1 - values["lpips"]) / 2
    lines = []
    for method, times in zip(ms.index, ms[[ONE_VIEW, FURTHER_VIEW]].to_numpy(), strict=True):
        scored = method in scores and find_method(method).color == "none" and not role(method)
        score = f"{scores[method]:.4f}" if scored else ""
        one_view, further_view = times
        lines.append([method, f"{one_view:.6g}", f"{further_view:.6g}", score])
    return csv_text(["method", "one_view_ms", "further_view_ms", "score"], lines)


def _rows(text: str) -> list[dict[str, str]]:
    """Return the rows of a CSV text."""
    return list(csv.DictReader(io.StringIO(text)))


def _written(rows: list[dict[str, str]]) -> str:
    """Return rows, at least one, all with the same columns, as CSV."""
    return csv_text(list(rows[0]), (row.values() for row in rows))


def command(name: str, meshes: Path | None = None) -> list[str]:
    """Return the arguments of `bench` that carry out a run, without the option for its folder.

    meshes  the folder of real meshes; None leaves the word PATH in its place
    """
    options = MEASUREMENTS[name].options.split()
    return ["run", *(option.replace("PATH", str(meshes or "PATH")) for option in options)]


def measure(
    name: str, out: Path, meshes: Path | None, more: Iterable[str] = (), numbers: Path = NUMBERS
) -> None:
    """Carry out a run, and write its files and its line of `measured.csv` into a folder.

    out      the folder of the run
    meshes   the folder of real meshes, for runs that need it
    more     further options of `bench run`
    numbers  the folder that files are written into

    Raises subprocess.CalledProcessError where the run fails; it has printed why.
    """
    measurement = MEASUREMENTS[name]
    arguments = command(name, meshes)
    _bench(*arguments, "--out", str(out), *more)
    if measurement.surfaces:
        _bench("surface", str(out))
    texts = {}
    if of_scores(name):
        texts[f"{name}.csv"] = values(read_run(out), measurement.metrics)
    if name == COSTS_RUN:
        write_whole(COSTS, costs(out).encode())
    metrics = measurement.metrics or FIRST
    if measurement.compared:
        texts[differences_of(name)] = differences(out, measurement.compared, metrics)
    if measurement.rivals:
        texts[rivals_of(name)] = differences(out, measurement.rivals, metrics, BEST_LEARNED)
    for table, file in measurement.copied:
        texts[f"{file}.csv"] = (out / TABLES / f"{table}.csv").read_text(encoding="utf-8")
    for file, text in texts.items():
        write_whole(numbers / file, text.encode())
    before = numbers / MEASURED
    text = before.read_text(encoding="utf-8") if before.exists() else ""
    after = measured(text, name, read_manifest(out), ["bench", *command(name)])
    write_whole(before, after.encode())


def measured(text: str, name: str, manifest: Mapping[str, Any], arguments: list[str]) -> str:
    """Return the text of `measured.csv` with the line of a measurement added or replaced.

    text       before
    manifest   of the run, which has date, commit and processor
    arguments  the command
    """
    rows = {row["name"]: row for row in _rows(text) if row["name"] in MEASUREMENTS}
    rows[name] = {
        "name": name,
        "date": manifest["finished"][:10],
        "commit": manifest["git"]["commit"][:8],
        "processor": f"{manifest['machine']['cpu']}, {manifest['machine']['instructions']}",
        "command": " ".join(arguments),
    }
    return _written([rows[name] for name in MEASUREMENTS if name in rows])


def check_claims(runs: Path = RUNS) -> None:
    """Check the claims by the runs in a folder, and write `results/claims.md`."""
    _bench("check", *(str(runs / name) for name in CLAIMED), "--claims")
    text = (runs / CLAIMED[0] / CLAIMS_FILE).read_bytes()
    write_whole(COSTS.with_name(CLAIMS_FILE), text)


def _bench(*arguments: str) -> None:
    subprocess.run([Path(sys.executable).with_name("bench"), *arguments], check=True)


def of_scores(name: str) -> bool:
    """Return whether the values of a measurement are written for the pages.

    They are not for `known-chairs`, which is run for the claims alone, for meshes, and for suites
    with tables of their own.
    """
    if name == "known-chairs" or MEASUREMENTS[name].surfaces:
        return False
    options = MEASUREMENTS[name].options.split()
    asked = options[options.index("--suite") + 1]
    return asked in {suite.id for suite in SUITES}


def main() -> None:
    """Carry out a run, or print the commands of all."""
    parser = argparse.ArgumentParser(description="Runs that the documentation quotes.")
    parser.add_argument("name", nargs="?", choices=[*MEASUREMENTS, CLAIMS])
    parser.add_argument("--meshes", type=Path, help="the folder of real meshes")
    parser.add_argument("--out", type=Path, help="default: results/runs/NAME")
    options, more = parser.parse_known_args()
    if options.name is None:
        for name in MEASUREMENTS:
            print(f"{name}: bench {' '.join(command(name))}")
        print(f"{CLAIMS}: bench check {' '.join(str(RUNS / name) for name in CLAIMED)} --claims")
        return
    try:
        if options.name == CLAIMS:
            check_claims(options.out or RUNS)
            return
        if "PATH" in MEASUREMENTS[options.name].options and options.meshes is None:
            parser.error(f"{options.name}: give --meshes, the folder of real meshes")
        measure(options.name, options.out or RUNS / options.name, options.meshes, more)
    except subprocess.CalledProcessError as failed:  # the run has said why
        sys.exit(failed.returncode)


if __name__ == "__main__":
    main()
