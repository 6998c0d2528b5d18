"""The tables that a run shows while it goes on, and when it has decided its headline."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from threadpoolctl import threadpool_limits

from bench.analysis.decided import DecidedPairs, classes_of, headline_pairs
from bench.analysis.object_sums import ObjectSums
from bench.analysis.scores import QualityRow, mean_rows
from bench.catalogue.metrics import LEARNED_METRICS, is_mean
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
        self._sums: ObjectSums | None = None
        self._decided: DecidedPairs | None = None
        self._until_decided = False
        self._order: deque[str] = deque()  # the objects that pairs have not seen, as they start

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
        means = [metric for metric in suite.headline if is_mean(metric)]
        self._sums = ObjectSums(manifest["methods"], manifest["conditions"], order, means)
        if pairs:
            self._decided = DecidedPairs(pairs, classes_of(order))
            self._order.extend(order)

    def _add(self, object_name: str, records: Sequence[Record]) -> None:
        """Add all records of an object "class/name" whose jobs have all ended."""
        assert self._sums is not None, "a run has begun"
        self._added.add(object_name)
        self._sums.add_object(records)
        while self._decided is not None and self._order and self._order[0] in self._added:
            name = self._order.popleft()
            self._decided.add(name.partition("/")[0], self._sums.means_of(name, self._sums.metrics))

    def add_missing(self, snapshot: PartialRun) -> None:
        """Add the objects of a run that have not been added yet."""
        missing = (name for name in snapshot.plan.names if name not in self._added)
        for obj in snapshot.plan.select(missing):
            self._add(obj.name, snapshot.read_records(obj))

    def enough(self) -> bool:
        """Return whether the run was to end when decided, and is."""
        return self._until_decided and self._decided is not None and self._decided.all_decided

    def table(self, snapshot: PartialRun) -> Table[QualityRow]:
        """Write the tables of the complete objects into the folder of tables.

        Return the headline table.
        """
        self.add_missing(snapshot)
        assert self._sums is not None, "a run has begun"
        manifest = snapshot.manifest
        suite = stored_suite(manifest)
        skipped = self._sums.unmeasured(manifest.get("skipped_metrics", {}))
        with threadpool_limits(1):
            rows = mean_rows(suite.id, self._sums, self._sums.metrics, skipped)
            table = headline_of(suite, manifest, rows)
        tables: list[Table[Any]] = [table]
        if self._decided is not None:
            objects = len(manifest["objects"])
            planned = int(manifest.get("planned", objects))
            decided = decided_table(suite.id, self._decided, objects, planned)
            tables.append(of_protocol(decided, suite, manifest[PROTOCOL]))
        write_tables(snapshot.directory, tables)
        return table
