"""The golden values of this project, in `results/golden`: their names, their paths, reading them.

A golden value is only ever compared with; no table shows one.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from bench.records.folder import COLOURED, PROTOCOL, TRUTH
from bench.tables.paper import RESULTS
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.failures import BadInput

GOLDEN = RESULTS / "golden"  # the folder of the files


def golden_name(manifest: Mapping[str, Any]) -> str:
    """Return the name of the golden values of a run: its suite, and "-grey" for truth in grey."""
    truth = manifest.get(TRUTH, COLOURED)
    return str(manifest["suite"]) + (f"-{truth}" if truth != COLOURED else "")


def golden_path(name: str) -> Path:
    """Return the path of golden values."""
    return GOLDEN / f"{name}.csv"


def golden(name: str) -> pd.DataFrame:
    """Return golden values. Raises BadInput without any, and for those of another protocol."""
    path = golden_path(name)
    if not path.is_file():
        raise BadInput(
            f"{path}: no golden values for '{name}'; 'bench check DIR --again 0.05' compares a run "
            "with itself"
        )
    values = pd.read_csv(path, dtype={"condition": str}, keep_default_na=False)
    versions = values[PROTOCOL].unique().tolist() if PROTOCOL in values else []
    for version in versions or [None]:  # a file without lines states none
        again = "write it with 'bench check DIR --bless results/golden'"
        refuse_other_version(path, version, again)
    return values
