"""What a run is compared with: the paper's values, golden values, the spread between trainings.

They are never mixed: a published number is only ever quoted, a golden one only ever compared with.
All live in `results/`, which is installed beside the packages.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bench.analysis.paper import Published
from data_prep.failures import BadInput

RESULTS = Path(__file__).resolve().parents[2] / "results"


def published(suite: str) -> Published:
    """The paper's values by (class, metric, condition, method); empty for a suite without any."""
    if not _published_path(suite).is_file():
        return {}
    rows = published_rows(suite)
    keys = zip(rows["class"], rows["metric"], rows["condition"], rows["method"], strict=True)
    return dict(zip(keys, rows["value"].astype(float), strict=True))


def published_rows(suite: str) -> pd.DataFrame:
    """The paper's values as printed, all columns text. Raises BadInput where there are none."""
    path = _published_path(suite)
    if not path.is_file():
        raise BadInput(f"{path}: no published values; run from a checkout that has them")
    return pd.read_csv(path, dtype=str)


def _published_path(suite: str) -> Path:
    return RESULTS / "paper" / f"{suite}.csv"


def golden_path(suite: str) -> Path:
    """Where a suite's golden values are kept."""
    return RESULTS / "golden" / f"{suite}.csv"


def golden(suite: str) -> pd.DataFrame:
    """The golden values of a suite. Raises BadInput where there are none."""
    path = golden_path(suite)
    if not path.is_file():
        raise BadInput(f"{path}: no golden values for '{suite}'; run from a checkout that has them")
    return pd.read_csv(path, dtype={"condition": str}, keep_default_na=False)


def seed_spreads() -> dict[tuple[str, str, str], float]:
    """By network, metric and condition, the highest less the lowest value of its trainings.

    Of the bundled weights and of others that differ in the seed alone, on chairs
    (`studies.seed_spread`); empty without the file.
    """
    path = RESULTS / "seeds.csv"
    if not path.is_file():
        return {}
    rows = pd.read_csv(path, dtype={"condition": str})
    keys = zip(rows["network"], rows["metric"], rows["condition"], strict=True)
    return dict(zip(keys, rows["spread"].astype(float), strict=True))
