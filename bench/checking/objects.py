"""Golden values by object, with which any complete part of a run is compared.

They lie beside the golden means of a suite:

    SUITE-objects.csv  for each method, condition and object the means of the image metrics over its
                       views, and the checksum of its images
    SUITE-objects.png  the first view of each line, as a thumbnail, in the order of the lines;
                       for people, as checksums compare the images themselves
    SUITE-objects.json protocol and environment of the run that they are of, and the checksums of
                       the other two

A method that sees no cloud has one line for all conditions. A field is empty where there is no
value, and no image.

A file of a user's own (`write_file`) is one JSON of the same, without thumbnails, for any run.
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

from bench.analysis.scored_run import Run, in_order
from bench.catalogue.methods import known_method
from bench.checking.tolerances import OBJECT_RENDERING, PRINTED, mean_tolerance, object_tolerance
from bench.records.frames import Artifact, stored_artifacts
from bench.records.job import JobName
from bench.running.environment import environment_of, is_same, told_mixture
from bench.tables.published import golden_name, golden_path
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.failures import BadInput
from data_prep.files.atomic_write import write_whole
from data_prep.files.safe_read import read_text
from data_prep.scene import IMAGE_SIZE, UInt8Images

KEY = ["method", "condition", "class", "object"]
IMAGES = "images"
_ANY = "any"  # condition of methods that see no cloud
_WORST = 3  # objects named for each regression
SIDE = 64  # pixels of a thumbnail: half an image
ACROSS = 24  # thumbnails in a row of the sheet
_NO_IMAGE = np.full((SIDE, SIDE, 3), 255, np.uint8)
_COLOURS = 256  # of the whole sheet: a third of the bytes that all colours take
_FORMAT = "golden values of pc2pix-bench, 1"
_MOST_BYTES = 2**28


def _object_values(run: Run) -> pd.DataFrame:
    """Return each object's mean of each image metric over the views that have a value.

    The index is method, condition, class and object, in the order of the run; the columns are the
    metrics. NaN where no view has a value.
    """
    metrics = [*run.suite.image_metrics, *run.suite.detail_metrics]
    frames = []
    for cell in run.image_sets:
        _, planned = run.numbers(cell)
        values = {metric: run.per_object(cell, metric) for metric in metrics}
        keys = dict(zip(KEY, (*cell, run.objects(cell)), strict=True))
        frames.append(pd.DataFrame(keys | values)[planned > 0])
    return in_order(pd.concat(frames), run.manifest, KEY).set_index(KEY)


def stored_images(stored: Mapping[JobName, Artifact], job: JobName) -> NDArray[np.uint8] | None:
    """Return all views of a job [V, H, W, 3]; None without images, or where they are unreadable."""
    return stored[job].read_images() if job in stored else None


def checksum(images: NDArray[np.uint8] | None) -> str:
    """Return the first 16 digits of the sha256 of the pixels of all views; empty without views."""
    return "" if images is None else sha256(images.tobytes()).hexdigest()[:16]


@dataclass(frozen=True, eq=False)
class GoldenObjects:
    """The golden values of a suite by object.

    protocol     its version, dataset, objects, views and seed of their run
    environment  of their run, see `environment_of`
    lines        as in the file; the columns KEY and IMAGES are text
    """

    protocol: dict[str, Any]
    environment: dict[str, str]
    lines: pd.DataFrame

    @property
    def names(self) -> dict[str, set[str]]:
        """Return the names of methods, conditions and objects, as in manifests.

        Conditions are those of methods that see a cloud.
        """
        return {
            "methods": set(self.lines["method"]),
            "conditions": set(self.lines["condition"]) - {_ANY},
            "objects": set(self.lines["class"] + "/" + self.lines["object"]),
        }

    def part(self, manifest: Mapping[str, Any]) -> pd.DataFrame:
        """Return the lines that a run should have, with its conditions in place of ANY.

        The index is KEY; the column `line` is the number of the line in the file.
        """
        every = self.lines.assign(line=range(len(self.lines)))
        blind = every["condition"] == _ANY
        spread = [every[blind].assign(condition=condition) for condition in manifest["conditions"]]
        named = pd.concat([every[~blind], *spread])
        in_run = (
            named["method"].isin(manifest["methods"])
            & named["condition"].isin(manifest["conditions"])
            & (named["class"] + "/" + named["object"]).isin(manifest["objects"])
        )
        return in_order(named[in_run], manifest, KEY).set_index(KEY)


def _paths(name: str) -> tuple[Path, Path, Path]:
    means = golden_path(name)
    table, png, about = (
        means.with_name(f"{name}-objects{suffix}") for suffix in (".csv", ".png", ".json")
    )
    return table, png, about


def read_objects(name: str) -> GoldenObjects | None:
    """Return the golden values of this name by object; None where there are none.

    Raises BadInput where a file is missing, or was not written with the others.
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
    """Return lines of golden values. Raises ValueError where they are not those of a whole run."""
    text = dict.fromkeys([*KEY, IMAGES], str)
    lines = pd.read_csv(io.StringIO(table), dtype=text, keep_default_na=False, na_values=[""])
    metrics = [*lines.columns[len(KEY) : -1]]
    # Of lines with more fields than names, pandas makes the first ones the index; fewer it fills.
    fields = {len(row) for row in csv.reader(io.StringIO(table), strict=True) if row}
    is_table = isinstance(lines.index, pd.RangeIndex) and len(fields) == 1
    if not is_table or not metrics or [*lines.columns] != [*KEY, *metrics, IMAGES]:
        raise ValueError("other columns")
    lines = lines.astype(dict.fromkeys(metrics, float)).fillna({IMAGES: ""})
    if lines[KEY].isna().any(axis=None) or np.isinf(lines[metrics]).any(axis=None):
        raise ValueError("a line without a name, or with an infinite value")
    _refuse_incomplete(lines)
    return lines


def _refuse_incomplete(lines: pd.DataFrame) -> None:
    """Raise ValueError where a method has not one line for each condition and object.

    A finished run has all of them. A method that sees no cloud has ANY as its only condition.
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
    """Write the values of a run into a file of golden values, whole or not at all.

    Raises BadInput where its images are gone, CannotWrite where the file cannot be written.
    """
    table, _ = _object_lines(run)
    fields = {"format": _FORMAT, "protocol": dict(protocol)}
    lines = table.removesuffix("\n").split("\n")  # names may have other separators of lines
    fields |= {"environment": environment_of(run.manifest), "lines": lines}
    fields["sha256"] = sha256(_packed(fields)).hexdigest()
    write_whole(path, (json.dumps(fields, indent=1, ensure_ascii=False) + "\n").encode())


def read_golden_file(path: Path) -> GoldenObjects:
    """Return what `write_file` has written. Raises BadInput for any other file.

    Another file is one of another version of the protocol, too, and one with other columns.
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
    """Return the thumbnails [lines, SIDE, SIDE, 3], in the order of the golden values by object.

    Raises BadInput for a file that is not readable.
    """
    _, png, _ = _paths(name)
    return read_png(png)


def _object_lines(run: Run) -> tuple[str, list[NDArray[np.uint8]]]:
    """Return the lines of a run's objects as CSV, and a thumbnail for each.

    Raises BadInput where its images are gone.
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
        lines.append(row | {IMAGES: checksum(images)})
        thumbnails.append(_NO_IMAGE if images is None else thumbnail(images[0]))
    table = pd.DataFrame(lines).to_csv(index=False, lineterminator="\n", float_format="%.6f")
    return table, thumbnails


def write_objects(run: Run, protocol: Mapping[str, Any]) -> list[Path]:
    """Make the values and images of a run the golden ones of its suite, and return the files.

    Raises BadInput where its images are gone.
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
    """A value of an object that is not within its tolerance; NaN means no value.

    line  of the golden file
    """

    item: JobName
    metric: str
    actual: float
    golden: float
    allowed: float
    line: int

    @property
    def excess(self) -> float:
        """Return the move as a multiple of the allowed one; infinite where a value is missing."""
        by = abs(self.actual - self.golden) / self.allowed
        return by if math.isfinite(by) else math.inf


@dataclass(frozen=True)
class GoldenCell:
    """The golden values of a metric of a method at a condition, as they were compared.

    compared  number of values
    problem   what is wrong, "" where all agree

    The metric IMAGES is no value: it stands for the images of the objects whose values agree.
    """

    method: str
    condition: str
    metric: str
    compared: int
    problem: str = ""

    def __str__(self) -> str:
        return f"{self.metric} of {self.method} at {self.condition}: {self.problem}"


@dataclass(frozen=True)
class Widths:
    """The widths within which values of objects may move: by default `object_tolerance`.

    by_metric  others, of a user
    strict     in another environment as in the same one
    """

    by_metric: Mapping[str, float] = field(default_factory=dict)
    strict: bool = False

    def of(self, method: str, metric: str, same: bool) -> float:
        """Return how far a value may move, in the `same` environment as the golden ones or not."""
        wide = self.by_metric.get(metric, object_tolerance(method, metric, same or self.strict))
        return max(wide, PRINTED)

    def of_mean(self, method: str, metric: str, objects: int, same: bool) -> float:
        """Return how far the mean of so many values may move: no farther than each of them."""
        each = self.of(method, metric, same)
        if metric in self.by_metric:
            return each
        return max(min(each, mean_tolerance(method, metric, objects)), PRINTED)

    def in_words(self, methods: Sequence[str], metrics: Sequence[str]) -> str:
        """Return the tolerances of another environment."""
        methods_by_text: dict[str, list[str]] = {}
        for method in methods:
            text = ", ".join(f"{m} {self.of(method, m, False):g}" for m in metrics)
            methods_by_text.setdefault(text, []).append(method)
        return "; ".join(f"{text} of {', '.join(ms)}" for text, ms in methods_by_text.items())


def compare_objects(
    run: Run, golden: GoldenObjects, widths: Widths, *, means: bool
) -> tuple[tuple[GoldenCell, ...], tuple[GoldenDeviation, ...], tuple[str, ...]]:
    """Compare the values of a run, or of a part of one, with the golden ones, and their `means`.

    Returns each metric of a method at a condition, with a problem that names the largest moves, and
    its images where they have to be equal, too; every value that moved; and remarks: whether the
    golden values come from the same environment, and how many of them the run does not have.
    """
    expected = golden.part(run.manifest)
    metrics = [name for name in golden.lines.columns if name not in (*KEY, IMAGES)]
    actual = _object_values(run).reindex(index=expected.index, columns=metrics)
    here = environment_of(run.manifest)
    same = is_same(here, golden.environment)
    stored = stored_artifacts(run.directory)
    cells: list[GoldenCell] = []
    moved: list[GoldenDeviation] = []
    redrawn: list[str] = []
    for cell, wanted in expected.groupby(KEY[:2], sort=False):
        method, condition = map(str, cell)
        measured = actual.loc[wanted.index]
        for metric in metrics:
            allowed = widths.of(method, metric, same)
            values = zip(
                wanted.index, measured[metric], wanted[metric], wanted["line"], strict=True
            )
            beyond = [
                GoldenDeviation(JobName(*key), metric, now, was, allowed, line)
                for key, now, was, line in values
                if not (abs(now - was) <= allowed or (math.isnan(now) and math.isnan(was)))
            ]
            beyond.sort(key=lambda deviation: -deviation.excess)
            moves, problem = (measured[metric] - wanted[metric]).dropna(), ""
            most = widths.of_mean(method, metric, len(moves), same)
            if beyond:
                problem = (
                    f"{len(beyond)} of {len(wanted)} objects moved by more than {allowed:.6f}: "
                    f"{_worst(beyond, stored, wanted[IMAGES])}"
                )
            elif means and abs(moves.mean()) > most:
                problem = (
                    f"the mean of {len(moves)} objects moved by {moves.mean():+.6f}, more than "
                    f"{most:.6f}, though none of them by more than {allowed:.6f}"
                )
            cells.append(GoldenCell(method, condition, metric, len(wanted), problem))
            moved += beyond
        if same or widths.strict:
            alike = wanted.index.difference([deviation.item for deviation in moved], sort=False)
            other = _other_images(stored, wanted[IMAGES][alike])
            problem = (
                f"{len(other)} of {len(wanted)} objects have other images than the golden ones, "
                f"though their values agree: {_named(other)}"
            )
            if other and widths.by_metric:
                redrawn.append(f"images of {method} at {condition}: {problem}")
            problem = problem if other and not widths.by_metric else ""
            cells.append(GoldenCell(method, condition, IMAGES, 0, problem))
    headline = [metric for metric in run.suite.headline if metric in metrics]
    wide = widths.in_words(list(dict.fromkeys(expected.reset_index()["method"])), headline)
    but = f"; but {', '.join(widths.by_metric)} as --tolerance says" * bool(widths.by_metric)
    remark = _remark(here, golden.environment, wide, widths.strict) + but
    if mixture := told_mixture(run.manifest):
        remark = f"{remark}; {mixture}"
    used, lines = expected["line"].nunique(), len(golden.lines)
    fewer = f"{used} of {lines} lines of the golden values are compared: this run has no others"
    return tuple(cells), tuple(moved), (*redrawn, *([fewer] if used < lines else []), remark)


def _other_images(stored: Mapping[JobName, Artifact], checksums: pd.Series) -> list[JobName]:
    """Return the jobs whose images have not these checksums, which the index names."""
    keys: Any = checksums.index
    named = ((JobName(*key), was) for key, was in zip(keys, checksums, strict=True))
    return [job for job, was in named if checksum(stored_images(stored, job)) != was]


def _named(jobs: Sequence[JobName]) -> str:
    """Return the objects of the first jobs."""
    named = ["/".join(job.object) for job in jobs[:_WORST]]
    if len(jobs) > _WORST:
        named.append("...")
    return "; ".join(named)


def _worst(
    beyond: Sequence[GoldenDeviation], stored: Mapping[JobName, Artifact], checksums: pd.Series
) -> str:
    """Return the largest moves in words, and whether the images are the golden ones."""
    worst = []
    for deviation in beyond[:_WORST]:
        now = checksum(stored_images(stored, deviation.item))
        same_images = now != "" and now == checksums[deviation.item]
        worst.append(
            f"{'/'.join(deviation.item.object)} {number(deviation.actual)}, golden "
            f"{number(deviation.golden)}" + " (same images)" * same_images
        )
    return "; ".join(worst) + "; ..." * (len(beyond) > _WORST)


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
    """Return a value in digits for people, "nothing" where it is not finite."""
    return f"{value:.6f}" if math.isfinite(value) else "nothing"


def thumbnail(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image [IMAGE_SIZE, IMAGE_SIZE, 3] as [SIDE, SIDE, 3].

    Pixels are means of blocks, rounded half up.
    """
    block = IMAGE_SIZE // SIDE
    blocks = image.reshape(SIDE, block, SIDE, block, 3).astype(np.float64)
    return np.floor(blocks.mean(axis=(1, 3)) + 0.5).astype(np.uint8)


def to_png(thumbnails: Sequence[NDArray[np.uint8]]) -> bytes:
    """Return a sheet of thumbnails in their order, ACROSS in a row; the last row ends in white."""
    from PIL import Image

    rows = -(-len(thumbnails) // ACROSS)
    tiles = np.full((rows * ACROSS, SIDE, SIDE, 3), 255, np.uint8)
    tiles[: len(thumbnails)] = thumbnails
    grid = tiles.reshape(rows, ACROSS, SIDE, SIDE, 3).swapaxes(1, 2)
    sheet = Image.fromarray(grid.reshape(rows * SIDE, ACROSS * SIDE, 3))
    buffer = io.BytesIO()
    sheet.quantize(_COLOURS).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def read_png(path: Path) -> UInt8Images:
    """Return the thumbnails [N, SIDE, SIDE, 3] of a sheet, up to the end of its last row.

    Raises BadInput for a file that is no sheet.
    """
    from PIL import Image

    try:
        with Image.open(path, formats=("PNG",)) as image:
            sheet = np.asarray(image.convert("RGB"))
    except OSError as error:
        raise BadInput(f"{path}: not a readable PNG ({error}); restore it with git") from error
    rows, width = len(sheet) // SIDE, ACROSS * SIDE
    if sheet.shape != (rows * SIDE, width, 3):
        raise BadInput(
            f"{path}: no sheet of thumbnails, which is {width} pixels wide; restore it with git"
        )
    return sheet.reshape(rows, SIDE, ACROSS, SIDE, 3).swapaxes(1, 2).reshape(-1, SIDE, SIDE, 3)
