"""What the original code keeps beside its pictures: camera angles and splits.

Formats as read by roatienza/pc2pix@46795a46 (loader.py, shapenet.py). Ids from these files become
parts of paths, so nothing that could lead out of the dataset's folder is taken for an id.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from data_prep.failures import BadInput
from data_prep.scene import View
from data_prep.untrusted import MIB, plain_name, plain_text, read_file, shown

MOST_VIEW_BYTES = 2**16  # the original has 20 lines of two numbers
MOST_SPLIT_BYTES = 64 * MIB  # the original's largest, of 43,783 objects, has 2
MOST_COLUMNS = 16


@dataclass(frozen=True)
class PaperClass:
    """The objects of one class: its name, and the ids of its training and test split."""

    name: str
    train: tuple[str, ...]
    test: tuple[str, ...]


def read_views(path: Path) -> tuple[View, ...]:
    """The cameras of `view.txt`: line k holds azimuth and elevation of picture k in degrees.

    Further numbers of a line are passed over, as in the original. The angles are those of the file:
    whether zero and sense are ours is up to who reads a dataset. Raises BadInput, naming file, line
    and value, for whatever is no angle, for gaps, and for an empty file.
    """
    text = _text(path, MOST_VIEW_BYTES)
    views = []
    for number, line in enumerate(text.rstrip().splitlines(), 1):
        fields = line.split()
        if not 2 <= len(fields) <= MOST_COLUMNS:
            raise BadInput(
                f"{path}: line {number} has {len(fields)} numbers, expected azimuth and elevation; "
                "a line per picture"
            )
        try:
            azimuth, elevation, *_ = [_number(field) for field in fields]
            views.append(View(azimuth, elevation))
        except ValueError as error:
            raise BadInput(f"{path}: line {number}: {error}; give degrees") from None
    if not views:
        raise BadInput(f"{path}: no views; give azimuth and elevation, a line per picture")
    return tuple(views)


def read_split(path: Path) -> dict[str, PaperClass]:
    """The classes of a split file such as `chair_exp.json`, by their synset ("03001627").

    {synset: {"name": ..., "train": [id, ...], "test": [id, ...]}}. An id is the name of a file or
    folder, and nothing else: no path, no ".", no control characters. Raises BadInput, naming file,
    value and remedy, for any other form, for an object that is listed twice, and for a file without
    classes.
    """
    text = _text(path, MOST_SPLIT_BYTES)
    try:
        tree = json.loads(text, object_pairs_hook=_without_doubles)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: not JSON that can be read ({error}); fetch it again") from None
    try:
        if not isinstance(tree, dict) or not tree:
            raise ValueError("no classes")
        return {plain_name(synset): _paper_class(synset, entry) for synset, entry in tree.items()}
    except ValueError as error:
        raise BadInput(
            f"{path}: {error}; expected {{synset: {{name, train: [ids], test: [ids]}}}}"
        ) from None


def _text(path: Path, most_bytes: int) -> str:
    try:
        return read_file(path, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: not UTF-8 at byte {error.start}; fetch it again") from None


def _number(field: str) -> float:
    try:
        if "_" in field or not field.isascii():  # Python's own, 1_000
            raise ValueError
        return float(field)
    except ValueError:
        raise ValueError(f"{shown(field)} is not a number") from None


def _paper_class(synset: str, entry: Any) -> PaperClass:
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        raise ValueError(f"class {shown(synset)} has no name")
    splits = {}
    for split in ("train", "test"):
        ids = entry.get(split)
        if not isinstance(ids, list):
            raise ValueError(f"class {shown(synset)} has no list {split!r}")
        splits[split] = tuple(plain_name(value) for value in ids)
    twice = _first_double(splits["train"] + splits["test"])
    if twice is not None:
        raise ValueError(f"class {shown(synset)} lists {shown(twice)} twice")
    return PaperClass(plain_text(entry["name"]), **splits)


def _without_doubles(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    twice = _first_double([name for name, _ in pairs])
    if twice is not None:
        raise ValueError(f"{shown(twice)} is there twice")
    return dict(pairs)


def _first_double(names: Sequence[str]) -> str | None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None
