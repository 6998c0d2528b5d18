"""The statements of the author of images that were drawn elsewhere: the file `method.toml`.

Nothing of it can be checked here but its form, so tables call the times *claimed*. A run repeats
the facts in its manifest: it can be read where the folder is not.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection, Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any

from data_prep.failures import BadInput
from data_prep.files.safe_read import plain_text, read_text, reason_of, shown
from data_prep.plugins import is_id

CLAIMS = "method.toml"
IMAGES_PREFIX = "images:"  # begins the name of a folder of images on the command line: images:TREE
# The entry of a manifest with the facts by method, and the key under which the facts of a method
# have the folder of its images.
ENTERED, TREE = "entered", "tree"
_MOST_BYTES = 64 * 2**10  # of a file of facts
_MOST_S = 1e6  # largest claimed time, seconds: twelve days
_CHECKSUM = re.compile("[0-9a-f]{64}")  # a sha256


@dataclass(frozen=True)
class Claims:
    """The facts about a method that was run elsewhere, as its author states them.

    name               id of the method in tables, kebab-case
    source             one line about what it does and where it comes from
    trained_on         the objects that a network has seen; "nothing" where it learns nothing
    hardware           the machine of the times
    prepare_s, draw_s  seconds for a cloud, and for one view of it
    licence            of the images
    export             checksum of the export whose clouds it drew
                       (`data_prep.datasets.exported.checksum_of`)
    version            version or commit of the method; "" for none. Another version is another
                       method on a leaderboard of runs
    """

    name: str
    source: str
    trained_on: str
    hardware: str
    prepare_s: float
    draw_s: float
    licence: str
    export: str
    version: str = ""

    @property
    def about(self) -> str:
        """Return the description for people, in one line."""
        return (
            f"{self.source}; entered by images, drawn elsewhere on {self.hardware}, its times are "
            f"claimed; licence of the images: {self.licence}"
        )


def read_claims(tree: Path, taken: Collection[str]) -> Claims:
    """Return the facts in the `method.toml` of a tree.

    Raises BadInput, naming the file, for one that is missing or no TOML, for a key that is missing
    or unknown, for a value of another form, and for a name that is `taken`.
    """
    path = tree / CLAIMS
    if not tree.is_dir():
        raise BadInput(f"{tree}: no such folder; give a tree of images with its {CLAIMS}")
    text = read_text(path, _MOST_BYTES)
    try:
        stated = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: of a number of 5,000 digits
        raise BadInput(f"{path}: not TOML ({reason_of(error)}); correct it") from error
    claims = _checked_claims(stated, str(path))
    if claims.name in taken:
        raise BadInput(
            f"{path}: name {shown(claims.name)} is an id of this installation; give another name"
        )
    return claims


def _checked_claims(stated: Mapping[str, Any], where: str) -> Claims:
    known = {field.name: field for field in fields(Claims)}
    if others := [key for key in stated if key not in known]:
        raise BadInput(f"{where}: unknown key {shown(others[0])}; the keys are {', '.join(known)}")
    values: dict[str, Any] = {}
    for key, field in known.items():
        if key in stated:
            values[key] = _checked(key, stated[key], field.type == "float", where)
        elif field.default is MISSING:
            raise BadInput(f"{where}: no key {key}; add it, as docs/extending.md shows")
    if not is_id(values["name"]):
        raise BadInput(
            f"{where}: name {shown(values['name'])} is not kebab-case (a-z, 0-9 and single "
            "hyphens), and it names files; rename it"
        )
    if not _CHECKSUM.fullmatch(values["export"]):
        raise BadInput(
            f"{where}: export {shown(values['export'])} is no sha256; copy the identifier in the "
            "croissant.json of the export"
        )
    return Claims(**values)


def _checked(key: str, value: Any, is_number: bool, where: str) -> str | float:
    if is_number:
        whole_or_float = isinstance(value, (int, float)) and not isinstance(value, bool)
        if whole_or_float and 0 <= value <= _MOST_S:
            return float(value)
        raise BadInput(
            f"{where}: {key} {shown(repr(value))} is no number of seconds from 0 to {_MOST_S:g}; "
            "give the time as a number, such as 0.25"
        )
    try:
        return plain_text(value)
    except ValueError as error:
        raise BadInput(f"{where}: {key} {error}; give a short text in one line") from None


def manifest_entry(trees: Mapping[str, tuple[Path, Claims]]) -> dict[str, Any]:
    """Return the entry of a manifest for methods entered by images; nothing without any."""
    facts_by_method = {}
    for name, (root, claims) in trees.items():
        stated = {key: fact for key, fact in asdict(claims).items() if fact != ""}
        facts_by_method[name] = {TREE: str(root), **stated}
    return {ENTERED: facts_by_method} if facts_by_method else {}


def entered_claims(manifest: Mapping[str, Any], method_id: str) -> Claims | None:
    """Return the facts of a method entered by images, as a run's manifest has them.

    None for another method, and for an entry that is damaged.
    """
    stated = _entry(manifest, method_id)
    try:
        return _checked_claims({k: v for k, v in stated.items() if k != TREE}, ENTERED)
    except BadInput:
        return None


def drawn_export(manifest: Mapping[str, Any]) -> str | None:
    """Return the checksum of the export that a run's methods were drawn from, None without such.

    All of them were drawn from one, which was compared with the inputs of the run when they joined.
    """
    entered = manifest.get(ENTERED)
    for name in entered if isinstance(entered, Mapping) else ():
        if claims := entered_claims(manifest, name):
            return claims.export
    return None


def address_of(manifest: Mapping[str, Any], method_id: str) -> str:
    """Return the text by which a method of a run is found: its id, or "images:" and its tree."""
    tree = _entry(manifest, method_id).get(TREE)
    return f"{IMAGES_PREFIX}{tree}" if isinstance(tree, str) else method_id


def _entry(manifest: Mapping[str, Any], method_id: str) -> Mapping[str, Any]:
    entered = manifest.get(ENTERED)
    stated = entered.get(method_id) if isinstance(entered, Mapping) else None
    return stated if isinstance(stated, Mapping) else {}
