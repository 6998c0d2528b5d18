"""Scores of a finished run's images by further metrics, as `bench score` keeps them.

A file `scores/METRIC.parquet` has a value for each existing image, beside the records, which stay
as they are. It names the records that it belongs to by their checksum.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from bench.records.parquet import RECORDS
from bench.records.seal import check_seal, file_with_seal
from data_prep.arrays import Floats
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.files.safe_read import is_hidden

SCORES = "scores"  # folder of a run
IMAGE = ["method", "condition", "class", "object", "view"]  # columns that name an image
_ABOUT = b"pc2pix_bench_metric"


@dataclass(frozen=True)
class ScoredMetric:
    """An image metric that a run was scored by.

    Attributes
    ----------
    id : str
    version : int
    about : str
        One line for people.
    higher_is_better : bool
    decimals : int
        Digits after the point that its values are printed with.
    """

    id: str
    version: int
    about: str
    higher_is_better: bool
    decimals: int


def digits_of(values: Floats) -> int:
    """Return the digits after the point that tell values apart: three of their spread, 0 to 6."""
    spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
    return 3 if spread == 0 else int(np.clip(2 - np.floor(np.log10(spread)), 0, 6))


def write_scores(
    directory: Path, metric: ScoredMetric, records: pd.DataFrame, values: Floats
) -> None:
    """Write the values of existing images, one for each of the records, whole or not at all."""
    (directory / SCORES).mkdir(exist_ok=True)
    about = {**asdict(metric), "records": file_sha256(directory / RECORDS)}
    table = pa.Table.from_pandas(records[IMAGE].assign(value=values), preserve_index=False)
    table = table.replace_schema_metadata({_ABOUT: json.dumps(about).encode()})
    with file_with_seal(scores_file(directory, metric.id)) as new:
        pq.write_table(table, new)


def scores_file(directory: Path, metric_id: str) -> Path:
    """Return the file of a metric's scores."""
    return directory / SCORES / f"{metric_id}.parquet"


def scored_ids(directory: Path) -> list[str]:
    """Return the ids of the metrics that a run has a file of scores of, sorted."""
    files = (directory / SCORES).glob("*.parquet")
    return sorted(path.stem for path in files if not is_hidden(path.name))


def read_scores(directory: Path, metric_id: str) -> tuple[ScoredMetric, pd.DataFrame]:
    """Return a metric and the existing images, with the columns `IMAGE` and `value`.

    Raises BadInput where they are not of the records.
    """
    path = scores_file(directory, metric_id)
    again = f"run 'bench score {directory} --metrics {metric_id}'"
    if not path.is_file():
        raise BadInput(f"{directory}: is not scored by {metric_id}; {again} first")
    try:
        check_seal(path)
        table = pq.read_table(path)
        about = json.loads((table.schema.metadata or {})[_ABOUT])
        records = about.pop("records")
        metric = ScoredMetric(**about)
        images = table.select([*IMAGE, "value"]).to_pandas()
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path}: cannot be read; {again} again") from error
    if records != file_sha256(directory / RECORDS):
        raise BadInput(f"{directory}: was scored by {metric_id} before it was changed; {again}")
    return metric, images
