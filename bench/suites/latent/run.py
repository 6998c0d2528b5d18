"""The suite `latent`: paths between codes, and whether A - B + C is D (Figures 5 and 6).

It runs in one process for about a minute, from the beginning each time. The same seed gives the
same bytes on one machine, with any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from bench.analysis.intervals import mean_interval
from bench.catalogue import suites
from bench.catalogue.suites import Procedure
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.records.store import Store
from bench.running.environment import environment
from bench.running.options import Options
from bench.running.pool import library_threads
from bench.suites.latent.chairs import (
    ALL,
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
    LatentNetwork,
    add_up,
    load_network,
    strips_figure,
    train_codes,
    walk,
    weights_of,
)
from bench.suites.procedure import SuiteRun, methods_of, run_suite, suite_manifest
from bench.tables import markdown
from bench.tables.grid import Block, Cell, number_cell, ordered, pivot
from bench.tables.table import Table
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import View


@dataclass(frozen=True)
class _LatentSuite(Procedure):
    """Paths between codes and sums of codes of networks: pc2pix with any weights."""

    pairs: int = 50  # pairs of test chairs of different structural families, joined by a path
    positions: int = 8  # codes on a path, its two ends included
    triples: int = 60  # sums A - B + C, where A is B with one change
    pool: int = 800  # test chairs among which the triples are chosen
    neighbours: int = 500  # train chairs among which the one nearest to a sum is looked for
    shown: int = 5  # the number of pairs, and of triples, in the figures


LATENT = _LatentSuite(**vars(suites.LATENT))
VIEW = View(30.0, 20.0)  # the view from which all images are drawn
VALUES = ["method", "what", "kind", "item", "metric", "value"]  # the columns of tables of values
_Value = tuple[str, str, str, str, str, float]  # a row of such a table
_Item = TypeVar("_Item", ChairPair, Triple)


def run(
    options: Options,
    suite: _LatentSuite = LATENT,
    environment: Callable[[], Mapping[str, str]] = environment,
) -> SuiteRun:
    """Carry out the suite; `environment` returns the drivers that images depend on.

    Raises BadInput for options that the user has to fix.
    """
    methods = methods_of(
        options,
        suite,
        conditions="clouds have all their 2048 points",
        views="everything is seen from one fixed view",
        workers="it works in one process",
        ray="it works in one process",
    )
    dataset, seed = open_dataset(options.dataset), options.seed or 0
    if dataset.finite is not None or dataset.measured == "novel-families":
        raise BadInput(
            f"--dataset {options.dataset}: the suite {suite.id} chooses chairs by their "
            "descriptions, which only procedural ones have; leave out --dataset"
        )
    for method in methods:
        weights_of(method)  # raises BadInput for a method without codes
    chairs = specified_chairs(dataset.measured, max(suite.pool, 2 * suite.pairs))
    pairs = choose_pairs(chairs[: 2 * suite.pairs], generator(seed, "latent pairs"))
    rng = generator(seed, "latent triples")
    triples = choose_triples(chairs[: suite.pool], suite.triples, rng)
    pairs, triples = pairs[: options.limit], triples[: options.limit]
    with library_threads(1):
        networks = [load_network(method, options.device, VIEW) for method in methods]
        weights = {}
        for network in networks:
            weights[network.method] = {
                "weights": network.renderer.weights.sha256,
                "decoder": network.decoder_sha256,
            }
        manifest = suite_manifest(
            replace(options, methods=methods, seed=seed),
            suite,
            1,
            environment(),
            weights=weights,
            pairs=[pair.id for pair in pairs],
            triples=[triple.id for triple in triples],
        )
        measured = partial(_measure, networks, pairs, triples, seed, suite)
        return run_suite(options, manifest, measured)


def _measure(
    networks: Sequence[LatentNetwork],
    pairs: Sequence[ChairPair],
    triples: Sequence[Triple],
    seed: int,
    suite: _LatentSuite,
    _: Store,
) -> SuiteRun:
    """Measure paths and sums of all networks; return tables of means and of values, and figures."""
    classifier = load_views_network(VIEWS_WEIGHTS)
    path_values: list[_Value] = []
    sum_values: list[_Value] = []
    figures = {}
    for number, network in enumerate(networks, 1):
        # Each method has its own figures. The names of the first method's have no number.
        suffix = "" if number == 1 else f"-{number}"
        measure_path = partial(walk, network, classifier, seed=seed, positions=suite.positions)
        values, strips = _measure_each(f"paths, {network.method}", network, pairs, measure_path)
        path_values += values
        figures[f"interpolation{suffix}"] = strips_figure(strips[: suite.shown], VIEW)
        train = train_codes(network, suite.neighbours)
        measure_sum = partial(add_up, network, train=train, seed=seed)
        values, strips = _measure_each(f"sums, {network.method}", network, triples, measure_sum)
        sum_values += values
        figures[f"arithmetic{suffix}"] = strips_figure(strips[: suite.shown], VIEW)
    paths = pd.DataFrame(path_values, columns=VALUES)
    sums = pd.DataFrame(sum_values, columns=VALUES)
    tables = (
        latent_table(
            "latent_interpolation",
            "Paths between codes (after Figure 5)",
            PATH_REMARK,
            about=PATH_METRICS,
            subjects=PATHS,
            rows=means(suite.id, paths),
        ),
        Table("latent_interpolation_values", "", paths, digits=".6g"),
        latent_table(
            "latent_arithmetic",
            "A - B + C against D (after Figure 6)",
            SUM_REMARK,
            about=SUM_METRICS,
            subjects=ANSWERS,
            rows=means(suite.id, sums),
        ),
        Table("latent_arithmetic_values", "", sums, digits=".6g"),
    )
    return SuiteRun(tables, figures)


def _measure_each(
    title: str,
    network: LatentNetwork,
    items: Sequence[_Item],
    measure: Callable[[_Item], tuple[Mapping[str, Mapping[str, float]], Any]],
) -> tuple[list[_Value], list[Any]]:
    """Return rows with the values of all pairs or triples, and a strip of images for each."""
    values: list[_Value] = []
    strips = []
    with progress(title, len(items)) as advance:
        for item in items:
            measured, strip = measure(item)
            for what, by_metric in measured.items():
                for metric, value in by_metric.items():
                    values.append((network.method, what, item.change, item.id, metric, value))
            strips.append(strip)
            advance(0)
    return values, strips


GROUP = ["method", "what", "kind", "metric"]  # the columns in which the values of a mean agree


def latent_table(
    name: str,
    title: str,
    remark: str,
    about: Mapping[str, str],
    subjects: Mapping[str, str],
    rows: pd.DataFrame,
) -> Table:
    """Return a table of means with the text that readers need.

    about     the text on each metric, by its id, in the order of the table
    subjects  the text on each path or code ("what"), by its id, in the order of the table
    rows      the means, as `means` returns them
    """

    def cell(row: Any) -> Cell:
        n_ok, n = row["n_ok"], row["n"]
        if not n_ok:
            return Cell(f"- 0/{n}")
        count = f" {n_ok}/{n}" if n_ok < n else ""
        estimate = row["value"], row["ci_low"], row["ci_high"]
        return number_cell(estimate, "{:.3g}".format, rest=count)

    def layout(_: pd.DataFrame) -> Iterator[Block]:
        yield remark
        yield "\n".join(f"* **{subject}**: {message}" for subject, message in subjects.items())
        for method in ordered(rows["method"]):
            for kind, chosen in rows[rows["method"] == method].groupby("kind", sort=False):
                subject = markdown.cell(method if kind == ALL else f"{method}, {kind} only")
                yield f"## {subject} (n = {chosen['n'].max()})"
                shown = {*chosen["what"]}
                across = [subject for subject in subjects if subject in shown]
                yield pivot(
                    chosen,
                    "metric",
                    "what",
                    cell,
                    lines=about,
                    columns=across,
                    missing=Cell(""),
                )
        yield "\n".join(f"* {metric}: {message}" for metric, message in about.items())

    return Table(name, title, rows, layout, digits=".6g")


def means(suite: str, values: pd.DataFrame) -> pd.DataFrame:
    """Return means over pairs or triples, with 95 % intervals.

    The frame has a row for each method, path or code, kind and metric, in the order of their first
    values. Its first rows are means over all kinds. `n` counts the pairs or triples, and `n_ok`
    those whose value is defined.

    values  a frame with the columns VALUES: the method; `what`, the path, or the code that is
            compared with the right answer; `kind`, the change of a triple, or ALL; `item`, the pair
            or triple; the metric; the value, NaN where it is undefined, as for a path without any
            move
    """
    both = pd.concat([values.assign(kind=ALL), values[values["kind"] != ALL]])
    rows = []
    for key, group in both.groupby(GROUP, sort=False)["value"]:
        finite = group.dropna().to_numpy()
        low, high = mean_interval(finite)
        row = {"suite": suite, **dict(zip(GROUP, key, strict=True))}
        row["value"] = float(finite.mean()) if len(finite) else np.nan
        row |= {"ci_low": low, "ci_high": high, "n_ok": len(finite), "n": len(group)}
        rows.append(row)
    return pd.DataFrame(rows, columns=["suite", *GROUP, "value", "ci_low", "ci_high", "n_ok", "n"])
