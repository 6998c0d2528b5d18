"""The relations that images of a network should keep when its input changes, and by how much not.

    python -m studies.metamorphic --out DIR [--dataset procedural:validation,folder:PATH]
        [--methods a,b] [--clouds 1000] [--threads 1]

A cloud and a view are changed together so that a renderer without preferences draws the same image,
or its mirror image:

turned           cloud and camera turned about +Y by the same random angle
shuffled         the points in another order
points-twice     every point listed twice: 2,048 points become 4,096
mirrored         the cloud mirrored in x, azimuth to minus azimuth, the image mirrored back
last-bit         each coordinate moved by at most one unit in the last place of a float32
camera-1-degree  no relation, but a yardstick: the camera alone turned by one degree

Clouds are those of the objects of the datasets in turn, as many of each as long as there are
objects, with the conditions `2048`, `noise-0.05` and `512` in turn and one random view each. The
first clouds are always the same, so that methods measured on fewer are measured on the first. Of a
dataset that is not infinite, each object comes once with each condition. Folders of other classes
than the 13 that networks are trained on are left out.

The difference of a pair is the mean absolute difference of its two images over all pixels and
channels, in grey levels 0..255, as images are stored: in whole levels. A cloud that a method fails
on, in either form, has no difference and is counted in n - n_ok.

Written to DIR: `METHOD.csv`, the difference of each cloud, to which a study that is started again
adds only what is missing; and `metamorphic.csv`, the summary of all methods there. `--summary`
writes the summary alone.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cache
from hashlib import sha256
from itertools import chain, islice
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from bench.catalogue.methods import Method, find_method
from bench.catalogue.suites import Limits
from bench.running.isolation import WorkerFailure, run_tasks
from bench.running.work import draw, load_renderer, reason_of
from bench.tables.table import csv_text
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput, MissingDependency
from data_prep.files.atomic_write import write_whole
from data_prep.progress import log, progress
from data_prep.randomness import generator
from data_prep.scene import PointCloud, Renderer, UInt8Images, View
from studies.arguments import names, positive
from studies.relation_clouds import CONDITION_IDS, CloudSpec, choose_clouds, cloud_and_view
from studies.relations import RELATIONS

DATASETS = ("procedural:validation",)
METHODS = ("pc2pix", "splat-net", "splat-net@tiny", "occupancy-net", "fused-net")
LIMITS = Limits(time_s=300.0, memory_gib=4.0)
ALL = "all"
SUMMARY = "metamorphic.csv"


@dataclass(frozen=True)
class Task:
    """A method on a cloud."""

    method: str
    cloud: CloudSpec


@dataclass(frozen=True)
class Difference:
    """The difference of one pair of images.

    inputs      digest of the version of the method and of its weights
    difference  in grey levels; "" where there is none
    reason      of the failure, where there is none
    """

    inputs: str
    relation: str
    dataset: str
    class_name: str
    object_id: str
    condition: str
    azimuth_deg: str = ""
    elevation_deg: str = ""
    difference: str = ""
    reason: str = ""

    @property
    def cloud(self) -> tuple[str, str, str, str]:
        """Return dataset, class, object and condition."""
        return self.dataset, self.class_name, self.object_id, self.condition


@dataclass(frozen=True)
class SummaryRow:
    """The differences of a method under a relation, over the clouds of a dataset and condition.

    identical_percent  of the clouds, whose images do not differ at all
    """

    method: str
    trained_on: str
    relation: str
    dataset: str
    condition: str
    n_ok: int
    n: int
    identical_percent: str
    median: str
    p95: str
    worst: str
    worst_cloud: str


RunTasks = Callable[..., Iterable[tuple[Task, Any]]]  # `bench.running.isolation.run_tasks`


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and write the summary."""
    options = argparse.ArgumentParser(description="What images keep when their input changes.")
    options.add_argument("--out", type=Path, required=True)
    options.add_argument("--dataset", type=names, default=DATASETS, help="comma-separated")
    options.add_argument("--methods", type=names, default=METHODS, help="comma-separated")
    options.add_argument("--clouds", type=positive, default=1000)
    options.add_argument("--threads", type=positive, default=1, help="workers of one thread each")
    options.add_argument("--summary", action="store_true", help="measure nothing")
    given = options.parse_args(arguments)
    try:
        if not given.summary:
            for method in given.methods:
                find_method(method)
            study(given.out, given.dataset, given.methods, given.clouds, given.threads)
        write_summary(given.out)
    except (BadInput, MissingDependency) as error:
        sys.exit(f"metamorphic: {error}")


def study(
    out: Path,
    datasets: Sequence[str],
    methods: Sequence[str],
    clouds: int,
    workers: int,
    run: RunTasks = run_tasks,
) -> None:
    """Measure methods on the first clouds, and add what is missing to the files in `out`.

    Raises BadInput for unusable datasets and weights.
    """
    chosen = list(islice(choose_clouds([open_dataset(spec) for spec in datasets]), clouds))
    if len(chosen) < clouds:
        log(f"metamorphic: {len(chosen)} clouds, the datasets have no more")
    out.mkdir(parents=True, exist_ok=True)
    completed: dict[str, set[tuple[str, str, str, str]]] = {}
    for method in methods:
        complete = read_differences(file_of(out, method), inputs_of(find_method(method)))
        write_whole(file_of(out, method), to_csv(Difference, complete).encode())
        completed[method] = {difference.cloud for difference in complete}
    plan = [
        Task(method, cloud)
        for cloud in chosen  # all methods of a cloud together: it is made once
        for method in methods
        if cloud.key not in completed[method]
    ]
    failed = 0
    with progress("measuring", len(plan)) as advance:
        for task, result in run(plan, measure, workers, LIMITS):
            if isinstance(result, WorkerFailure):
                result = failures(task.cloud, find_method(task.method), result.reason)
            failed += any(difference.reason for difference in result)
            with file_of(out, task.method).open("a", encoding="utf-8", newline="") as file:
                file.write("".join(to_csv(Difference, result).splitlines(keepends=True)[1:]))
            advance(failed)


# --- one cloud ------------------------------------------------------------------------------------


def measure(task: Task) -> list[Difference]:
    """Return the differences of a method on a cloud, one for each relation.

    Raises BadInput for unusable weights.
    """
    return compare(task.cloud, find_method(task.method), load_renderer(task.method, "cpu"))


def compare(spec: CloudSpec, method: Method, renderer: Renderer) -> list[Difference]:
    """Return the differences of a method on a cloud, one for each relation."""

    def image(cloud: PointCloud, view: View) -> UInt8Images:
        # The same random numbers for both images of a pair: a relation is no other draw.
        rng = generator("metamorphic", "method", method.id, *spec.key)
        return draw(method, renderer, cloud, [view], rng).images

    try:
        cloud, view = cloud_and_view(spec)
        original = image(cloud, view)
    except (Exception, SystemExit) as error:  # a method may raise anything
        return failures(spec, method, reason_of(error))
    rows = []
    for relation in RELATIONS:
        rng = generator("metamorphic", relation.id, *spec.key)
        values = {"azimuth_deg": decimal(view.azimuth_deg)}
        values["elevation_deg"] = decimal(view.elevation_deg)
        try:
            changed = relation.restore(image(*relation.apply(cloud, view, rng)))
        except (Exception, SystemExit) as error:
            values["reason"] = reason_of(error)
        else:
            values["difference"] = decimal(mean_difference(original, changed))
        rows.append(Difference(inputs_of(method), relation.id, *spec.key, **values))
    return rows


def mean_difference(a: UInt8Images, b: UInt8Images) -> float:
    """Return the mean absolute difference of images, in grey levels."""
    return float(np.abs(a.astype(np.int16) - b.astype(np.int16)).mean())


def failures(spec: CloudSpec, method: Method, reason: str) -> list[Difference]:
    """Return a line without a difference for each relation."""
    return [
        Difference(inputs_of(method), relation.id, *spec.key, reason=reason)
        for relation in RELATIONS
    ]


@cache
def inputs_of(method: Method) -> str:
    """Return a digest of all that a method's images depend on besides the cloud."""
    return sha256(f"{method.id} {method.version} {method.identity()}".encode()).hexdigest()[:8]


# --- files ----------------------------------------------------------------------------------------


def file_of(out: Path, method: str) -> Path:
    """Return the file of the differences of a method."""
    return out / f"{quote(method, safe='@')}.csv"


def read_differences(path: Path, inputs: str | None = None) -> list[Difference]:
    """Return the differences of all clouds that are complete, of these inputs of the method.

    A cloud may be incomplete where a study was stopped while it wrote.
    """
    if not path.exists():
        return []
    columns = [field.name for field in fields(Difference)]
    by_cloud: dict[tuple[str, str, str, str], dict[str, Difference]] = {}
    for line in csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))):
        if list(line) == columns and None not in line.values():
            difference = Difference(**line)
            if inputs in (None, difference.inputs):
                by_cloud.setdefault(difference.cloud, {})[difference.relation] = difference
    wanted = {relation.id for relation in RELATIONS}
    return [d for of_cloud in by_cloud.values() if of_cloud.keys() == wanted
            for d in of_cloud.values()]  # fmt: skip


def to_csv(kind: type, rows: Iterable[Any]) -> str:
    """Return rows of a dataclass as CSV, with a head."""
    return csv_text([field.name for field in fields(kind)], (asdict(row).values() for row in rows))


def write_summary(out: Path) -> None:
    """Write the summary of all methods with differences in `out`.

    Raises BadInput where there are none.
    """
    files = sorted(path for path in out.glob("*.csv") if path.name != SUMMARY)
    if not files:
        raise BadInput(f"{out}: no differences of a method; measure without --summary first")
    rows = chain.from_iterable(
        summarise(unquote(path.stem), read_differences(path)) for path in files
    )
    write_whole(out / SUMMARY, to_csv(SummaryRow, rows).encode())


def summarise(method: str, differences: Sequence[Difference]) -> Iterator[SummaryRow]:
    """Yield the rows of a method: over all clouds, by dataset, and by condition."""
    trained_on = find_method(method).trained_on or ""
    datasets = dict.fromkeys(difference.dataset for difference in differences)
    groups = [(ALL, ALL), *((d, ALL) for d in datasets), *((ALL, c) for c in CONDITION_IDS)]
    for relation in RELATIONS:
        for dataset, condition in groups:
            chosen = [
                difference
                for difference in differences
                if difference.relation == relation.id
                and dataset in (ALL, difference.dataset)
                and condition in (ALL, difference.condition)
            ]
            if chosen:
                cells = statistics(chosen)
                yield SummaryRow(method, trained_on, relation.id, dataset, condition, **cells)


def statistics(differences: Sequence[Difference]) -> Mapping[str, Any]:
    """Return the counts, percentiles and worst cloud of differences, as in `SummaryRow`.

    A percentile is the least difference that so many percent do not exceed.
    """
    drawn = [difference for difference in differences if not difference.reason]
    values = np.array([float(difference.difference) for difference in drawn])
    cells = {"n_ok": len(drawn), "n": len(differences)}
    if not drawn:
        empty = ("identical_percent", "median", "p95", "worst", "worst_cloud")
        return cells | dict.fromkeys(empty, "")
    median, p95, worst = np.percentile(values, [50, 95, 100], method="inverted_cdf").tolist()
    of_worst = drawn[int(values.argmax())]
    named = f"{of_worst.class_name} {of_worst.object_id} at {of_worst.condition}"
    return cells | {
        "identical_percent": f"{100 * float((values == 0).mean()):.1f}",
        "median": decimal(median),
        "p95": decimal(p95),
        "worst": decimal(worst),
        "worst_cloud": named if worst else "",
    }


def decimal(value: float) -> str:
    """Return a number with three significant digits, or as many as its whole part has."""
    digits = 3 if abs(value) < 1000 else 4
    return np.format_float_positional(value, precision=digits, fractional=False, trim="-")


if __name__ == "__main__":
    main()
