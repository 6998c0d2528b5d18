"""Scores of the meshes that the methods of a finished run make of the clouds that it has drawn."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.run import Run, read_run
from bench.analysis.surfaces import rank_rows, surface_rows
from bench.catalogue.methods import find_run_method, is_foreign
from bench.metrics.surface_distance import SURFACE_METRICS, surface_scores
from bench.records.folder import PROTOCOL, locked_run
from bench.records.job import JOB, Job, JobName
from bench.running.plan import plan
from bench.running.pool import TaskPool, WorkerFailure, submit_all
from bench.running.protocol import Protocol
from bench.running.work import cloud_of, load_renderer, reason_of, rng_of, seen_by
from bench.tables.grid import Block, Cell, metric_cell, pivot, row_mappings
from bench.tables.table import TABLES, Table, of_protocol, remove_stale, write_tables
from data_prep.failures import StageFailure
from data_prep.files.safe_read import MIB, read_text
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.scene import Mesh

MESHES = "surface_meshes"  # the table with a row a mesh, which the next call goes on with
_OF_RANKS = "surface_ranks"  # the table that needs three methods
_MOST_BYTES = 512 * MIB  # the largest such table that is read; a row has some 200 bytes
_TEXTS = dict.fromkeys(("key", *JOB, "note"), str)  # its columns that are texts

_SCORES = (
    "Distances are in units of the object's radius. Means over objects, of several classes over "
    "classes, with n_ok/n meshes. `bench list metrics` says what is better."
)
_RANKS = (
    "Spearman's rank correlation, positive where better surfaces have better images. Methods are "
    "ranked by their means, objects within each method: n_ok of n, of which all have a mesh."
)


def measure_surfaces(directory: Path, methods: Sequence[str], workers: int) -> list[Table]:
    """Make the meshes of some methods of a run again, and return the tables of their scores.

    The tables are written, too. Meshes that were measured before are not measured again. Raises
    BadInput where the clouds cannot be made again.
    """
    run = read_run(directory)
    jobs = list(plan(Protocol.from_manifest(run.manifest, methods)).method_jobs)
    with locked_run(directory):
        rows = _kept(directory)
        missing = [job for job in jobs if rows.get(job.name, {}).get("key") != job.key]
        without = len([row for row in rows.values() if row["note"]])  # jobs without a mesh
        pool = TaskPool(_measured, workers, run.suite.limits, group=_foreign_method)
        try:
            with progress("meshes", len(missing)) as advance, closing(pool):
                for job, scores in submit_all(missing, pool):
                    failed = isinstance(scores, WorkerFailure)
                    row = _row(job, {"note": scores.reason} if failed else scores)
                    rows[job.name] = row
                    if row["note"]:
                        without += 1
                    advance(without)
        finally:  # also where it is interrupted
            write_tables(directory, [Table(MESHES, "Meshes", pd.DataFrame(rows.values()))])
        meshes = pd.DataFrame([rows[job.name] for job in jobs])
        tables = _tables(meshes, run)
        write_tables(directory, tables)
        remove_stale(directory, tables, [_OF_RANKS])
    return tables


def _tables(meshes: pd.DataFrame, run: Run) -> list[Table]:
    """Return the table of the scores of meshes, and that of their ranks beside those of images.

    The second one is left out where the methods are too few to be ranked.
    """
    of_scores = partial(_grids, by=["metric"], line="method", remark=_SCORES)
    rows = surface_rows(meshes)
    tables = [Table("surface", "Surfaces against the true meshes", rows, of_scores)]
    ranks = rank_rows(meshes, run.jobs, run.headline)
    if len(ranks):
        by = ["over", "image_metric"]
        of_ranks = partial(_grids, by=by, line="surface_metric", remark=_RANKS)
        tables.append(Table(_OF_RANKS, "Do surfaces predict images?", ranks, of_ranks))
    return [of_protocol(table, run.suite, run.manifest[PROTOCOL]) for table in tables]


def _grids(frame: pd.DataFrame, by: list[str], line: str, remark: str) -> Iterator[Block]:
    """Yield a grid for each value of some columns, conditions across, and why meshes failed."""
    yield remark
    for names, part in frame.groupby(by, sort=False):
        caption = ", ".join(map(str, names))
        yield f"## {caption}"
        failed = row_mappings(part[part["note"] != ""])
        notes = tuple(f"{row[line]} at {row['condition']}: {row['note']}" for row in failed)
        yield pivot(part, line, "condition", _cell, corner=line, caption=caption, notes=notes)


def _cell(row: Any) -> Cell:
    estimate = row["value"], row["ci_low"], row["ci_high"]
    return metric_cell(estimate, row["metric"], count=(row["n_ok"], row["n"]))


def _kept(directory: Path) -> dict[JobName, dict[str, Any]]:
    """Return the rows of meshes that were measured before."""
    empty = dict.fromkeys(SURFACE_METRICS, "")
    path = directory / TABLES / f"{MESHES}.csv"
    try:
        text = io.StringIO(read_text(path, _MOST_BYTES))
        # Only an empty score is no value: an object may have the name NA.
        frame = pd.read_csv(text, dtype=_TEXTS, keep_default_na=False, na_values=empty)
        rows = row_mappings(frame[[*_TEXTS, *SURFACE_METRICS]])
    except (ValueError, KeyError):  # there is none, or another file: all are measured
        return {}
    return {JobName(*(row[name] for name in JOB)): row for row in rows}


def _foreign_method(job: Job) -> str:
    """Return the method of a job if its code is of others, which has workers of its own."""
    return job.method if is_foreign(job.method) else ""


def _row(job: Job, scores: Mapping[str, Any]) -> dict[str, Any]:
    """Return the row of a mesh; scores that it lacks are NaN."""
    names = {"key": job.key, **dict(zip(JOB, job.name, strict=True))}
    return names | dict.fromkeys(SURFACE_METRICS, float("nan")) | {"note": ""} | dict(scores)


def _measured(job: Job) -> dict[str, Any]:
    """Return the scores of the mesh of a job, or a note why it has none. Runs in a worker."""
    address = job.address or job.method
    try:
        true, cloud = job.object.load(), seen_by(find_run_method(address), cloud_of(job))
        state = load_renderer(address, job.device).prepare(cloud, rng_of(job))
        surface = getattr(state, "mesh", None)
        if not isinstance(surface, Mesh):
            raise StageFailure("surface", "the method has made no mesh")
        return surface_scores(true, surface, generator(job.seed, "surface", *job.name.object))
    except BaseException as error:  # not only Exception: a method may call exit()
        return {"note": reason_of(error)}
