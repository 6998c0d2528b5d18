"""Small values that the tests of the harness are made of, and a finished run of them."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections import Counter
from collections.abc import Iterable
from contextlib import closing, suppress
from dataclasses import asdict, make_dataclass, replace
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from harness_objects import Tetrahedron

from bench import finish
from bench.analysis.run import Run, full_frame, read_run
from bench.analysis.sets import Distance
from bench.analysis.values import EMPTY_VALUES, HIDDEN, VALUE_COLUMNS
from bench.catalogue.conditions import CONDITIONS
from bench.catalogue.methods import FLOORS
from bench.catalogue.metrics import IMAGE_METRICS, column
from bench.catalogue.suites import SUITES, Suite, TableSpec
from bench.commands.terminal import LiveTable, Terminal, watching
from bench.metrics.frechet import (
    JackknifeMoments,
    frechet_distance,
    left_out_distances,
    object_blocks,
)
from bench.metrics.kernel_distance import KernelSet, kernel_distances
from bench.records.folder import open_folder, write_manifest
from bench.records.frames import Artifact, job_frame, read_records, write_records
from bench.records.job import (
    COLUMNS,
    GROUND_TRUTH,
    JOB,
    SCHEMA_VERSION,
    TYPES,
    Job,
    JobName,
    Result,
    pack,
    pack_views,
    unpack,
)
from bench.records.store import STORE
from bench.running.options import Options
from bench.running.protocol import Protocol, find_methods
from bench.running.run import RunResult
from bench.tables.build import Outputs, write_outputs
from bench.tables.grid import row_mappings
from bench.tables.quality import quality_table
from data_prep.clouds.conditions import Unchanged
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.failures import BadInput
from data_prep.scene import View

SUITE = "chair-robustness"
SCORES = tuple(column(metric) for metric in IMAGE_METRICS)
VIEWS = (View(10.0, 5.0), View(-120.0, -30.0))
# Extractors of the suite that need no download.
EXTRACTORS = ("fd-views", "fd-views-grey", "fd-alexnet", "judge")
SKIPPED_FID = "skipped: weights; not here"


def frechet_interval(x, y, objects_x, objects_y) -> tuple[float, float]:
    """Of the distance of features x and y, whose rows show these objects."""
    a, b = JackknifeMoments(x, objects_x), JackknifeMoments(y, objects_y)
    return Distance(frechet_distance(x, y), left_out_distances(a, b)).interval


def left_out_kernel_distances(x, y, groups_x, groups_y):
    """The distance of rows [n] and [m], and those without each object, named by `groups`."""
    names, block = object_blocks(np.concatenate([np.unique(groups_x), np.unique(groups_y)]))
    sets = (
        KernelSet(rows, block[np.searchsorted(names, groups)], int(block.max()) + 1)
        for rows, groups in ((x, groups_x), (y, groups_y))
    )
    return kernel_distances(*sets)


_FIELDS = [("class_name" if name == "class" else name, Any, None) for name in COLUMNS]
Record: Any = make_dataclass("Record", _FIELDS, frozen=True)  # a line of `records.parquet`


def with_scores(result: Result, **scores) -> Result:
    """A result with other scores by column."""
    views = [View(*angles) for angles in views_of(result)]
    before = {name: result.of_views[name] for name in SCORES}
    return replace(result, views=pack_views(views, before | scores))


def make_record(method="splat", condition="2048", obj="a", view=0, **changes) -> Record:
    scores = {"ssim": 0.5, "luminance": 0.9, "contrast": 0.8, "structure": 0.7, "ssim_object": 0.4}
    scores |= {"psnr": 20.0, "silhouette_iou": 0.55, "thin_recall": 0.3, "thin_precision": 0.6}
    scores |= {"lpips": 0.2}
    record = Record(
        suite=SUITE,
        method=method,
        condition=condition,
        class_name="chair",
        object=obj,
        view=view,
        azimuth_deg=VIEWS[view % 2].azimuth_deg,
        elevation_deg=VIEWS[view % 2].elevation_deg,
        outcome="ok",
        reason="",
        notes="",
        prepare_s=0.25,
        draw_s=0.125,
        **scores,
    )
    return replace(record, **changes)


def make_failed(
    method="splat", condition="2048", obj="a", view=0, reason="timeout: 3 s", **changes
):
    nothing = dict.fromkeys((*SCORES, "prepare_s", "draw_s"))
    changes = {"outcome": "failed", "reason": reason} | nothing | changes
    return make_record(method, condition, obj, view, **changes)


def make_job(obj=None, method="splat", condition="2048", **changes) -> Job:
    """A job with a readable key, to be scored against `make_truth` of its object."""
    obj = obj or Tetrahedron()
    name = obj.object_id if obj.class_name == "chair" else f"{obj.object_id} {obj.class_name}"
    key = f"{method} {condition} {name}".replace("/", "-")
    perturbations = {known.id: known.perturbation for known in CONDITIONS}
    job = Job(
        key=key,
        suite=SUITE,
        method=method,
        condition=condition,
        perturbation=perturbations.get(condition, Unchanged()),
        object=obj,
        views=VIEWS,
        seed=0,
        device="cpu",
        features=(),
        reference_key=f"{GROUND_TRUTH}  {name}",
    )
    return replace(job, **changes)


def make_truth(obj=None, **changes) -> Job:
    return make_job(obj, GROUND_TRUTH, "", reference_key=None, **changes)


def make_protocol(**changes) -> Protocol:
    """Two methods under two conditions, without objects and features."""
    changes["methods"] = find_methods(changes.get("methods", ("splat", "blank")))
    protocol = Protocol(
        suite=SUITES[0],
        dataset="procedural",
        methods={},
        conditions=("2048", "512"),
        objects=(),
        views=2,
        seed=0,
        device="cpu",
        features=(),
        feature_identity={},
        environment={},
    )
    return replace(protocol, **changes)


def finished_options(tiny_weights, out, **changes) -> Options:
    """The options of the fixture `finished`, with one worker."""
    methods = ("splat", f"pc2pix@{tiny_weights}", "true-mesh", "blank")
    cells = {"methods": methods, "conditions": ("2048", "noise-0.10")}
    options = Options(SUITE, **cells, limit=3, views=2, workers=1, out=out)
    return replace(options, **changes)


def to_frame(records) -> pd.DataFrame:
    """Records as a sorted table, as `records.parquet` has them."""
    rows = [asdict(record) for record in records]
    frame = pd.DataFrame(rows, columns=list(Record.__dataclass_fields__)).astype(TYPES)
    frame = frame.rename(columns={"class_name": "class"})
    keys = ["suite", "method", "condition", "class", "object", "view"]
    return frame.sort_values(keys, kind="stable", ignore_index=True)


def names_of(records: pd.DataFrame) -> dict[str, list[str]]:
    """Return the names in the manifest of a run with these records, in their order."""
    names = {f"{name}s": records[name].unique().tolist() for name in ("method", "condition")}
    return names | {"objects": (records["class"] + "/" + records["object"]).unique().tolist()}


def scored_records(
    records: pd.DataFrame, suite: Suite = SUITES[0], features=None, skipped=None, **manifest
) -> Run:
    """Return a scored run of these records, with distances by extractor, without a folder."""
    manifest = names_of(records) | manifest
    jobs = job_frame(results_of(records))
    has_image = (records["outcome"] == "ok").groupby([records[name] for name in JOB], sort=False)
    jobs["drawn"] = has_image.sum().to_numpy(np.int64)
    jobs = full_frame(jobs, manifest)
    return Run(Path("run"), suite, manifest, jobs, features or {}, skipped or {})


def value_row(method="splat", value=0.5, condition="2048", metric="ssim", **changes):
    """A row of a quality table, as its columns; skipped and failed as note and numbers say."""
    row = {**EMPTY_VALUES, "suite": "s", "method": method, "condition": condition, "class": "chair"}
    row |= {"metric": metric, "value": value, "failures_as_blank": value, "n_ok": 2, "n": 2}
    row |= {"images_of": method} | changes
    failed = row["n_ok"] + row["undefined"] < row["n"]
    return row | {"skipped": row["note"].startswith("skipped"), "failed": failed}


def value_frame(rows) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=[*VALUE_COLUMNS, *HIDDEN])


def value_table(*rows, spec=None, remark=""):
    """The quality table of such rows."""
    return quality_table(spec or TableSpec("images", "t", "T"), value_frame(rows), remark)


def rows_of(*tables) -> list[Any]:
    """The rows of tables or frames with columns as attributes, `class` as `class_name`."""
    return [
        SimpleNamespace(**row, class_name=row["class"])
        for table in tables
        for row in row_mappings(getattr(table, "frame", table))
    ]


def feature_index(methods, objects_of_class) -> pd.DataFrame:
    """The images of the truth and of methods at 2048, of two views of all objects."""
    cells = [(GROUND_TRUTH, ""), *((method, "2048") for method in methods)]
    rows = [
        (*cell, class_name, obj, view)
        for cell in cells
        for class_name, objects in objects_of_class.items()
        for obj in objects
        for view in (0, 1)
    ]
    return pd.DataFrame(rows, columns=["method", "condition", "class", "object", "view"])


class FeaturesAtHand:
    """`bench.records.frames.Features` without a file: of rows with values [n, d]."""

    def __init__(self, index, values):
        columns = [index[name].tolist() for name in ("method", "condition", "class", "object")]
        self._rows = {}
        for number, (*cell, obj, view) in enumerate(zip(*columns, index["view"], strict=True)):
            self._rows.setdefault(tuple(cell), {})[obj, view] = values[number]

    def images(self, *cell):
        return sorted(self._rows.get(cell, {}))

    def of(self, method, condition, class_name, images):
        rows = self._rows.get((method, condition, class_name), {})
        return np.array([rows[image] for image in images])


def result_of(key, records, **arrays) -> Result:
    """The result of a job with these records, by view."""
    records = sorted(records, key=lambda record: record.view)
    (_,) = {(r.suite, r.outcome, r.reason, r.notes, r.prepare_s, r.draw_s) for r in records}
    first, views = records[0], [View(r.azimuth_deg, r.elevation_deg) for r in records]
    reason, scores = first.reason or "lost" * (first.outcome == "failed"), {}
    if not reason:
        scores = {n: np.array([getattr(r, n) for r in records], float) for n in SCORES}
    return Result(
        *(key, first.suite, reason, first.notes, first.prepare_s, first.draw_s),
        pack_views(views, scores),
        {name: pack(array) for name, array in arrays.items()},
    )


def results_of(records: pd.DataFrame) -> list[tuple[JobName, Result]]:
    """The jobs of a frame of records, each with its name.

    Where some views of a job have failed, which no run gives, they are views without scores.
    """
    by_name = {}
    for record in records_of(records):
        name = JobName(record.method, record.condition, record.class_name, record.object)
        by_name.setdefault(name, []).append(record)
    for of_job in by_name.values():
        drawn = [record for record in of_job if record.outcome == "ok"]
        if drawn:
            alike = {n: getattr(drawn[0], n) for n in ("reason", "notes", "prepare_s", "draw_s")}
            unscored = dict.fromkeys(SCORES)
            for i, record in enumerate(of_job):
                changes = {} if record.outcome == "ok" else {"outcome": "ok", **unscored}
                of_job[i] = replace(record, **alike, **changes)
    return [(name, result_of("/".join(name), of_job)) for name, of_job in by_name.items()]


def write_all(directory, records):
    """Records as those of the complete run in a folder; those of an item are a job.

    Of jobs that were there before images and features stay; true images stay whole.
    """
    by_item = {}
    for record in records:
        item = JobName(record.method, record.condition, record.class_name, record.object)
        by_item.setdefault(item, []).append(record)
    with open_folder(directory) as store:
        before = {row.name: row for row in store.listed()}
        alike = Counter(row.key for row in before.values())
        listed = {name: row.key for name, row in before.items() if name.method == GROUND_TRUTH}
        for item, of_job in by_item.items():
            was = before.get(item)
            listed[item] = was.key if was and alike[was.key] == 1 else "/".join(item)
            result = result_of(listed[item], of_job)
            if was and was.has_images and result.has_images:
                arrays = {}
                for name in ("images", *EXTRACTORS):
                    with suppress(KeyError, BadInput):  # damaged ones are gone
                        arrays[name] = store.array(was.key, name)
                result = replace(result, arrays=arrays)
            store.append(result)
        order = [*before, *(item for item in listed if item not in before)]
        store.list_jobs((listed[name], name) for name in order if name in listed)
        write_records(directory, store)


def overwrite(directory, frame):
    """Put a frame, as `records.parquet` has it, in place of the records of a run."""
    write_all(directory, records_of(frame))


def read_all(directory) -> list[Record]:
    """The records of a run, to be altered and written again by `write_all`."""
    return records_of(read_records(directory))


def records_of(frame) -> list[Record]:
    frame = frame[[*COLUMNS]].rename(columns={"class": "class_name"})
    frame = frame.astype(object).where(frame.notna(), None)
    return [Record(**{str(name): row[name] for name in row}) for row in frame.to_dict("records")]


def watched(reporter=Terminal, *arguments) -> dict[str, Any]:
    """The argument `watch` of a run with a live table, as commands give it."""
    return {"watch": partial(reporter, *arguments, LiveTable().table)}


def run_suite(options: Options) -> RunResult[Outputs]:
    """Run a suite with its tables, figures and report, as `bench run` does."""
    return finish.run_suite(options, watching())


def refusal(function, *arguments):
    """The one line with which it refuses."""
    with pytest.raises(BadInput) as error:
        function(*arguments)
    message = str(error.value)
    assert "\n" not in message
    return message


def file_bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def assert_equal_runs(one: Path, other: Path) -> None:
    """Tables to the byte, and records to the bit but for times."""
    assert file_bytes(one / "tables") == file_bytes(other / "tables")
    left, right = (pd.read_parquet(folder / "records.parquet") for folder in (one, other))
    times = ["prepare_s", "draw_s"]
    pd.testing.assert_frame_equal(left.drop(columns=times), right.drop(columns=times))


def make_result(job: Job, records=(), seed: Any = 0, **arrays) -> Result:
    """The result of a job with random images, and further arrays."""
    rng = np.random.default_rng(seed)
    images = rng.integers(0, 256, (len(job.views), 128, 128, 3), np.uint8)
    arrays = {"images": images} | arrays
    if records:
        return result_of(job.key, records, **arrays)
    packed = {name: pack(array) for name, array in arrays.items()}
    return Result(job.key, job.suite, views=pack_views(job.views), arrays=packed)


def true_images(obj=None, seed=0) -> bytes:
    """Random images as the packed ground truth of an object."""
    return make_result(make_truth(obj), seed=seed).arrays["images"]


def as_failed(result: Result, reason="draw: no images") -> Result:
    """A result as that of a job that gave no images."""
    without = pack_views([View(a, e) for a, e in views_of(result)])
    return replace(result, reason=reason, views=without, arrays={})


def views_of(result: Result) -> list[tuple[float, float]]:
    """The directions of the views of a result."""
    of_views = result.of_views
    angles = (of_views[name].tolist() for name in ("azimuth_deg", "elevation_deg"))
    return list(zip(*angles, strict=True))


def rewrite(directory: Path, key: str, change) -> None:
    """Put what `change` makes of a job's result and arrays in their place, by the store itself."""
    with open_folder(directory) as store:
        arrays = {name: unpack(data) for name, data in store.arrays(key).items()}
        result, arrays = change(store.result(key), arrays)
        packed = {name: pack(array) for name, array in arrays.items()}
        store.append(replace(result, arrays=packed))


def stored_keys(directory: Path) -> set[str]:
    """The keys of the jobs that are finished in a folder, whose run may go on."""
    if not (directory / STORE).exists():
        return set()
    with closing(sqlite3.connect(directory / STORE)) as database, suppress(sqlite3.Error):
        return {key for (key,) in database.execute("SELECT key FROM job")}
    return set()  # its tables are being made


def store_images(directory: Path, job: Job, seed=0, **arrays) -> Artifact:
    """Random images, and further arrays, of a job in the store of a folder."""
    with open_folder(directory) as store:
        store.append(make_result(job, (), seed, **arrays))
    return Artifact(directory, job.key)


def damage_images(directory: Path, keys: Iterable[str] | None = None, data=b"altered") -> None:
    """Alter the images of jobs in the store of a folder, behind its back; of all by default.

    None as `data` removes them.
    """
    with closing(sqlite3.connect(directory / STORE)) as connection, connection:
        if keys is None:
            keys = [key for (key,) in connection.execute("SELECT key FROM job")]
        for key in keys:
            where = "WHERE name = 'images' AND job = (SELECT id FROM job WHERE key = ?)"
            if data is None:
                connection.execute(f"DELETE FROM blob {where}", (key,))
            else:
                connection.execute(f"UPDATE blob SET data = ? {where}", (data, key))


def make_manifest(**changes):
    return {
        "schema_version": SCHEMA_VERSION,
        "protocol": PROTOCOL_VERSION,
        "suite": SUITE,
        "dataset": "procedural",
        "views": 2,
        "seed": 0,
        "device": "cpu",
        "methods": ["splat", "true-mesh", "blank"],
        "conditions": ["2048", "512"],
        "objects": ["chair/a", "chair/b", "chair/c"],
        "skipped_metrics": {"fid": SKIPPED_FID},
        "finished": "2026-01-01T00:00:00+00:00",
        **{name: {} for name in ("environment", "versions", "machine", "identities", "objectives")},
        **{"request": {}, "feature_identity": {}, "command": [], "started": ""},
        "planned": 0,
    } | changes


def write_run(directory: Path, **changes) -> Path:
    """A finished run without tables and without running anything: random scores, images, features.

    Nothing failed. All values depend on the item only, so that a part of a run has the same.
    Features are random too, so that the judge sees any view: its answers are of length 3 + 1.
    """
    made = _stored_run(json.dumps(make_manifest(**changes)))
    return Path(shutil.copytree(made, directory, dirs_exist_ok=True))


def write_run_with_tables(directory: Path, **changes) -> Path:
    """The same, with its tables, which depend on what a test has patched."""
    write_outputs(read_run(write_run(directory, **changes)))
    return directory


@cache
def _runs_to_copy() -> TemporaryDirectory:
    return TemporaryDirectory(prefix="runs-of-tests-")


@cache
def _stored_run(manifest_text: str) -> Path:
    """The folder of the run with this manifest, which is made once in a process, to be copied."""
    directory = Path(mkdtemp(dir=_runs_to_copy().name))
    manifest = json.loads(manifest_text)
    write_manifest(directory, manifest)
    results, jobs = [], []
    for name in manifest["objects"]:
        class_name, _, object_id = name.partition("/")
        obj = Tetrahedron(object_id, class_name)
        truth = np.random.default_rng([*name.encode()]).random((2, 4), np.float32)
        jobs.append(make_truth(obj))
        results.append(make_result(jobs[-1], **dict.fromkeys(EXTRACTORS, truth)))
        for method in manifest["methods"]:
            for condition in manifest["conditions"]:
                ideal = method == "true-mesh"
                seen = "" if ideal or method in FLOORS else condition
                seed = [*f"{method} {seen} {name}".encode()]
                rng = np.random.default_rng(seed)
                job = make_job(obj, method, condition)
                features = truth if ideal else rng.random((2, 4), np.float32)
                of_job = [
                    make_record(
                        method,
                        condition,
                        obj.object_id,
                        view,
                        class_name=class_name,
                        **{score: 1.0 if ideal else rng.random() for score in SCORES},
                    )
                    for view in range(2)
                ]
                results.append(
                    make_result(job, of_job, seed, **dict.fromkeys(EXTRACTORS, features))
                )
                jobs.append(job)
    with open_folder(directory) as store:
        for result in results:
            store.append(result)
        store.list_jobs((job.key, job.name) for job in jobs)
        write_records(directory, store)
    return directory


def drop_features(run: Path, extractor: str) -> None:
    with closing(sqlite3.connect(run / STORE)) as database, database:
        database.execute("DELETE FROM blob WHERE name = ?", [extractor])
