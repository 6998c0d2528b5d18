"""The table that a run shows while it goes on."""

from __future__ import annotations

import pandas as pd

from bench.analysis.scored_run import Run, full_frame, unmeasured
from bench.catalogue.metrics import is_mean
from bench.catalogue.suites import stored_suite
from bench.records.frames import sum_views
from bench.running.run import PartialRun
from bench.tables.quality import headline
from bench.tables.table import Table, write_tables


class LiveTable:
    """The headline table of a run, from the jobs of the objects that are complete."""

    def __init__(self) -> None:
        self._jobs: dict[str, pd.DataFrame] = {}  # by object

    def table(self, snapshot: PartialRun) -> Table:
        """Write the table of the complete objects into the folder of tables, and return it."""
        manifest, suite = snapshot.manifest, stored_suite(snapshot.manifest)
        means = [metric for metric in suite.headline if is_mean(metric)]
        for name in [name for name in manifest["objects"] if name not in self._jobs]:
            self._jobs[name] = sum_views(snapshot.read_records(name))
        jobs = full_frame(pd.concat(self._jobs.values()), manifest)
        skipped = unmeasured(jobs, manifest.get("skipped_metrics", {}))
        table = headline(Run(snapshot.directory, suite, manifest, jobs, skipped=skipped), means)
        write_tables(snapshot.directory, [table])
        return table
