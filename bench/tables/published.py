"""Values that a run is compared with: the paper's, golden values, the spread between trainings.

A published number is only ever quoted, a golden one only ever compared with. All are kept in
`results/`, which is installed beside the packages.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bench.analysis.paper import Published
from data_prep.failures import BadInput

RESULTS = Path(__file__).resolve().parents[2] / "results"


def published(suite: str) -> Published:
    """Return the paper's values by (class, metric, condition, method); empty without any."""
    if not _published_path(suite).is_file():
        return {}
    rows = published_rows(suite)
    keys = zip(rows["class"], rows["metric"], rows["condition"], rows["method"], strict=True)
    return dict(zip(keys, rows["value"].astype(float), strict=True))


def published_rows(suite: str) -> pd.DataFrame:
    """Return the paper's values as printed, all columns text. Raises BadInput without any."""
    path = _published_path(suite)
    if not path.is_file():
        raise BadInput(f"{path}: no published values; run from a checkout that has them")
    return pd.read_csv(path, dtype=str)


def _published_path(suite: str) -> Path:
    return RESULTS / "paper" / f"{suite}.csv"


def golden_path(suite: str) -> Path:
    """Return the path of a suite's golden values."""
    return RESULTS / "golden" / f"{suite}.csv"


def golden(suite: str) -> pd.DataFrame:
    """Return the golden values of a suite. Raises BadInput without any, and for those of 1.0.0."""
    path = golden_path(suite)
    if not path.is_file():
        raise BadInput(f"{path}: no golden values for '{suite}'; run from a checkout that has them")
    values = pd.read_csv(path, dtype={"condition": str}, keep_default_na=False)
    if "protocol" not in values:
        raise BadInput(
            f"{path}: golden values of version 1.0.0 or earlier; write them with 'bench check DIR "
            "--bless'"
        )
    return values


def seed_spreads() -> dict[tuple[str, str, str], float]:
    """Return the highest less the lowest value of trainings by network, metric and condition.

    The trainings are that of the bundled weights and others that differ in the seed alone, on
    chairs (`studies.seed_spread`); empty without the file.
    """
    path = RESULTS / "seeds.csv"
    if not path.is_file():
        return {}
    rows = pd.read_csv(path, dtype={"condition": str})
    keys = zip(rows["network"], rows["metric"], rows["condition"], strict=True)
    return dict(zip(keys, rows["spread"].astype(float), strict=True))
