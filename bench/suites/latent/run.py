"""The suite `latent`: what lies between codes, and whether A - B + C is D (Figures 5 and 6).

One process, a minute or so, everything from the beginning each time: there is nothing to resume.
The same seed gives the same bytes on one machine, with whatever number of threads.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.catalogue.suites import LATENT, LatentSuite
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.running.environment import environment
from bench.running.isolation import one_thread
from bench.running.protocol import Options, manifest_of, refuse
from bench.running.run import open_run
from bench.suites.latent.arithmetic import ANSWERS, SUM_METRICS, SUM_REMARK, add_up, train_codes
from bench.suites.latent.chairs import Pair, Triple, choose_pairs, choose_triples, specified_chairs
from bench.suites.latent.figures import Strip, strips_figure
from bench.suites.latent.network import Network, load_network, weights_of
from bench.suites.latent.paths import PATH_METRICS, PATH_REMARK, PATHS, walk
from bench.suites.latent.tables import Mean, Value, latent_table, means, values_table
from bench.tables.figure import FIGURES, save
from bench.tables.table import Table, write_tables
from data_prep.datasets import Split, open_dataset
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import View


@dataclass(frozen=True)
class LatentRun:
    """A finished run: where it is, its tables, and how long it took."""

    directory: Path
    tables: tuple[Table[Mean], ...]
    seconds: float

    @property
    def printed(self) -> list[str]:
        """What `bench run` prints."""
        return [table.to_markdown() for table in self.tables]

    @property
    def summary(self) -> str:
        """What it says at the end."""
        return f"{self.seconds:.0f} s"


def run(options: Options, suite: LatentSuite = LATENT) -> LatentRun:
    """Carry out the suite. Raises BadInput for anything the user has to mend."""
    start = time.perf_counter()
    split = _check(options)
    methods = tuple(dict.fromkeys(options.methods or suite.methods))
    for method in methods:
        weights_of(method)
    chairs = specified_chairs(split, max(suite.pool, 2 * suite.pairs))
    pairs = choose_pairs(chairs[: 2 * suite.pairs], generator(options.seed, "latent pairs"))
    rng = generator(options.seed, "latent triples")
    triples = choose_triples(chairs[: suite.pool], suite.triples, rng)
    pairs, triples = pairs[: options.limit], triples[: options.limit]
    view = View(suite.azimuth_deg, suite.elevation_deg)
    directory = options.directory
    with one_thread():
        networks = [load_network(method, options.device, view) for method in methods]
        manifest = _describe(options, suite, networks, pairs, triples)
        with open_run(directory, manifest, options.fresh):
            tables = _measure(networks, pairs, triples, options.seed, suite, directory)
    return LatentRun(directory, tables, time.perf_counter() - start)


def _check(options: Options) -> Split:
    """The split to be measured. Raises BadInput for wishes that have no meaning here."""
    refuse(
        LATENT.id,
        (
            ("conditions", options.conditions, "clouds have all their 2048 points"),
            ("views", options.views, "everything is seen from one fixed view"),
            ("workers", options.workers, "it works in one process"),
            ("shard", options.shard, "it works in one process"),
            ("ray", options.ray, "it works in one process"),
            ("inception-weights", options.inception_weights, "no fid is taken"),
        ),
    )
    if options.limit is not None and options.limit < 1:
        raise BadInput(f"--limit {options.limit}: must be at least 1 (pairs, and triples)")
    dataset = open_dataset(options.dataset)
    if dataset.finite is not None:
        raise BadInput(
            f"--dataset {options.dataset}: the suite {LATENT.id} chooses chairs by their "
            "descriptions, which only procedural ones have; leave it"
        )
    return dataset.measured


def _describe(
    options: Options,
    suite: LatentSuite,
    networks: Sequence[Network],
    pairs: Sequence[Pair],
    triples: Sequence[Triple],
) -> dict[str, Any]:
    return manifest_of(
        options,
        suite.id,
        1,
        environment(),
        methods=[network.method for network in networks],
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


def _measure(
    networks: Sequence[Network],
    pairs: Sequence[Pair],
    triples: Sequence[Triple],
    seed: int,
    suite: LatentSuite,
    directory: Path,
) -> tuple[Table[Mean], ...]:
    """Measure everything; write figures, tables and the single values behind them."""
    classifier = load_views_network(VIEWS_WEIGHTS)
    for old in (directory / FIGURES).glob("*.png"):  # of a run with other methods, perhaps
        old.unlink()
    on_paths: list[Value] = []
    on_sums: list[Value] = []
    for number, network in enumerate(networks, 1):
        # one figure a method; the first one's has no number
        tag = "" if number == 1 else f"-{number}"
        strips: list[Strip] = []
        with progress(f"paths, {network.method}", len(pairs)) as advance:
            for pair in pairs:
                values, strip = walk(network, classifier, pair, seed, suite.positions)
                on_paths += values
                strips += [strip] if len(strips) < suite.shown else []
                advance(0)
        figure = strips_figure(strips, network.view)
        save(figure, directory / FIGURES / f"interpolation{tag}.png")
        neighbours = train_codes(network, suite.neighbours)
        strips = []
        with progress(f"sums, {network.method}", len(triples)) as advance:
            for triple in triples:
                values, strip = add_up(network, triple, neighbours, seed)
                on_sums += values
                strips += [strip] if len(strips) < suite.shown else []
                advance(0)
        figure = strips_figure(strips, network.view)
        save(figure, directory / FIGURES / f"arithmetic{tag}.png")
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
        values_table(f"{table.name}_values", of)
        for table, of in zip(tables, (on_paths, on_sums), strict=True)
    ]
    write_tables(directory, [*tables, *values])
    return tables
