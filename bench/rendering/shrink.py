"""From a failed record to a small cloud on which its method fails in the same way: `bench shrink`.

What is tried is what `bench render --as-is` does, in workers that can be killed. The search is
delta debugging: algorithm ddmin of Zeller and Hildebrandt, "Simplifying and isolating
failure-inducing input", IEEE Transactions on Software Engineering 28(2), 2002.
"""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.catalogue.suites import STABILITY, Limits
from bench.records.job import Job
from bench.records.journal import MANIFEST, read_finished
from bench.records.parquet import read_records
from bench.rendering.cloud import CloudFile, Drawing, Failed, draw_cloud, draw_file, find_drawer
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

Rows = NDArray[np.intp]  # [n], ascending
FirstFailing = Callable[[Iterable[Rows]], Rows | None]


def ever_smaller(count: int, first_failing: FirstFailing) -> Iterator[Rows]:
    """Smaller and smaller sets of the rows 0 .. count - 1, which fail as all of them do.

    `first_failing` gives the first that fails of the sets that it is offered, or None; it may take
    several at once. No set is offered twice, and the empty one comes first. The last set yielded
    is 1-minimal: without any one of its rows it does not fail. It is the smallest where whatever
    contains a failing set fails too, and there is but one smallest; else there may be smaller ones.
    Nothing is yielded where all the rows are 1-minimal.
    """
    rows = np.arange(count)
    # Whatever was offered need not be offered again, even behind a set that failed: that is no
    # part of it, and all later ones are.
    offered = {_key(rows)}

    def first(candidates: Iterable[Rows]) -> Rows | None:
        return first_failing(_fresh(candidates, offered))

    if (empty := first([rows[:0]])) is not None:
        yield empty
        return
    chunks = _halved([rows])
    while True:
        if (part := first(chunks)) is not None:
            yield part
            rows, chunks = part, _halved([part])
        elif (rest := first(_without(rows, chunk) for chunk in chunks)) is not None:
            yield rest
            removed = int(np.argmin(np.isin([chunk[0] for chunk in chunks], rest)))
            rows, chunks = rest, chunks[removed + 1 :] + chunks[:removed]  # on from there
        elif len(chunks) < len(rows):
            chunks = _halved(chunks)
        else:
            return


def _fresh(candidates: Iterable[Rows], offered: set[bytes]) -> Iterator[Rows]:
    for rows in candidates:
        if (key := _key(rows)) not in offered:
            offered.add(key)
            yield rows


def _key(rows: Rows) -> bytes:
    return sha256(rows.tobytes()).digest()


def _halved(chunks: Sequence[Rows]) -> list[Rows]:
    return [half for chunk in chunks for half in np.array_split(chunk, 2) if len(half)]


def _without(rows: Rows, chunk: Rows) -> Rows:
    kept = np.ones(len(rows), bool)
    kept[np.searchsorted(rows, chunk)] = False
    return rows[kept]


SHRUNK = "shrunk"
MINIMAL = "minimal.ply"
MOST_NAMED = 10
# Not the digits of a name: float32, SIGUSR1.
_NUMBER = re.compile(r"(?<![\w.])[-+]?(0x[0-9a-f]+|\d[\d,]*(\.\d+)?(e[-+]?\d+)?)(?!\w)", re.I)


@dataclass(frozen=True)
class Item:
    """A failed record: the folder of its run, its name there, why it failed; and its job."""

    directory: Path
    name: str
    reason: str
    job: Job
    limits: Limits


@dataclass(frozen=True, eq=False)
class Shrunk:
    """A cloud that fails as its record says.

    reason      why it fails, on the view of `drawing`, or on all its views
    points      float32 [n, 3], as they are in `path`
    before      number of points that there were
    trials, seconds  what it took
    minimal     False where the time ran out: fewer points may do
    reproduced  what `command` comes to: the reason of its failure, empty where it does not fail
    """

    reason: str
    path: Path
    points: Points
    before: int
    drawing: Drawing
    trials: int
    seconds: float
    minimal: bool
    reproduced: str

    @property
    def command(self) -> str:
        """Draws the cloud from the first view of `drawing`."""
        view, device = self.drawing.views[0], self.drawing.device
        arguments = (
            *("bench", "render", str(self.path), "--as-is", "--method", self.drawing.method),
            *("--azimuth", f"{view.azimuth_deg!r}", "--elevation", f"{view.elevation_deg!r}"),
            *(() if device == "auto" else ("--device", device)),
            *("-o", "out.png"),
        )
        return shlex.join(arguments)

    @property
    def message(self) -> str:
        """All of it, in lines for people; one of them is the command."""
        end = (
            "without any one of them it does not fail so"
            if self.minimal
            else "the time is up, fewer may do"
        )
        lines = [
            f"{self.drawing.method}: {self.reason}",
            f"{self.before} points became {len(self.points)} ({self.trials} trials, "
            f"{self.seconds:.0f} s); {end}",
        ]
        if self.drawing.rng is not None:
            lines.append(
                f"it fails so with the run's random numbers and its {len(self.drawing.views)} "
                "views, not with one of them alone; the command draws the first"
            )
        lines.append(self.command)
        if fails_alike(self.reproduced, self.reason):
            lines.append("reproduced")
        else:
            lines.append(f"not reproduced: {self.reproduced or 'the command draws an image'}")
        return "\n".join(lines)


@dataclass(frozen=True)
class NotReproduced:
    """A failure that is there no more; `now` is why it fails instead, empty where it does not."""

    name: str
    reason: str
    now: str

    @property
    def message(self) -> str:
        """One line."""
        now = f"fails otherwise now: {self.now}" if self.now else "is drawn now"
        return f"{self.name}: does not fail any more as it did ({self.reason}); it {now}"


def shrink(record: str, budget_s: float, workers: int, out: Path | None) -> Shrunk | NotReproduced:
    """Make the cloud of a failed record again, and take away what its failure does not need.

    The best cloud so far is always in the folder (default: DIR/shrunk/NAME), so that nothing is
    lost where the work is stopped. Work under way at the end of the budget goes beyond it: the
    time limit of the suite at most. Raises BadInput for a record that is none, an object that
    cannot be loaded, and a budget that ended before the failure was seen again.
    """
    if not budget_s > 0:
        raise BadInput(f"--budget-s {budget_s:g}: must be more than 0")
    start = time.monotonic()
    item = find_item(record)
    find_drawer(item.job.method)
    points = _points(item)
    path = (out or item.directory / SHRUNK / _file_name(item.name)) / MINIMAL
    with _Search(item, len(points), workers, start, budget_s) as search:
        failing = _first_failing_view(search, item.job, points)
        if failing is None:
            return NotReproduced(item.name, item.reason, search.last)
        save_ply(points, path)
        best, minimal = _shrink(search, failing, path)
    file = CloudFile(path, as_is=True)
    view = Drawing(item.job.method, failing.drawing.views[:1], item.job.device)
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


def fails_alike(reason: str, other: str) -> bool:
    """Whether two reasons are the same but for their numbers; no reason is like no other."""
    return bool(reason) and _NUMBER.sub("#", reason) == _NUMBER.sub("#", other)


# --- records --------------------------------------------------------------------------------------


def find_item(record: str) -> Item:
    """The failed record DIR:METHOD/CONDITION/CLASS/OBJECT, or DIR:METHOD/CASE.

    All of these may hold colons, and most of them slashes: it is looked for among the failed ones.
    Raises BadInput, which names some of these, where it is not there.
    """
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
    raise BadInput(f"{record}: no failed record; {_listed(record[: runs[-1]])}")


def _listed(directory: str) -> str:
    names = [f"{directory}:{name}" for name in _failed_records(Path(directory))]
    if not names:
        return "nothing has failed in this run"
    more = len(names) - MOST_NAMED
    return "there are " + ", ".join(names[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _failed_records(directory: Path) -> dict[str, dict[str, Any]]:
    """By name, the record of the first view of each item that failed."""
    cases = read_finished(directory)["suite"] == STABILITY.id
    columns = ["method", "condition", *(() if cases else ("class", "object"))]
    frame = read_records(directory)
    failed = frame[frame["outcome"] == "failed"].drop_duplicates(columns)
    rows: list[Any] = failed.to_dict("records")
    return {"/".join(row[column] for column in columns): row for row in rows}


def _item(directory: Path, name: str, record: dict[str, Any]) -> Item:
    """Plans the job of a record again."""
    manifest = read_finished(directory)
    method, condition, device = record["method"], record["condition"], manifest["device"]
    if manifest["suite"] == STABILITY.id:
        jobs = stability_jobs(STABILITY, [method], manifest["seed"], device, {}, directory)
        found = [job for job in jobs if job.condition == condition]
        if not found:
            raise BadInput(f"{name}: there is no such case any more; run the suite again")
        return Item(directory, name, record["reason"], found[0], STABILITY.limits)
    wanted = [(record["class"], record["object"])]
    protocol = stored_protocol(manifest, wanted, (method,), (condition,))
    if not protocol.objects:
        raise BadInput(
            f"{name}: the dataset {protocol.dataset} has no such object any more; bring its file "
            "back"
        )
    job = plan(protocol, directory).method_jobs[0]
    return Item(directory, name, record["reason"], job, protocol.suite.limits)


def _file_name(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9._@-]+", "-", name)[-200:]


def _points(item: Item) -> Points:
    """The cloud of the item, made in a worker. Raises BadInput where its object is at fault."""
    ((_, points),) = run_tasks([item.job], _points_of, 1, item.limits)
    if isinstance(points, Failed | WorkerFailure):
        raise BadInput(
            f"{item.name}: its cloud cannot be made ({points.reason}); it is the object that is at "
            "fault, not the method"
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
    """Some rows of a cloud, and what is drawn of them."""

    rows: Rows
    points: Points
    drawing: Drawing


class _OutOfTime(Exception):
    """The time is up."""


class _Search:
    """Trials in warm workers, until `budget_s` after `start`.

    reason  the last message of the wanted failure
    last    how the last trial ended
    left    number of points of the best cloud so far
    """

    def __init__(self, item: Item, count: int, workers: int, start: float, budget_s: float) -> None:
        self.reason = item.reason
        self.last = ""
        self.trials = 0
        self.left = count
        self._name, self._count = item.name, count
        self._workers = workers
        self._start, self._budget_s = start, budget_s
        self._said = time.monotonic()
        self._pool: TaskPool[_Trial, str] = TaskPool(_attempt, workers, item.limits)

    def __enter__(self) -> _Search:
        return self

    def __exit__(self, *exception: object) -> None:
        self._pool.close()

    def first_failing(self, trials: Iterable[_Trial]) -> _Trial | None:
        """The first of these that fails in the way that is wanted.

        As many at once as there are workers; what comes of it does not depend on their number.
        Raises _OutOfTime.
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
        found: dict[_Trial, str] = {}
        while len(found) < len(trials):
            for trial, result in self._pool.wait_any():
                found[trial] = result.reason if isinstance(result, WorkerFailure) else result
        self.trials += len(trials)
        self._say()
        return [found[trial] for trial in trials]

    def _say(self) -> None:
        """A line of progress now and then, as `data_prep.progress` where it is no terminal."""
        now = time.monotonic()
        if now - self._said < PLAIN_EVERY_S:
            return
        self._said = now
        log(
            f"{self._name}: {self.left} of {self._count} points left, {self.trials} trials, "
            f"{now - self._start:.0f} s of {self._budget_s:.0f} s"
        )


def _attempt(trial: _Trial) -> str:
    """In a worker: why the cloud cannot be drawn; empty where it can."""
    drawn = draw_cloud(PointCloud(trial.points), trial.drawing)
    return drawn.reason if isinstance(drawn, Failed) else ""


def _first_failing_view(search: _Search, job: Job, points: Points) -> _Trial | None:
    """The whole cloud from one view, as `bench render` draws it; else as the run did."""
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
    """The smallest cloud found, which is in `path` too; and whether it is 1-minimal."""
    points, best = failing.points, failing.points

    def first_failing(candidates: Iterable[Rows]) -> Rows | None:
        found = search.first_failing(
            _Trial(rows, points[rows], failing.drawing) for rows in candidates
        )
        return None if found is None else found.rows

    try:
        for rows in ever_smaller(len(points), first_failing):
            best = points[rows]
            search.left = len(best)
            save_ply(best, path)
    except _OutOfTime:
        return best, False
    return best, True
