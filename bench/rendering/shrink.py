"""The search for the smallest cloud that makes a method fail as its record says: `bench shrink`.

Each trial draws a part of the cloud as `bench render --as-is` does, in a worker that can be killed.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from bench.catalogue.claims import address_of
from bench.catalogue.suites import STABILITY, Limits
from bench.records.job import Job
from bench.records.parquet import read_records
from bench.records.run_folder import MANIFEST, read_finished
from bench.rendering.cloud import CloudFile, Drawing, Failed, draw_cloud, draw_file, find_drawer
from bench.rendering.delta_debugging import Rows, ever_smaller
from bench.rendering.shrink_result import NotReproduced, Shrunk, fails_alike
from bench.running.isolation import TaskPool, WorkerFailure, run_tasks
from bench.running.plan import plan
from bench.running.protocol import stored_protocol
from bench.running.work import cloud_of, reason_of, rng_of
from bench.suites.stability.run import stability_jobs
from data_prep.failures import BadInput
from data_prep.files.clouds import save_ply
from data_prep.files.safe_read import is_regular_file
from data_prep.progress import PLAIN_EVERY_S, log
from data_prep.scene import PointCloud, Points

SHRUNK = "shrunk"
MINIMAL = "minimal.ply"
MOST_NAMED = 10


@dataclass(frozen=True)
class FailedJob:
    """A job that failed.

    directory  of its run
    name       of its record
    """

    directory: Path
    name: str
    reason: str
    job: Job
    limits: Limits


def shrink(
    record: str,
    budget_s: float,
    workers: int,
    out: Path | None,
    log_every_s: float = PLAIN_EVERY_S,
) -> Shrunk | NotReproduced:
    """Find the smallest cloud that still makes the method of a failed record fail.

    The best cloud so far is always in the folder (default: DIR/shrunk/NAME), so that nothing is
    lost where the work is stopped. Trials that run at the end of the budget go beyond it, by the
    time limit of the suite at most. Raises BadInput for an unknown record, an object that cannot be
    loaded, and a budget that ended before the failure was reproduced.
    """
    if not budget_s > 0:
        raise BadInput(f"--budget-s {budget_s:g}: must be more than 0")
    start = time.monotonic()
    failed = find_failed_job(record)
    find_drawer(failed.job.method)
    points = _points(failed)
    folder_name = re.sub(r"[^A-Za-z0-9._@-]+", "-", failed.name)[-200:]
    path = (out or failed.directory / SHRUNK / folder_name) / MINIMAL
    with _Search(failed, len(points), workers, start, budget_s, log_every_s) as search:
        failing = _first_failing_view(search, failed.job, points)
        if failing is None:
            return NotReproduced(failed.name, failed.reason, search.last)
        save_ply(points, path)
        best, minimal = _shrink(search, failing, path)
    file = CloudFile(path, as_is=True)
    view = Drawing(failed.job.method, failing.drawing.views[:1], failed.job.device)
    again = draw_file(file, view)
    return Shrunk(
        search.reason,
        path,
        best,
        before=len(points),
        drawing=failing.drawing,
        trials=search.trials,
        seconds=time.monotonic() - start,
        minimal=minimal,
        reproduced=again.reason if isinstance(again, Failed) else "",
    )


# --- records --------------------------------------------------------------------------------------


def find_failed_job(record: str) -> FailedJob:
    """Return the job of the failed record DIR:METHOD/CONDITION/CLASS/OBJECT, or DIR:METHOD/CASE.

    Raises BadInput, which names some failed records, for any other name.
    """
    # Each part may hold colons, and most of them slashes, so that names are not taken apart.
    ends = [i for i, letter in enumerate(record) if letter == ":"] + [len(record)]
    runs = [i for i in ends if is_regular_file(Path(record[:i]) / MANIFEST)]
    if not runs:
        raise BadInput(
            f"{record}: no run there; give DIR:METHOD/CONDITION/CLASS/OBJECT, of the suite "
            f"{STABILITY.id} DIR:METHOD/CASE"
        )
    for end in runs:
        directory, name = Path(record[:end]), record[end + 1 :]
        failed = _failed_records(directory)
        if name in failed:
            return _item(directory, name, failed[name])
    last = record[: runs[-1]]
    names = [f"{last}:{name}" for name in _failed_records(Path(last))]
    if not names:
        raise BadInput(f"{record}: no failed record; nothing has failed in this run")
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    raise BadInput(f"{record}: no failed record; there are {', '.join(names[:MOST_NAMED])}{more}")


def _failed_records(directory: Path) -> dict[str, dict[str, Any]]:
    """Return the record of the first view of each failed job, by its name."""
    cases = read_finished(directory)["suite"] == STABILITY.id
    columns = ["method", "condition", *(() if cases else ("class", "object"))]
    failed = read_records(directory, outcome="failed").drop_duplicates(columns)
    rows: list[Any] = failed.to_dict("records")
    return {"/".join(row[column] for column in columns): row for row in rows}


def _item(directory: Path, name: str, record: dict[str, Any]) -> FailedJob:
    """Plan the job of a record again."""
    manifest = read_finished(directory)
    method, condition, device = record["method"], record["condition"], manifest["device"]
    if manifest["suite"] == STABILITY.id:
        jobs = stability_jobs(STABILITY, [method], manifest["seed"], device, {})
        same_case = [job for job in jobs if job.condition == condition]
        if not same_case:
            raise BadInput(f"{name}: there is no such case any more; run the suite again")
        return FailedJob(directory, name, record["reason"], same_case[0], STABILITY.limits)
    if address_of(manifest, method) != method:
        raise BadInput(
            f"{name}: the images of {method} were drawn elsewhere, and it cannot draw smaller "
            "clouds; give a failure of another method"
        )
    wanted = [(record["class"], record["object"])]
    protocol = stored_protocol(manifest, wanted, (method,), (condition,))
    if not protocol.objects:
        raise BadInput(
            f"{name}: the dataset {protocol.dataset} has no such object any more; bring its file "
            "back"
        )
    job = plan(protocol)[0].method_jobs[0]
    return FailedJob(directory, name, record["reason"], job, protocol.suite.limits)


def _points(failed: FailedJob) -> Points:
    """Return the cloud of a job, loaded in a worker. Raises BadInput where that fails."""
    ((_, points),) = run_tasks([failed.job], _points_of, 1, failed.limits)
    if isinstance(points, Failed | WorkerFailure):
        raise BadInput(
            f"{failed.name}: its cloud cannot be made ({points.reason}); it is the object that is "
            "at fault, not the method"
        )
    return points


def _points_of(job: Job) -> Points | Failed:
    try:
        return cloud_of(job).points
    except (Exception, SystemExit) as error:
        return Failed(reason_of(error))


# --- trials ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Trial:
    """A request for views of some rows of a cloud."""

    rows: Rows
    points: Points
    drawing: Drawing


class _OutOfTime(Exception):
    """A search whose time is up."""


class _Search:
    """A series of trials in warm workers, until `budget_s` after `start`.

    reason  the last message of the wanted failure
    last    the reason of the last trial; empty where it was drawn
    left    number of points of the best cloud so far
    """

    def __init__(
        self,
        failed: FailedJob,
        count: int,
        workers: int,
        start: float,
        budget_s: float,
        log_every_s: float,
    ) -> None:
        self.reason = failed.reason
        self.last = ""
        self.trials = 0
        self.left = count
        self._name, self._count = failed.name, count
        self._workers = workers
        self._start, self._budget_s = start, budget_s
        self._log_every_s, self._reported = log_every_s, time.monotonic()
        self._pool: TaskPool[_Trial, str] = TaskPool(_attempt, workers, failed.limits)

    def __enter__(self) -> _Search:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.close()

    def first_failing(self, trials: Iterable[_Trial]) -> _Trial | None:
        """Return the first of these trials that fails as the record says.

        Each worker has a trial at a time; the result does not depend on their number. Raises
        _OutOfTime.
        """
        trials = iter(trials)
        while some := list(islice(trials, self._workers)):
            if time.monotonic() - self._start > self._budget_s:
                raise _OutOfTime
            for trial, reason in zip(some, self._reasons(some), strict=True):
                self.last = reason
                if fails_alike(reason, self.reason):
                    self.reason = reason
                    return trial
        return None

    def _reasons(self, trials: Sequence[_Trial]) -> list[str]:
        for trial in trials:
            self._pool.submit(trial)
        reasons: dict[_Trial, str] = {}
        while len(reasons) < len(trials):
            for trial, result in self._pool.wait_any():
                reasons[trial] = result.reason if isinstance(result, WorkerFailure) else result
        self.trials += len(trials)
        self._report()
        return [reasons[trial] for trial in trials]

    def _report(self) -> None:
        """Write a line of progress now and then."""
        now = time.monotonic()
        if now - self._reported < self._log_every_s:
            return
        self._reported = now
        log(
            f"{self._name}: {self.left} of {self._count} points left, {self.trials} trials, "
            f"{now - self._start:.0f} s of {self._budget_s:.0f} s"
        )


def _attempt(trial: _Trial) -> str:
    """Return why the cloud cannot be drawn, in a worker; empty where it can."""
    drawn = draw_cloud(PointCloud(trial.points), trial.drawing)
    return drawn.reason if isinstance(drawn, Failed) else ""


def _first_failing_view(search: _Search, job: Job, points: Points) -> _Trial | None:
    """Return a trial of the whole cloud that fails; None where none does.

    It draws one view, as `bench render` does, or else all views as the run did.
    """
    rows = np.arange(len(points))
    alone = [Drawing(job.method, (view,), job.device) for view in dict.fromkeys(job.views)]
    as_run = Drawing(job.method, job.views, job.device, job.batch, rng_of(job))
    try:
        return search.first_failing(
            _Trial(rows, points, drawing) for drawing in alone
        ) or search.first_failing([_Trial(rows, points, as_run)])
    except _OutOfTime:
        raise BadInput(
            "--budget-s: over before the failure was seen again; give more seconds"
        ) from None


def _shrink(search: _Search, failing: _Trial, path: Path) -> tuple[Points, bool]:
    """Return the smallest cloud that fails, which is in `path` too, and whether it is 1-minimal."""
    points, best = failing.points, failing.points

    def first_failing(candidates: Iterable[Rows]) -> Rows | None:
        trial = search.first_failing(
            _Trial(rows, points[rows], failing.drawing) for rows in candidates
        )
        return None if trial is None else trial.rows

    try:
        for rows in ever_smaller(len(points), first_failing):
            best = points[rows]
            search.left = len(best)
            save_ply(best, path)
    except _OutOfTime:
        return best, False
    return best, True
