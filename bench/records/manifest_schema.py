"""The schema of manifests: every reader gets entries of these types, or a refusal."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from bench.records.store import MOST_VIEWS

_OBJECT = re.compile(r"[^/]+/.+", re.DOTALL)  # class and name
_FACTS = {str: str}
MOST_SHOWN = 40  # characters of a value in a message
# A type is that of a value, [A] a list of A, [A, B] a list of two, {str: A} a mapping to A; a
# mapping of names has entries of which each may be missing; of several in a tuple one has to fit.
SCHEMA: Mapping[str, Any] = {
    "schema_version": int,
    "protocol": int,
    "suite": str,
    "dataset": str,
    "views": int,
    "seed": int,
    "device": str,
    "truth": str,
    "shard": (None, str),
    "methods": [str],
    "identities": {str: [int, str, str]},
    "objectives": _FACTS,
    "entered": {str: {"tree": str, "name": str}},
    "conditions": [str],
    "condition_identities": _FACTS,
    "objects": [_OBJECT],
    "pairs": [str],
    "triples": [str],
    "cases": [str],
    "threads": [int],
    "weights": {str: _FACTS},
    "skipped_metrics": _FACTS,
    "feature_identity": _FACTS,
    "environment": _FACTS,
    "versions": _FACTS,
    "workers": int,
    "planned": int,
    "command": [str],
    "started": str,
    "finished": (None, str),
    "machine": {"cpu": str, "platform": str, "instructions": str, "cores": int}
    | {"memory_gib": (int, float)},
    "code": str,
    "git": {"commit": str, "clean": bool},
    "cluster": (None, dict.fromkeys(("address", "version"), str)),
    "stage_seconds": {str: (int, float)},
    "worker_shares": {str: (int, float)},
    "merged": [{"shard": str, "started": (None, str), "machine": {"cpu": str}}],
    "request": {
        **dict.fromkeys(("suite", "dataset", "device", "truth", "inception_weights"), str),
        **{name: [str] for name in ("methods", "conditions", "metrics")},
        **dict.fromkeys(("limit", "views", "seed"), int),
    },
}
# Entries that every run has from its start; all others of `SCHEMA` may be missing.
_NEEDED = (
    *("schema_version", "protocol", "request", "suite", "dataset", "views", "seed", "device"),
    *("methods", "environment", "command", "started", "finished", "versions", "machine"),
)
_OF_JOBS = (
    *("shard", "identities", "objectives", "conditions", "objects", "skipped_metrics"),
    *("feature_identity", "planned"),
)
# Suites with a procedure of their own measure other things.
_OF_PROCEDURES = {"latent": (), "stability": ("objects",), "speed": ("conditions", "objects")}


def misfit(manifest: Mapping[str, Any]) -> str:
    """Return what a manifest lacks, or the first entry of another type; "" where it fits."""
    needed = (*_NEEDED, *_OF_PROCEDURES.get(str(manifest.get("suite")), _OF_JOBS))
    if lacking := [name for name in needed if name not in manifest]:
        return f"no {', '.join(lacking)}"
    return _misfit(manifest, SCHEMA, "") or _out_of_range(manifest)


def _out_of_range(manifest: Mapping[str, Any]) -> str:
    """Return a number that no run has, or a name that stands twice; "" where there is none."""
    if not 1 <= manifest["views"] <= MOST_VIEWS:
        return f"views is {manifest['views']}, not 1 to {MOST_VIEWS}"
    for name in ("methods", "conditions", "objects"):
        names = manifest.get(name, [])
        if len(twice := [*dict.fromkeys(n for n in names if names.count(n) > 1)]):
            return f"{name} has {twice[0]!r} twice"
    return ""


def _misfit(value: Any, wanted: Any, place: str) -> str:
    """Return the first place where a value has another type; "" where there is none."""
    if isinstance(wanted, tuple):
        problems = [_misfit(value, kind, place) for kind in wanted]
        return "" if "" in problems else problems[-1]
    if isinstance(wanted, list):
        if not isinstance(value, list) or len(wanted) not in (1, len(value)):
            return _other(place, value, "list" + f" of {len(wanted)}" * (len(wanted) > 1))
        inner = [(f"[{i}]", v, wanted[i % len(wanted)]) for i, v in enumerate(value)]
    elif isinstance(wanted, dict):
        if not isinstance(value, dict):
            return _other(place, value, "object")
        inner = [
            (f".{name}", v, wanted.get(name, wanted.get(str, object))) for name, v in value.items()
        ]
    else:
        return (
            "" if _fits(value, wanted) else _other(place, value, _NAMES.get(wanted, "class/name"))
        )
    problems = (_misfit(v, kind, f"{place}{at}".removeprefix(".")) for at, v, kind in inner)
    return next(filter(None, problems), "")


def _other(place: str, value: Any, kind: str) -> str:
    text = repr(value)
    return f"{place} is {text if len(text) <= MOST_SHOWN else f'{text[:MOST_SHOWN]}...'}, no {kind}"


def _fits(value: Any, wanted: Any) -> bool:
    if isinstance(wanted, re.Pattern):
        return isinstance(value, str) and wanted.fullmatch(value) is not None
    if wanted is None:
        return value is None
    if wanted is int:
        return type(value) is int and abs(value) < 2**63
    return wanted is object or (type(value) is wanted and value == value)  # NaN is no number


_NAMES = {str: "text", int: "whole number", float: "number", bool: "truth value", None: "null"}
