"""The tables that a run shows while it goes on, and when it has decided its headline."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from bench.analysis.decided import (
    DecidedPairs,
    ObjectMeans,
    classes_of,
    headline_pairs,
    object_means,
)
from bench.analysis.running_scores import RunningScores
from bench.analysis.scores import QualityRow
from bench.catalogue.methods import FLOOR
from bench.catalogue.metrics import LEARNED_METRICS, is_mean
from bench.catalogue.suites import Suite
from bench.catalogue.truth import stored_suite
from bench.records.record import Record
from bench.records.run_folder import PROTOCOL
from bench.running.listeners import PartialRun
from bench.running.options import UNTIL_DECIDED
from bench.tables.decided import decided_table
from bench.tables.headline import headline_of
from bench.tables.table import Table, of_protocol, write_tables
from data_prep.failures import BadInput


class LiveTable:
    """The headline table and the decided pairs of a run, from sums that its objects are added to.

    It is the rule by which a run ends when decided (`bench.running.listeners.StopRule`).
    """

    def __init__(self) -> None:
        self._added: set[str] = set()
        self._scores: RunningScores | None = None
        self._decided: DecidedPairs | None = None
        self._until_decided = False
        # Objects in the order of their start, and means of those that ended before an earlier one.
        self._order: deque[str] = deque()
        self._waiting: dict[str, ObjectMeans] = {}

    def begin(self, manifest: Mapping[str, Any], order: Sequence[str]) -> None:
        """Take the manifest of a run and its objects in the order of their start.

        Raises BadInput for a run that is to end when decided, but has nothing to decide.
        """
        suite = stored_suite(dict(manifest))
        skipped = manifest.get("skipped_metrics", {})
        metrics = [m for m in suite.headline if LEARNED_METRICS.get(m, m) not in skipped]
        pairs = headline_pairs(suite, manifest["methods"], manifest["conditions"], metrics)
        self._until_decided = bool(manifest.get(UNTIL_DECIDED))
        if self._until_decided and not pairs:
            raise BadInput(
                f"--until-decided: {', '.join(manifest['methods'])} have no pair to decide: give a "
                "network and a reconstruction, at a condition that ranks reconstructions"
            )
        if pairs:
            self._decided = DecidedPairs(pairs, classes_of(order))
            self._order.extend(order)

    def add(self, object_name: str, records: Sequence[Record], suite: Suite) -> None:
        """Add all records of an object "class/name" whose jobs have all ended."""
        self._added.add(object_name)
        metrics = [metric for metric in suite.headline if is_mean(metric)]
        if self._scores is None:
            self._scores = RunningScores(suite.id, metrics)
        self._scores.add(records)
        if self._decided is None:
            return
        self._waiting[object_name] = object_means(records, metrics, FLOOR)
        while self._order and self._order[0] in self._waiting:
            name = self._order.popleft()
            self._decided.add(name.partition("/")[0], self._waiting.pop(name))

    def add_missing(self, snapshot: PartialRun) -> None:
        """Add the objects of a run that have not been added yet."""
        suite = stored_suite(snapshot.manifest)
        missing = (name for name in snapshot.plan.names if name not in self._added)
        for obj in snapshot.plan.select(missing):
            self.add(obj.name, snapshot.read_records(obj), suite)

    def enough(self) -> bool:
        """Return whether the run was to end when decided, and is."""
        return self._until_decided and self._decided is not None and self._decided.all_decided

    def table(self, snapshot: PartialRun) -> Table[QualityRow]:
        """Write the tables of the complete objects into the folder of tables.

        Return the headline table.
        """
        self.add_missing(snapshot)
        assert self._scores is not None, "a snapshot has an object"
        manifest = snapshot.manifest
        suite = stored_suite(manifest)
        reasons = manifest.get("skipped_metrics", {})
        skipped = {
            metric: reasons.get(extractor, f"skipped: {extractor} is not measured")
            for metric, extractor in LEARNED_METRICS.items()
            if metric in suite.headline and not self._scores.has_values(metric)
        }
        with threadpool_limits(1):
            rows = self._scores.rows(manifest["methods"], manifest["conditions"], skipped)
            table = headline_of(suite, manifest, rows)
        tables: list[Table[Any]] = [table]
        if self._decided is not None:
            objects = len(manifest["objects"])
            planned = int(manifest.get("planned", objects))
            decided = decided_table(suite.id, self._decided, objects, planned)
            tables.append(of_protocol(decided, suite, manifest[PROTOCOL]))
        write_tables(snapshot.directory, tables)
        return table
