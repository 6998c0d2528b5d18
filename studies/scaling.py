"""A run of any size without its work: the real harness, and workers that return stored results.

    python -m studies.scaling RUN FOLDER --objects 44000 [--methods M,...] [--conditions C,...]
        [--shard 1/4] [--workers 2] [--ray local] [--tables]

RUN is a finished run of one object with all methods and conditions (`bench run --limit 1`). FOLDER
gets a dataset of links to one mesh (`meshes`) and the run (`run`). Plan, schedule, worker
processes, store and tables are those of any run; only drawing and scoring are left out. Printed are
the time to the first job, jobs a second, peak memory of this process, files, bytes a job, and with
`--tables` the time of the tables. The same command goes on with a run, or resumes a finished one.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from unittest import mock

import bench.running.factory
from bench.analysis.scored import scored_run
from bench.catalogue.suites import Limits
from bench.records.job import Job, Result
from bench.records.run_folder import read_manifest, read_store
from bench.records.stored_artifacts import read_jobs
from bench.running.executors import JobPool
from bench.running.isolation import TaskPool
from bench.running.listeners import PartialRun
from bench.running.options import LOCAL, Options
from bench.running.protocol import Protocol
from bench.running.ray import Cluster, RayPool
from bench.running.run import RunResult, WrittenRun, run
from bench.running.shards import read_shard
from bench.tables.build import write_outputs
from studies.arguments import names, positive

MESH = "v 1 1 1\nv 1 -1 -1\nv -1 1 -1\nv -1 -1 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n"
STARTED = time.monotonic()
LINKS_IN_FOLDER = 50  # datasets of this size have a folder for each object


def write_dataset(folder: Path, objects: int) -> None:
    """Make a tree of links to one mesh, as far as it is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh = folder.parent / "mesh.obj"
    mesh.write_text(MESH)
    for number in range(objects):
        link = folder / "chair" / f"{number // LINKS_IN_FOLDER:04d}" / f"{number:06d}.obj"
        if not link.is_symlink():
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(mesh)


@cache
def stored_results(directory: Path) -> dict[tuple[str, str], Result]:
    """Return a result for each method and condition of a finished run."""
    results = {}
    with read_store(directory) as store:
        for row in read_jobs(directory):
            if row.artifact_sha256:
                result = store.find([row.key])[row.key]
                records, artifact = tuple(store.records(row.key)), store.artifact(row.key)
                name = row.name.method, row.name.condition
                results[name] = replace(result, records=records, artifact=artifact)
    return results


def return_stored(directory: Path, job: Job) -> Result:
    """Return the stored result of the method of a job, under the name of the job."""
    result = stored_results(directory)[job.method, job.condition]
    records = tuple(
        replace(record, object=job.object.object_id, class_name=job.object.class_name)
        for record in result.records
    )
    return replace(result, key=job.key, records=records)


class StoredResults(JobPool):
    """An executor whose workers return stored results at once."""

    def __init__(self, count: int, workers: int, limits: Limits, directory: Path) -> None:
        work: Callable[[Job], Result] = partial(return_stored, directory)
        self._pool = TaskPool(work, min(workers, count), limits)
        self.capacity = self._pool.capacity


class StoredResultsOnRay(RayPool):
    """Workers of a Ray cluster that return stored results at once; all nodes see the folder."""

    def __init__(self, cluster: Cluster, protocol: Protocol, directory: Path) -> None:
        super().__init__(cluster, protocol)
        self._message = self._ray.put(directory)
        # Not of `__main__`, which is another module on a node.
        work = import_module("studies.scaling").return_all_stored
        self._do = self._ray.remote(num_cpus=1)(work)


def return_all_stored(
    directory: Path, jobs: Sequence[tuple[Job, str]], *references: bytes | None
) -> list[Result]:
    """Return the stored results of jobs with fingerprints, as `bench.running.ray_node` does."""
    del references
    return [return_stored(directory, job) for job, _ in jobs]


class JobCounter:
    """A progress reporter that notes when the first job ended."""

    def __init__(self, title: str, total: int) -> None:
        del title
        self.total, self.done, self.first_s, self.last_s = total, 0, None, 0.0

    def on_jobs_done(self, ended: int, failed: int) -> None:
        """Count jobs that have ended."""
        del failed
        self.last_s = time.monotonic()
        if self.first_s is None:
            self.first_s = self.last_s
            print(f"first of {self.total} jobs after {self.last_s - STARTED:.1f} s", flush=True)
        self.done += ended
        if self.done % 20_000 < ended:
            seconds = self.last_s - self.first_s
            print(f"{self.done} of {self.total}, {seconds:.0f} s, {peak_mib()} MiB", flush=True)

    def on_object_done(self, snapshot: Callable[[], PartialRun]) -> None:
        """Leave out the live table."""


def peak_mib() -> int:
    """Return the most memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10


def measure(sample: Path, options: Options, tables: bool) -> dict[str, float]:
    """Carry out a run with stored results and return what it took."""
    reporter: list[JobCounter] = []

    @contextmanager
    def watch(title: str, total: int) -> Iterator[JobCounter]:
        reporter.append(JobCounter(title, total))
        yield reporter[-1]

    def publish(written: WrittenRun) -> float:
        start = time.monotonic()
        if tables:
            write_outputs(scored_run(written.directory, read_manifest(written.directory)))
        return time.monotonic() - start

    begun = time.monotonic()
    factory = bench.running.factory
    with (
        mock.patch.object(factory, "JobPool", partial(StoredResults, directory=sample)),
        mock.patch.object(factory, "RayPool", partial(StoredResultsOnRay, directory=sample)),
    ):
        done: RunResult[float] = run(options, publish, watch)
    directory = options.directory
    size = sum(path.stat().st_size for path in directory.rglob("*") if path.is_file())
    taken = reporter[-1] if reporter else None
    jobs_s = taken.last_s - (taken.first_s or 0.0) if taken else 0.0
    return {
        "jobs": done.done,
        "from before": done.reused,
        "first job, s": round((taken.first_s or 0.0) - begun, 1) if taken else 0.0,
        "jobs a second": round(done.done / jobs_s, 1) if jobs_s else 0.0,
        "all, s": round(time.monotonic() - begun, 1),
        "Parquet files, s": done.seconds.get("tables", 0.0),
        "tables, s": round(done.outputs or 0.0, 1),
        "peak memory, MiB": peak_mib(),
        "files": sum(path.is_file() for path in directory.rglob("*")),
        "bytes a job": round(size / max(1, done.done + done.reused)),
    }


def main() -> None:
    """Print the costs of a simulated run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sample", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--objects", type=positive, required=True)
    parser.add_argument("--methods", type=names)
    parser.add_argument("--conditions", type=names)
    parser.add_argument("--shard", type=read_shard, help="k/N: into the folder run-k")
    parser.add_argument("--workers", type=positive, default=2)
    parser.add_argument("--ray", help="'local' or the address of a cluster")
    parser.add_argument("--tables", action="store_true", help="make the tables at the end, too")
    chosen = parser.parse_args()
    meshes = chosen.folder / "meshes"
    write_dataset(meshes, chosen.objects)
    manifest = read_manifest(chosen.sample)
    options = Options(
        suite=manifest["suite"],
        dataset=f"folder:{meshes}",
        methods=chosen.methods or tuple(manifest["methods"]),
        conditions=chosen.conditions or tuple(manifest["conditions"]),
        views=manifest["views"],
        workers=chosen.workers if chosen.ray in (None, LOCAL) else None,
        ray=chosen.ray,
        device="cpu",
        shard=chosen.shard,
        out=chosen.folder / (f"run-{chosen.shard.number}" if chosen.shard else "run"),
    )
    print(json.dumps(measure(chosen.sample.absolute(), options, chosen.tables), indent=1))


if __name__ == "__main__":
    main()
