"""The methods of a site: an id with other weights or of another version is another method."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import Any

from bench.analysis.paired import Side
from bench.analysis.ranks import Ranking
from bench.running.options import file_name

SHORT = 7  # digits of a checksum in a name
LONGEST = 80  # bytes of a part of a file name; two of them are in the name of a page
_CHECKSUM = re.compile(r"\b[0-9a-f]{32,}\b")


@dataclass(frozen=True)
class SiteMethod:
    """A method of a run under the name that it has on the site.

    id         its id in the run
    name       the id; where other runs have it with another identity, also what differs
    identity   what its images depend on beside libraries: its version, the checksum of its
               weights; empty where the run does not say
    libraries  those that its images depend on, with their versions
    """

    id: str
    name: str
    identity: tuple[str, ...]
    libraries: str


def site_methods(manifests: Sequence[Mapping[str, Any]]) -> list[dict[str, SiteMethod]]:
    """Return the methods of each run by their ids.

    The identity that a run writes down also holds versions of libraries. They do not make another
    method here: a site shows the same weights on several machines, each with its libraries.
    """
    stated = [{m: _identity(manifest, m) for m in manifest["methods"]} for manifest in manifests]
    identities: dict[str, set[tuple[str, ...]]] = {}
    for methods in stated:
        for method, (identity, _) in methods.items():
            identities.setdefault(method, set()).add(identity)
    return [
        {
            method: SiteMethod(method, _name(method, identity, identities[method]), identity, used)
            for method, (identity, used) in methods.items()
        }
        for methods in stated
    ]


def _identity(manifest: Mapping[str, Any], method: str) -> tuple[tuple[str, ...], str]:
    """Return the identity of a method in a run, and its libraries."""
    match manifest.get("identities", {}).get(method):
        case [version, str(text), *_]:
            parts = [part for part in text.split(", ") if part]
        case _:
            return (), ""
    versions = {f"{name} {number}" for name, number in manifest.get("versions", {}).items()}
    libraries = ", ".join(part for part in parts if part in versions)
    return (f"version {version}", *(part for part in parts if part not in versions)), libraries


def _name(method: str, identity: tuple[str, ...], all_of_id: set[tuple[str, ...]]) -> str:
    """Return a name that no other identity of the same id has."""
    if len(all_of_id) == 1:
        return method
    suffixes = {each: _suffix(each, all_of_id) for each in all_of_id}
    suffix = suffixes[identity]
    if list(suffixes.values()).count(suffix) > 1:
        suffix = _checksum(repr(identity))
    return f"{method} ({suffix})"


def _suffix(identity: tuple[str, ...], all_of_id: set[tuple[str, ...]]) -> str:
    """Return the parts of an identity that not all have, checksums shortened."""
    differ = [part for part in identity if not all(part in other for other in all_of_id)]
    text = ", ".join(differ) or ("identity unknown" if not identity else "")
    return _CHECKSUM.sub(lambda checksum: checksum[0][:SHORT], text) or _checksum(repr(identity))


def under_site_names(ranking: Ranking, methods: Mapping[str, SiteMethod]) -> Ranking:
    """Return a ranking with the names on the site in place of ids."""

    def named(side: Side) -> Side:
        return replace(side, method=methods[side.method].name)

    pairs = (
        replace(cell, pair=replace(cell.pair, a=named(cell.pair.a), b=named(cell.pair.b)))
        for cell in ranking.pairs
    )
    ranks = (replace(rank, method=methods[rank.method].name) for rank in ranking.ranks)
    return replace(ranking, ranks=tuple(ranks), pairs=tuple(pairs))


def method_slug(name: str) -> str:
    """Return a part of a file name, another one for each name of a method."""
    plain = name.replace("@", "_")  # ids have no underscore; paths of weights may
    slug = file_name(plain)
    if slug == plain and "_" not in name and len(slug.encode()) <= LONGEST:
        return slug
    return f"{shortened_name(slug).rstrip('-')}-{_checksum(name)}"


def shortened_name(text: str) -> str:
    """Return as much of a text as a part of a file name may have."""
    return text.encode()[:LONGEST].decode(errors="ignore")


def _checksum(text: str) -> str:
    return sha256(text.encode(errors="backslashreplace")).hexdigest()[:SHORT]
