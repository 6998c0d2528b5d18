"""The table that a run shows while it goes on."""

from __future__ import annotations

from threadpoolctl import threadpool_limits

from bench.analysis.object_sums import ObjectSums
from bench.analysis.scores import QualityRow, mean_rows
from bench.catalogue.metrics import is_mean
from bench.catalogue.suites import stored_suite
from bench.running.run import PartialRun
from bench.tables.headline import headline_of
from bench.tables.table import Table, write_tables


class LiveTable:
    """The headline table of a run, from sums that its objects are added to."""

    def __init__(self) -> None:
        self._added: set[str] = set()
        self._sums: ObjectSums | None = None

    def table(self, snapshot: PartialRun) -> Table[QualityRow]:
        """Write the table of the complete objects into the folder of tables, and return it."""
        manifest = snapshot.manifest
        suite = stored_suite(manifest)
        if self._sums is None:
            means = [metric for metric in suite.headline if is_mean(metric)]
            names = manifest["methods"], manifest["conditions"], snapshot.plan.names
            self._sums = ObjectSums(*names, means)
        missing = [name for name in manifest["objects"] if name not in self._added]
        for name in missing:
            self._sums.add_object(snapshot.read_records(name))
        self._added.update(missing)
        skipped = self._sums.unmeasured(manifest.get("skipped_metrics", {}))
        with threadpool_limits(1):
            rows = mean_rows(suite.id, self._sums, self._sums.metrics, skipped, True)
            table = headline_of(suite, manifest, rows)
        write_tables(snapshot.directory, [table])
        return table
