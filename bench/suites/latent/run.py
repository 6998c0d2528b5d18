"""The suite `latent`: paths between codes, and whether A - B + C is D (Figures 5 and 6).

It runs in one process for about a minute, from the beginning each time. The same seed gives the
same bytes on one machine, with any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import pandas as pd

from bench.catalogue import suites
from bench.catalogue.suites import Procedure
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.records.store import Store
from bench.running.environment import environment
from bench.running.isolation import library_threads
from bench.running.options import Options
from bench.suites.latent.chairs import (
    ChairPair,
    Triple,
    choose_pairs,
    choose_triples,
    specified_chairs,
)
from bench.suites.latent.codes import (
    ANSWERS,
    PATH_METRICS,
    PATH_REMARK,
    PATHS,
    SUM_METRICS,
    SUM_REMARK,
    add_up,
    train_codes,
    walk,
)
from bench.suites.latent.figures import strips_figure
from bench.suites.latent.network import LatentNetwork, load_network, weights_of
from bench.suites.latent.tables import VALUES, latent_table, means
from bench.suites.procedure import SuiteRun, methods_of, run_suite, suite_manifest
from bench.tables.table import Table
from data_prep.datasets.registry import Split, open_dataset
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import View


@dataclass(frozen=True)
class LatentSuite(Procedure):
    """Paths between codes and sums of codes of networks: pc2pix with any weights."""

    pairs: int = 50  # of test chairs of different structural families, joined by a path
    positions: int = 8  # on a path, its two ends included
    triples: int = 60  # sums A - B + C, where A is B with one change
    pool: int = 800  # test chairs that the triples are chosen from
    neighbours: int = 500  # train chairs that the nearest to a sum is chosen from
    shown: int = 5  # pairs and triples in the figures


LATENT = LatentSuite(**vars(suites.LATENT))
VIEW = View(30.0, 20.0)  # of all images


def run(
    options: Options,
    suite: LatentSuite = LATENT,
    environment: Callable[[], Mapping[str, str]] = environment,
) -> SuiteRun:
    """Carry out the suite; `environment` describes the drivers that images depend on.

    Raises BadInput for options that the user has to fix.
    """
    methods = methods_of(
        options,
        suite,
        conditions="clouds have all their 2048 points",
        views="everything is seen from one fixed view",
        **dict.fromkeys(("workers", "shard", "ray"), "it works in one process"),
    )
    split, seed = _split(options), options.seed or 0
    for method in methods:
        weights_of(method)
    chairs = specified_chairs(split, max(suite.pool, 2 * suite.pairs))
    pairs = choose_pairs(chairs[: 2 * suite.pairs], generator(seed, "latent pairs"))
    rng = generator(seed, "latent triples")
    triples = choose_triples(chairs[: suite.pool], suite.triples, rng)
    pairs, triples = pairs[: options.limit], triples[: options.limit]
    with library_threads(1):
        networks = [load_network(method, options.device, VIEW) for method in methods]
        manifest = suite_manifest(
            replace(options, methods=methods, seed=seed),
            suite,
            1,
            environment(),
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
        measured = partial(_measure, networks, pairs, triples, seed, suite)
        return run_suite(options, manifest, measured)


def _split(options: Options) -> Split:
    """Return the split to be measured; raise BadInput for a dataset without descriptions."""
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
    _: Store,
) -> SuiteRun:
    """Measure everything, and return it with the single values behind the means."""
    classifier = load_views_network(VIEWS_WEIGHTS)
    rows: dict[str, list[tuple[object, ...]]] = {"interpolation": [], "arithmetic": []}
    figures = {}
    for number, network in enumerate(networks, 1):
        # Each method has a figure; the first has no number.
        suffix = "" if number == 1 else f"-{number}"
        train = train_codes(network, suite.neighbours)
        walks = partial(walk, network, classifier, seed=seed, positions=suite.positions)
        sums = partial(add_up, network, train=train, seed=seed)
        for name, title, items, measure in (
            ("interpolation", "paths", pairs, walks),
            ("arithmetic", "sums", triples, sums),
        ):
            strips = []
            with progress(f"{title}, {network.method}", len(items)) as advance:
                for item in items:
                    measured, strip = measure(item)  # type: ignore[arg-type]
                    for what, values in measured.items():
                        where = network.method, what, item.change, item.id
                        rows[name] += [(*where, *value) for value in values.items()]
                    if len(strips) < suite.shown:
                        strips.append(strip)
                    advance(0)
            figures[f"{name}{suffix}"] = strips_figure(strips, VIEW)
    tables = []
    for name, title, remark, about, subjects in (
        ("interpolation", "Paths between codes (after Figure 5)", PATH_REMARK, PATH_METRICS, PATHS),
        ("arithmetic", "A - B + C against D (after Figure 6)", SUM_REMARK, SUM_METRICS, ANSWERS),
    ):
        frame, file = pd.DataFrame(rows[name], columns=VALUES), f"latent_{name}"
        of_means = means(suite.id, frame)
        tables.append(latent_table(file, title, remark, about, subjects, of_means))
        tables.append(Table(f"{file}_values", "", frame, digits=".6g"))
    return SuiteRun(tuple(tables), figures)
