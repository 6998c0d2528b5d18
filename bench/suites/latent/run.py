"""The suite `latent`: paths between codes, and whether A - B + C is D (Figures 5 and 6).

It runs in one process for about a minute, from the beginning each time. The same seed gives the
same bytes on one machine, with any number of threads.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.report.figure import FIGURES, save
from bench.running.environment import environment
from bench.running.isolation import library_threads
from bench.running.options import Options
from bench.running.protocol import manifest_of
from bench.running.run import open_run
from bench.suites.latent.arithmetic import ANSWERS, SUM_METRICS, SUM_REMARK, add_up, train_codes
from bench.suites.latent.chairs import (
    ChairPair,
    Triple,
    choose_pairs,
    choose_triples,
    specified_chairs,
)
from bench.suites.latent.figures import Strip, strips_figure
from bench.suites.latent.network import LatentNetwork, load_network, weights_of
from bench.suites.latent.paths import PATH_METRICS, PATH_REMARK, PATHS, walk
from bench.suites.latent.suite import LATENT, LatentSuite
from bench.suites.latent.tables import LatentValue, Mean, latent_table, means, values_table
from bench.suites.procedure import SuiteRun, methods_of
from bench.tables.table import Table, write_tables
from data_prep.datasets.registry import Split, open_dataset
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import View

Subject = TypeVar("Subject")


def run(
    options: Options,
    suite: LatentSuite = LATENT,
    environment: Callable[[], Mapping[str, str]] = environment,
) -> SuiteRun:
    """Carry out the suite; `environment` describes the drivers that images depend on.

    Raises BadInput for options that the user has to fix.
    """
    start = time.perf_counter()
    methods = methods_of(
        options,
        suite,
        conditions="clouds have all their 2048 points",
        views="everything is seen from one fixed view",
        **dict.fromkeys(("workers", "shard", "ray"), "it works in one process"),
        inception_weights="no fid is taken",
    )
    split, seed = _split(options), options.seed or 0
    for method in methods:
        weights_of(method)
    chairs = specified_chairs(split, max(suite.pool, 2 * suite.pairs))
    pairs = choose_pairs(chairs[: 2 * suite.pairs], generator(seed, "latent pairs"))
    rng = generator(seed, "latent triples")
    triples = choose_triples(chairs[: suite.pool], suite.triples, rng)
    pairs, triples = pairs[: options.limit], triples[: options.limit]
    view = View(suite.azimuth_deg, suite.elevation_deg)
    directory = options.directory
    with library_threads(1):
        networks = [load_network(method, options.device, view) for method in methods]
        manifest = manifest_of(
            replace(options, methods=methods, seed=seed),  # a repetition has no defaults
            suite.id,
            1,
            environment(),
            methods=list(methods),
            weights={
                network.method: {
                    "weights": network.renderer.weights.sha256,
                    "decoder": network.decoder_sha256,
                }
                for network in networks
            },
            pairs=[pair.id for pair in pairs],
            triples=[triple.id for triple in triples],
        )
        with open_run(directory, manifest, options.fresh):
            tables = _measure(networks, pairs, triples, seed, suite, directory)
    seconds = time.perf_counter() - start
    return SuiteRun(
        directory, tables, [table.to_markdown() for table in tables], f"{seconds:.0f} s"
    )


def _split(options: Options) -> Split:
    """Return the split to be measured.

    Raises BadInput for a dataset without descriptions.
    """
    dataset = open_dataset(options.dataset)
    if dataset.finite is not None or dataset.measured == "novel-families":
        raise BadInput(
            f"--dataset {options.dataset}: the suite {LATENT.id} chooses chairs by their "
            "descriptions, which only procedural ones have; leave it"
        )
    return dataset.measured


def _measure(
    networks: Sequence[LatentNetwork],
    pairs: Sequence[ChairPair],
    triples: Sequence[Triple],
    seed: int,
    suite: LatentSuite,
    directory: Path,
) -> tuple[Table[Mean], ...]:
    """Measure everything; write figures, tables and the single values behind them."""
    classifier = load_views_network(VIEWS_WEIGHTS)
    folder = directory / FIGURES
    for old in folder.glob("*.png"):  # perhaps of a run with other methods
        old.unlink()
    on_paths: list[LatentValue] = []
    on_sums: list[LatentValue] = []
    for number, network in enumerate(networks, 1):
        # Each method has a figure; the first has no number.
        suffix = ".png" if number == 1 else f"-{number}.png"
        walks = partial(walk, network, classifier, seed=seed, positions=suite.positions)
        strips = _take(f"paths, {network.method}", pairs, walks, on_paths, suite.shown)
        save(strips_figure(strips, network.view), folder / f"interpolation{suffix}")
        neighbours = train_codes(network, suite.neighbours)
        sums = partial(add_up, network, train=neighbours, seed=seed)
        strips = _take(f"sums, {network.method}", triples, sums, on_sums, suite.shown)
        save(strips_figure(strips, network.view), folder / f"arithmetic{suffix}")
    tables = (
        latent_table(
            "latent_interpolation",
            "Paths between codes (after Figure 5)",
            PATH_REMARK,
            PATH_METRICS,
            PATHS,
            means(suite.id, on_paths),
        ),
        latent_table(
            "latent_arithmetic",
            "A - B + C against D (after Figure 6)",
            SUM_REMARK,
            SUM_METRICS,
            ANSWERS,
            means(suite.id, on_sums),
        ),
    )
    values = [
        values_table(f"{table.name}_values", values_of_table)
        for table, values_of_table in zip(tables, (on_paths, on_sums), strict=True)
    ]
    write_tables(directory, [*tables, *values])
    return tables


def _take(
    name: str,
    items: Sequence[Subject],
    measure: Callable[[Subject], tuple[list[LatentValue], Strip]],
    values: list[LatentValue],
    shown: int,
) -> list[Strip]:
    """Measure pairs or triples, append all values to `values`, and return `shown` strips."""
    strips = []
    with progress(name, len(items)) as advance:
        for item in items:
            item_values, strip = measure(item)
            values += item_values
            if len(strips) < shown:
                strips.append(strip)
            advance(0)
    return strips
