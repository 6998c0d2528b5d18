"""Values that a run is compared with: the paper's, golden values, the spread between trainings.

A published number is only ever quoted, a golden one only ever compared with. All are kept in
`results/`, which is installed beside the packages.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.paper import Published
from bench.records.run_folder import COLOURED, PROTOCOL, TRUTH
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.failures import BadInput

RESULTS = Path(__file__).resolve().parents[2] / "results"


def published(suite: str) -> Published:
    """Return the paper's values by (class, metric, condition, method); empty where it has none."""
    if not _published_path(suite).is_file():
        return {}
    rows = published_rows(suite)
    keys = zip(rows["class"], rows["metric"], rows["condition"], rows["method"], strict=True)
    return dict(zip(keys, rows["value"].astype(float), strict=True))


def published_rows(suite: str) -> pd.DataFrame:
    """Return the paper's values as printed, all columns text.

    Raises BadInput where the suite has no published values.
    """
    path = _published_path(suite)
    if not path.is_file():
        raise BadInput(f"{path}: no published values; run from a checkout that has them")
    return pd.read_csv(path, dtype=str)


def _published_path(suite: str) -> Path:
    return RESULTS / "paper" / f"{suite}.csv"


def golden_name(manifest: Mapping[str, Any]) -> str:
    """Return the name of the golden values of a run: its suite, and "-grey" for truth in grey."""
    truth = manifest.get(TRUTH, COLOURED)
    return str(manifest["suite"]) + (f"-{truth}" if truth != COLOURED else "")


def golden_path(name: str) -> Path:
    """Return the path of golden values."""
    return RESULTS / "golden" / f"{name}.csv"


def golden(name: str) -> pd.DataFrame:
    """Return golden values. Raises BadInput without any, and for those of another protocol."""
    path = golden_path(name)
    if not path.is_file():
        raise BadInput(
            f"{path}: no golden values for '{name}'; 'bench check DIR --again 0.05' compares a run "
            "with itself"
        )
    values = pd.read_csv(path, dtype={"condition": str}, keep_default_na=False)
    version = int(values[PROTOCOL].iloc[0]) if PROTOCOL in values else None
    refuse_other_version(path, version, "write it with 'bench check DIR --bless results/golden'")
    return values


def seed_spreads() -> dict[tuple[str, str, str], float]:
    """Return by network, metric and condition how far the values of several trainings lie apart.

    It is the highest value less the lowest. The trainings are that of the bundled weights and
    others that differ in the seed alone, on chairs (`studies.seed_spread`). Empty where there is no
    file of them.
    """
    path = RESULTS / "seeds.csv"
    if not path.is_file():
        return {}
    rows = pd.read_csv(path, dtype={"condition": str})
    keys = zip(rows["network"], rows["metric"], rows["condition"], strict=True)
    return dict(zip(keys, rows["spread"].astype(float), strict=True))
