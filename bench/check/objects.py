"""Golden values of single objects, with which a run of some of the objects can be compared, too.

They stand in three files beside the golden means of a suite:

    SUITE-objects.csv   a line for each method, condition and object: the mean of each image metric
                        over the views, and a checksum of the images
    SUITE-objects.png   a sheet with a thumbnail for each line, in their order: the first view. It
                        is there for people to look at; images are compared by the checksums
    SUITE-objects.json  the protocol and the environment of the run that these values are from, and
                        the checksums of the other two files

A method that does not see the cloud draws the same images at every condition, and has one line for
all conditions. A field of a line is empty where the run has no value, and where it has no images.

A user can keep golden values of any run in a file of their own (`write_file`): one JSON file with
the same contents except the thumbnails.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.analysis.run import Run, in_order
from bench.catalogue.methods import known_method
from bench.catalogue.metrics import higher_is_better
from bench.check.golden_values import golden_name, golden_path
from bench.check.thumbnails import SIDE, read_png, thumbnail, to_png
from bench.check.tolerances import OBJECT_RENDERING, PRINTED, mean_tolerance, object_tolerance
from bench.records.frames import Artifact, stored_artifacts
from bench.records.job import JobName
from bench.running.environment import environment_of, is_same, told_mixture
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import read_text
from data_prep.scene import UInt8Images

KEY = ["method", "condition", "class", "object"]  # the columns that identify a line
# The column with the checksum of the images of a line. A comparison of these checksums has this
# name in place of a metric.
IMAGE_CHECKSUM = "images"
_ANY = "any"  # stands in the column "condition" for a method that does not see the cloud
_WORST = 3  # the number of objects that the line about a regression names
_NO_IMAGE = np.full((SIDE, SIDE, 3), 255, np.uint8)  # the thumbnail of a line without images
_FORMAT = "golden values of pc2pix-bench, 1"  # the entry "format" of a user's file
_MOST_BYTES = 2**28  # the largest user's file that is read


def _object_values(run: Run) -> pd.DataFrame:
    """Return each object's mean of each image metric over the views that have a value.

    The index is method, condition, class and object, in the order of the run; the columns are the
    metrics. NaN where no view has a value.
    """
    metrics = [*run.suite.image_metrics, *run.suite.detail_metrics]
    frames = []
    for group in run.image_sets:
        method, condition, class_name = group
        columns: dict[str, Any] = {
            "method": method,
            "condition": condition,
            "class": class_name,
            "object": run.objects(group),
        }
        for metric in metrics:
            columns[metric] = run.per_object(group, metric)
        _, planned_images = run.numbers(group)
        frames.append(pd.DataFrame(columns)[planned_images > 0])
    return in_order(pd.concat(frames), run.manifest, KEY).set_index(KEY)


def stored_images(stored: Mapping[JobName, Artifact], job: JobName) -> NDArray[np.uint8] | None:
    """Return the images of a job, uint8 [V, H, W, 3]; None without any or if unreadable."""
    return stored[job].read_images() if job in stored else None


def checksum(images: NDArray[np.uint8] | None) -> str:
    """Return the first 16 digits of the SHA-256 of the pixels of images; "" without images."""
    return "" if images is None else sha256(images.tobytes()).hexdigest()[:16]


@dataclass(frozen=True, eq=False)
class GoldenObjects:
    """Golden values of single objects.

    protocol     the protocol of the run that they are from: its version, dataset, number of
                 objects, views and seed
    environment  the environment of that run, as `environment_of` returns it
    lines        the lines of the file. The columns KEY and IMAGE_CHECKSUM are text, the others are
                 metrics
    """

    protocol: dict[str, Any]
    environment: dict[str, str]
    lines: pd.DataFrame

    @property
    def names(self) -> dict[str, set[str]]:
        """Return the names that have golden values, by the entry of manifests that lists them.

        The entries are "methods", "conditions" and "objects".
        """
        return {
            "methods": set(self.lines["method"]),
            "conditions": set(self.lines["condition"]) - {_ANY},
            "objects": set(self.lines["class"] + "/" + self.lines["object"]),
        }

    def part(self, manifest: Mapping[str, Any]) -> pd.DataFrame:
        """Return the lines for the methods, conditions and objects of a run.

        A line for all conditions is repeated for each condition of the run. The index is KEY; the
        column `line` has the number of the line in the file.
        """
        every = self.lines.assign(line=range(len(self.lines)))
        for_all_conditions = every["condition"] == _ANY
        parts = [every[~for_all_conditions]]
        for condition in manifest["conditions"]:
            parts.append(every[for_all_conditions].assign(condition=condition))
        lines = pd.concat(parts)
        in_run = (
            lines["method"].isin(manifest["methods"])
            & lines["condition"].isin(manifest["conditions"])
            & (lines["class"] + "/" + lines["object"]).isin(manifest["objects"])
        )
        return in_order(lines[in_run], manifest, KEY).set_index(KEY)


def _paths(name: str) -> tuple[Path, Path, Path]:
    """Return the paths of the CSV, PNG and JSON file of golden values of this name."""
    means = golden_path(name)
    table, png, about = (
        means.with_name(f"{name}-objects{suffix}") for suffix in (".csv", ".png", ".json")
    )
    return table, png, about


def read_objects(name: str) -> GoldenObjects | None:
    """Return the golden values of single objects of this name; None where there are none.

    Raises BadInput where one of the files is missing, or was not written together with the others.
    """
    table, png, about = _paths(name)
    if not any(path.is_file() for path in (table, png, about)):
        return None
    remedy = (
        "restore it with git, or write all of them with 'bench check DIR --bless results/golden'"
    )
    try:
        fields = json.loads(about.read_text(encoding="utf-8"))
        protocol, environment, sums = (fields[n] for n in ("protocol", "environment", "sha256"))
        for path in (table, png):
            if sha256(path.read_bytes()).hexdigest() != sums[path.name]:
                raise BadInput(f"{path}: damaged, or of another run than {about.name}; {remedy}")
        lines = _read_lines(table.read_text(encoding="utf-8"))
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        if isinstance(error, BadInput):
            raise
        path = about if not isinstance(error, OSError) else Path(error.filename)
        raise BadInput(f"{path}: golden values by object are damaged; {remedy}") from error
    return GoldenObjects(protocol, environment, lines)


def _read_lines(table: str) -> pd.DataFrame:
    """Return the lines of a CSV of golden values.

    Raises ValueError where the text is no such CSV, and where lines of the run are missing.
    """
    text = dict.fromkeys([*KEY, IMAGE_CHECKSUM], str)
    lines = pd.read_csv(io.StringIO(table), dtype=text, keep_default_na=False, na_values=[""])
    metrics = [*lines.columns[len(KEY) : -1]]
    # Where a line has more fields than there are columns, pandas makes its first fields the index;
    # where it has fewer, pandas fills it up. Both are refused here.
    fields = {len(row) for row in csv.reader(io.StringIO(table), strict=True) if row}
    is_table = isinstance(lines.index, pd.RangeIndex) and len(fields) == 1
    if not is_table or not metrics or [*lines.columns] != [*KEY, *metrics, IMAGE_CHECKSUM]:
        raise ValueError("other columns")
    lines = lines.astype(dict.fromkeys(metrics, float)).fillna({IMAGE_CHECKSUM: ""})
    if lines[KEY].isna().any(axis=None) or np.isinf(lines[metrics]).any(axis=None):
        raise ValueError("a line without a name, or with an infinite value")
    _refuse_incomplete(lines)
    return lines


def _refuse_incomplete(lines: pd.DataFrame) -> None:
    """Raise ValueError where a method does not have one line for each condition and object.

    The lines of a finished run are complete. A method that does not see the cloud has the single
    condition _ANY.
    """
    if (twice := lines.duplicated(KEY)).any():
        raise ValueError(f"two lines of {' '.join(lines.loc[twice, KEY].iloc[0])}")
    named = {*lines["condition"]} - {_ANY}
    objects = len(lines[KEY[2:]].drop_duplicates())
    for method, of_method in lines.groupby("method", sort=False):
        conditions = {*of_method["condition"]}
        if conditions not in ({_ANY}, named):
            raise ValueError(f"{method} at the conditions {', '.join(sorted(conditions))}")
        if len(of_method) != (whole := objects * len(conditions)):
            raise ValueError(f"{len(of_method)} lines of {method}, a whole run has {whole}")


def write_file(run: Run, protocol: Mapping[str, Any], path: Path) -> None:
    """Write the values of a run into a user's file of golden values, whole or not at all.

    Raises BadInput where the run no longer has its images, and CannotWrite where the file cannot be
    written.
    """
    table, _ = _object_lines(run)
    fields = {"format": _FORMAT, "protocol": dict(protocol)}
    # Not `splitlines`, for a name may contain other characters that separate lines.
    lines = table.removesuffix("\n").split("\n")
    fields |= {"environment": environment_of(run.manifest), "lines": lines}
    fields["sha256"] = sha256(_packed(fields)).hexdigest()
    write_whole(path, (json.dumps(fields, indent=1, ensure_ascii=False) + "\n").encode())


def read_golden_file(path: Path) -> GoldenObjects:
    """Return the golden values that `write_file` has written.

    Raises BadInput for any other file, for one of another version of the protocol, and for one with
    metrics that are unknown here.
    """
    again = f"write it again with 'bench check DIR --bless {path}'"
    text = read_text(path, _MOST_BYTES)
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict) or fields.get("format") != _FORMAT:
        raise BadInput(
            f"{path}: no file of golden values of this version; 'bench check DIR --bless {path}' "
            "writes one"
        )
    told = fields.pop("sha256", None)
    if told != sha256(_packed(fields)).hexdigest():
        raise BadInput(f"{path}: damaged or altered since it was written; restore it, or {again}")
    try:
        protocol, environment = dict(fields["protocol"]), dict(fields["environment"])
        refuse_other_version(path, protocol.get("protocol"), again)
        if broken := [line for line in fields["lines"] if "\n" in line]:
            raise ValueError(f"a line break in {broken[0].splitlines()[0]!r}")
        lines = _read_lines("\n".join(fields["lines"]))
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        if isinstance(error, BadInput):
            raise
        reason = str(error).splitlines()[0]
        raise BadInput(f"{path}: no golden values by object ({reason}); {again}") from None
    metrics = lines.columns[len(KEY) : -1]
    if unknown := [name for name in metrics if name not in OBJECT_RENDERING]:
        raise BadInput(f"{path}: {unknown[0]} is no metric of images of this version; {again}")
    return GoldenObjects(protocol, environment, lines)


def _packed(fields: Mapping[str, Any]) -> bytes:
    return json.dumps(fields, sort_keys=True).encode()


def golden_thumbnails(name: str) -> UInt8Images:
    """Return the thumbnails [lines, SIDE, SIDE, 3] of the golden values of this name, in order.

    Raises BadInput for a sheet that is not readable.
    """
    _, png, _ = _paths(name)
    return read_png(png)


def _object_lines(run: Run) -> tuple[str, list[NDArray[np.uint8]]]:
    """Return the lines of golden values of a run as CSV, and a thumbnail for each line.

    Raises BadInput where the run no longer has its images.
    """
    stored = stored_artifacts(run.directory)
    first = run.manifest["conditions"][0]
    known = {method: known_method(method) for method in run.manifest["methods"]}
    sees_cloud = {name: method is None or method.sees_cloud for name, method in known.items()}
    values = _object_values(run).reset_index()
    lines, thumbnails = [], []
    for row in values.to_dict("records"):
        item = JobName(*(row[name] for name in KEY))
        if not sees_cloud[item.method]:
            if item.condition != first:
                continue
            row["condition"] = _ANY
        images = stored_images(stored, item)
        if images is None and item in stored:
            raise BadInput(
                f"{run.directory}: images of {item.method} at {item.condition} of "
                f"{'/'.join(item.object)} cannot be read; start the run again with its command"
            )
        lines.append(row | {IMAGE_CHECKSUM: checksum(images)})
        thumbnails.append(_NO_IMAGE if images is None else thumbnail(images[0]))
    table = pd.DataFrame(lines).to_csv(index=False, lineterminator="\n", float_format="%.6f")
    return table, thumbnails


def write_objects(run: Run, protocol: Mapping[str, Any]) -> list[Path]:
    """Write the files of golden values of a run's suite from this run, and return their paths.

    Raises BadInput where the run no longer has its images.
    """
    lines, thumbnails = _object_lines(run)
    table, png, about = _paths(golden_name(run.manifest))
    contents = {table: lines.encode(), png: to_png(thumbnails)}
    fields = {
        "protocol": dict(protocol),
        "environment": environment_of(run.manifest),
        "sha256": {path.name: sha256(data).hexdigest() for path, data in contents.items()},
    }
    contents[about] = (json.dumps(fields, indent=2, ensure_ascii=False) + "\n").encode()
    for path, data in contents.items():
        write_whole(path, data)
    return list(contents)


@dataclass(frozen=True, eq=False)
class GoldenDeviation:
    """A value of an object that differs from the golden one by more than its tolerance.

    actual   the value of the run; NaN where it has none
    golden   the golden value; NaN where there is none
    allowed  the tolerance
    line     the number of the line in the file of golden values
    """

    item: JobName
    metric: str
    actual: float
    golden: float
    allowed: float
    line: int

    @property
    def excess(self) -> float:
        """Return the difference in multiples of the tolerance; infinite if a value is missing."""
        multiple = abs(self.actual - self.golden) / self.allowed
        return multiple if math.isfinite(multiple) else math.inf


@dataclass(frozen=True)
class GoldenComparison:
    """The comparison of the golden values of one metric, for a method at a condition.

    Where the metric is IMAGE_CHECKSUM, images were compared, of the objects whose values agree.

    compared  the number of values that were compared
    problem   what differs; "" where all agree
    better    whether what moved is better on the mean than before; None where nobody can tell
    """

    method: str
    condition: str
    metric: str
    compared: int
    problem: str = ""
    better: bool | None = None

    @property
    def verdict(self) -> str:
        """Return "moved (better)", "moved (worse)", or "moved" where nobody can tell."""
        return {True: "moved (better)", False: "moved (worse)", None: "moved"}[self.better]

    def __str__(self) -> str:
        return f"{self.metric} of {self.method} at {self.condition}: {self.problem}"


@dataclass(frozen=True)
class Widths:
    """The tolerances of values of objects. By default they are those of `object_tolerance`.

    by_metric  a user's own tolerances for some metrics
    strict     whether those of the same environment hold in another environment, too
    """

    by_metric: Mapping[str, float] = field(default_factory=dict)
    strict: bool = False

    def of(self, method: str, metric: str, same: bool) -> float:
        """Return the tolerance of a value.

        same  whether the run and the golden values are of the same environment
        """
        wide = self.by_metric.get(metric, object_tolerance(method, metric, same or self.strict))
        return max(wide, PRINTED)

    def of_mean(self, method: str, metric: str, objects: int, same: bool) -> float:
        """Return the tolerance of the mean over so many objects, at most that of one value."""
        each = self.of(method, metric, same)
        if metric in self.by_metric:
            return each
        return max(min(each, mean_tolerance(method, metric, objects)), PRINTED)

    def in_words(self, methods: Sequence[str], metrics: Sequence[str]) -> str:
        """Return the tolerances of another environment in words, for these methods and metrics."""
        methods_by_text: dict[str, list[str]] = {}
        for method in methods:
            tolerances = [f"{metric} {self.of(method, metric, False):g}" for metric in metrics]
            methods_by_text.setdefault(", ".join(tolerances), []).append(method)
        return "; ".join(f"{text} of {', '.join(alike)}" for text, alike in methods_by_text.items())


def compare_objects(
    run: Run, golden: GoldenObjects, widths: Widths, *, means: bool
) -> tuple[tuple[GoldenComparison, ...], tuple[GoldenDeviation, ...], tuple[str, ...]]:
    """Compare the values of objects of a run with golden ones.

    means  whether means over objects are compared, too

    Returns a comparison for each method, condition and metric, with a problem that names the
    largest differences; every value that is beyond its tolerance; and remarks, which say whether
    both environments are the same, and how many golden values the run does not have. Where images
    have to be equal, there are comparisons of them, too.
    """
    expected = golden.part(run.manifest)
    metrics = [name for name in golden.lines.columns if name not in (*KEY, IMAGE_CHECKSUM)]
    actual = _object_values(run).reindex(index=expected.index, columns=metrics)
    here = environment_of(run.manifest)
    same = is_same(here, golden.environment)
    stored = stored_artifacts(run.directory)
    comparisons: list[GoldenComparison] = []
    moved: list[GoldenDeviation] = []
    redrawn: list[str] = []
    for key, wanted in expected.groupby(KEY[:2], sort=False):
        method, condition = map(str, key)
        values = actual.loc[wanted.index]
        for metric in metrics:
            beyond = _deviations(metric, values, wanted, widths.of(method, metric, same))
            if beyond:
                problem = (
                    f"{len(beyond)} of {len(wanted)} objects moved by more than "
                    f"{beyond[0].allowed:.6f}: {_worst(beyond, stored, wanted[IMAGE_CHECKSUM])}"
                )
            elif means:
                moves = (values[metric] - wanted[metric]).dropna()
                problem = _moved_mean(method, metric, moves, widths, same)
            else:
                problem = ""
            better = is_gain(metric, float((values[metric] - wanted[metric]).mean()))
            if values[metric].isna().sum() > wanted[metric].isna().sum():
                better = False  # values are gone
            comparisons.append(
                GoldenComparison(method, condition, metric, len(wanted), problem, better)
            )
            moved += beyond
        if same or widths.strict:
            alike = wanted.index.difference([deviation.item for deviation in moved], sort=False)
            other = _other_images(stored, wanted[IMAGE_CHECKSUM][alike])
            problem = ""
            if other:
                problem = (
                    f"{len(other)} of {len(wanted)} objects have other images than the golden "
                    f"ones, though their values agree: {_named(other)}"
                )
            if other and widths.by_metric:  # a user who sets tolerances expects other images
                redrawn.append(f"images of {method} at {condition}: {problem}")
                problem = ""
            comparisons.append(GoldenComparison(method, condition, IMAGE_CHECKSUM, 0, problem))
    remarks = redrawn
    used, lines = expected["line"].nunique(), len(golden.lines)
    if used < lines:
        remarks.append(
            f"{used} of {lines} lines of the golden values are compared: this run has no others"
        )
    headline = [metric for metric in run.suite.headline if metric in metrics]
    methods = list(dict.fromkeys(expected.reset_index()["method"]))
    wide = widths.in_words(methods, headline)
    remark = _remark(here, golden.environment, wide, widths.strict)
    if widths.by_metric:
        remark += f"; but {', '.join(widths.by_metric)} as --tolerance says"
    if mixture := told_mixture(run.manifest):
        remark += f"; {mixture}"
    remarks.append(remark)
    return tuple(comparisons), tuple(moved), tuple(remarks)


def is_gain(metric: str, change: float) -> bool | None:
    """Return whether a change of a metric's value is for the better; None for one of nothing."""
    if not change or math.isnan(change):
        return None
    return (change > 0) == higher_is_better(metric)


def _deviations(
    metric: str, values: pd.DataFrame, wanted: pd.DataFrame, allowed: float
) -> list[GoldenDeviation]:
    """Return the values of a metric that are beyond a tolerance, the farthest first.

    Both frames have the index KEY and the same lines. A value that only one of them has is beyond
    any tolerance.
    """
    beyond = []
    columns = zip(wanted.index, values[metric], wanted[metric], wanted["line"], strict=True)
    for key, value, golden, line in columns:
        both_missing = math.isnan(value) and math.isnan(golden)
        if both_missing or abs(value - golden) <= allowed:
            continue
        beyond.append(
            GoldenDeviation(
                item=JobName(*key),
                metric=metric,
                actual=value,
                golden=golden,
                allowed=allowed,
                line=line,
            )
        )
    return sorted(beyond, key=lambda deviation: -deviation.excess)


def _moved_mean(method: str, metric: str, moves: pd.Series, widths: Widths, same: bool) -> str:
    """Return in words how far a mean over objects has moved; "" where that is within tolerance.

    moves  the differences of the objects' values from the golden ones
    """
    most = widths.of_mean(method, metric, len(moves), same)
    if not abs(moves.mean()) > most:  # also where there are no values, whose mean is NaN
        return ""
    return (
        f"the mean of {len(moves)} objects moved by {moves.mean():+.6f}, more than {most:.6f}, "
        f"though none of them by more than {widths.of(method, metric, same):.6f}"
    )


def _other_images(stored: Mapping[JobName, Artifact], checksums: pd.Series) -> list[JobName]:
    """Return the jobs whose images do not have the given checksums.

    checksums  the golden checksums, with the index KEY
    """
    keys: Any = checksums.index
    other = []
    for key, golden in zip(keys, checksums, strict=True):
        job = JobName(*key)
        if checksum(stored_images(stored, job)) != golden:
            other.append(job)
    return other


def _named(jobs: Sequence[JobName]) -> str:
    """Return the names of the objects of the first jobs, and "..." where there are more."""
    named = ["/".join(job.object) for job in jobs[:_WORST]]
    if len(jobs) > _WORST:
        named.append("...")
    return "; ".join(named)


def _worst(
    beyond: Sequence[GoldenDeviation], stored: Mapping[JobName, Artifact], checksums: pd.Series
) -> str:
    """Return the first deviations in words, with a mark where the images are the golden ones."""
    worst = []
    for deviation in beyond[:_WORST]:
        obj = "/".join(deviation.item.object)
        text = f"{obj} {number(deviation.actual)}, golden {number(deviation.golden)}"
        now = checksum(stored_images(stored, deviation.item))
        if now != "" and now == checksums[deviation.item]:
            text += " (same images)"
        worst.append(text)
    if len(beyond) > _WORST:
        worst.append("...")
    return "; ".join(worst)


def _remark(here: Mapping[str, str], golden: Mapping[str, str], wide: str, strict: bool) -> str:
    other = [
        f"{name} {here.get(name)} (golden: {golden.get(name)})"
        for name in dict.fromkeys((*here, *golden))
        if here.get(name) != golden.get(name)
    ]
    if other and strict:
        return (
            "another environment than the golden values', compared to the last digit (--strict): "
            f"{', '.join(other)}"
        )
    if other:
        return (
            f"another environment than the golden values': {', '.join(other)}; wider tolerances: "
            f"{wide} (--strict: to the last digit)"
        )
    return (
        "same environment as the golden values: means of objects are compared to the last digit, "
        "images to the last bit"
    )


def number(value: float) -> str:
    """Return a value with six decimals, or "no value" where it is not finite."""
    return f"{value:.6f}" if math.isfinite(value) else "no value"
