"""The check that a folder is the one of a receipt, and that its tables follow from its jobs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from bench.analysis.scored import scored_run
from bench.receipts.digests import (
    DAMAGED,
    MOST_TABLE_BYTES,
    PART_DIGITS,
    FolderDigests,
    digest_folder,
    digest_records,
)
from bench.receipts.receipt import PROTOCOL, condensed
from bench.records.parquet import FEATURES, RECORDS, read_records, write_features, write_records
from bench.records.run_folder import write_manifest
from bench.records.seal import check_seal
from bench.records.store import open_store
from bench.tables.build import make_outputs
from bench.tables.table import TABLES, table_files
from data_prep.failures import BadInput
from data_prep.files.safe_read import read_file

LAST_DIGITS = 2e-6  # files keep 6 decimals, and another processor rounds the last one elsewhere
MOST_SHOWN = 60  # characters of a value in a message


def compare_manifest(
    receipt: Mapping[str, Any],
    described: Mapping[str, Any],
    objects: Sequence[str],
    expected: Sequence[str],
) -> list[str]:
    """Return a line for each difference between a receipt and a manifest's entries and objects.

    `expected` are the objects that the receipt's request chooses.
    """
    lines = []
    for name in ("request", "code", "environment", "weights", "metrics"):
        lines += differing(f"manifest: {name}", _as_long(receipt, described, name), receipt[name])
    for name in ("schema", PROTOCOL):
        lines += differing("manifest", {name: described[name]}, {name: receipt[name]})
    if objects != expected:
        lines.append(f"manifest: {len(objects)} objects, not the {len(expected)} of the request")
    return lines


def compare_folder(
    receipt: Mapping[str, Any], directory: Path, manifest: Mapping[str, Any]
) -> list[str]:
    """Return a line for each difference between a folder and its receipt, by checksums alone."""
    folder = digest_folder(directory, manifest)
    lines = [*folder.problems, *_other_jobs(receipt["jobs"], folder)]
    if folder.entries["records"] != receipt["records"]:
        lines.append(f"{RECORDS}: its records are not those of the receipt")
    tables = _as_long(receipt, folder.entries, "tables")
    lines += [
        f"{TABLES}/{name}: not the table of the receipt"
        if name in tables
        else f"{TABLES}: no {name}"
        for name, digest in receipt["tables"].items()
        if tables.get(name) != digest
    ]
    lines += [
        f"{TABLES}/{name}: not in the receipt" for name in tables if name not in receipt["tables"]
    ]
    return lines


def _as_long(receipt: Mapping[str, Any], entries: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return an entry, with one digest for all of its checksums where the receipt has that."""
    return condensed(entries[name]) if receipt[name].keys() == {"all"} else entries[name]


def differing(title: str, here: Mapping[str, Any], there: Mapping[str, Any]) -> list[str]:
    """Return a line for each name whose value is another than in the receipt."""
    return [
        f"{title}: {name} {_shown(here.get(name))}, in the receipt {_shown(there.get(name))}"
        for name in sorted(here.keys() | there.keys())
        if here.get(name) != there.get(name)
    ]


def _shown(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."


def _other_jobs(jobs: Mapping[str, Any], folder: FolderDigests) -> list[str]:
    """Return a line for each part of the jobs that has another digest than in the receipt."""
    if jobs == folder.entries["jobs"]:
        return []
    parts = jobs["parts"]
    expected = [parts[i : i + PART_DIGITS] for i in range(0, len(parts), PART_DIGITS)]
    if len(expected) != len(folder.parts):
        return [f"jobs: {folder.entries['jobs']['count']}, in the receipt {jobs['count']}"]
    lines = [
        f"jobs of {', '.join(members)}: not those of the receipt"
        for (digest, members), wanted in zip(folder.parts, expected, strict=True)
        if digest[:PART_DIGITS] != wanted
    ]
    return lines or ["jobs: not those of the receipt"]


def remake(
    directory: Path,
    manifest: Mapping[str, Any],
    extractors: Sequence[str],
    scratch: Path,
    same_environment: bool,
) -> tuple[list[str], list[str]]:
    """Make records, features and tables again from the jobs in a folder's store, in `scratch`.

    Return a line for each file of the folder that differs, and the names of its tables that cannot
    be made from records. `extractors` are those whose features are in the artifacts. In another
    environment the last digits of tables may differ, and only their values are compared.
    """
    try:
        write_manifest(scratch, manifest)
        with open_store(directory) as store:
            write_records(scratch, store.listed_columns())
            write_features(scratch, store, extractors)
        outputs = make_outputs(scored_run(scratch, dict(manifest)))
    except DAMAGED as error:
        return [f"tables: cannot be made again from the jobs ({error})"], []
    lines = [*_other_records(directory, scratch), *_other_features(directory, scratch)]
    remade = table_files([outputs.headline, *outputs.tables, *outputs.further])
    for name, text in remade.items():
        if not same_environment and not name.endswith(".csv"):
            continue
        try:
            stored = read_file(directory / TABLES / name, MOST_TABLE_BYTES)
        except BadInput as error:
            lines.append(str(error))
            continue
        if stored != text.encode() and (same_environment or not same_values(stored, text)):
            lines.append(f"{TABLES}/{name}: not the table that follows from the jobs")
    names = {path.name for path in (directory / TABLES).glob("*.csv")}
    return lines, sorted(names - remade.keys())


def _other_records(directory: Path, scratch: Path) -> list[str]:
    try:
        read_records(directory)  # all of it: others read the times as well
        same = digest_records(directory) == digest_records(scratch)
    except DAMAGED as error:
        return [f"{RECORDS}: cannot be read ({error})"]
    return [] if same else [f"{RECORDS}: not the records of the jobs in the store"]


def _other_features(directory: Path, scratch: Path) -> list[str]:
    """Return a line for each file of features that has not what the store has."""
    folders = (directory / FEATURES, scratch / FEATURES)
    stored, remade = ({path.name for path in folder.glob("*.parquet")} for folder in folders)
    lines = [f"{FEATURES}/{name}: features of no job" for name in sorted(stored - remade)]
    for name in sorted(remade):
        first, second = (folder / name for folder in folders)
        try:
            if not same_parquet(first, second):
                lines.append(f"{FEATURES}/{name}: not the features of the jobs in the store")
        except DAMAGED as error:
            lines.append(f"{FEATURES}/{name}: cannot be read ({error})")
    return lines


def same_parquet(stored_file: Path, remade_file: Path) -> bool:
    """Return whether a stored file has the rows and the statistics of a remade one.

    Raises one of DAMAGED for a file that cannot be read.
    """
    if stored_file.read_bytes() == remade_file.read_bytes():
        return True
    check_seal(stored_file)
    stored, remade = (pq.read_table(path, use_threads=False) for path in (stored_file, remade_file))
    return stored.equals(remade) and _statistics(stored_file) == _statistics(remade_file)


def _statistics(path: Path) -> list[Any]:
    footer = pq.read_metadata(path)
    return [
        [footer.row_group(group).column(column).to_dict() for column in range(footer.num_columns)]
        for group in range(footer.num_row_groups)
    ]


def same_values(stored: bytes, made: str) -> bool:
    """Return whether two CSV files have the same fields, numbers but for their last digit."""
    try:
        rows = [[*csv.reader(io.StringIO(text))] for text in (stored.decode(), made)]
    except (UnicodeDecodeError, csv.Error):
        return False
    return len(rows[0]) == len(rows[1]) and all(
        len(first) == len(second) and all(map(_same_field, first, second))
        for first, second in zip(*rows, strict=True)
    )


def _same_field(first: str, second: str) -> bool:
    try:
        return first == second or math.isclose(
            float(first), float(second), rel_tol=LAST_DIGITS, abs_tol=LAST_DIGITS
        )
    except ValueError:
        return False
