"""The schema of manifests: every reader gets entries of these types, or a refusal."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

_OBJECT = re.compile(r"[^/]+/.+", re.DOTALL)  # class and name
_FACTS = {str: str}
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
    "request": (
        None,
        {
            **dict.fromkeys(("suite", "dataset", "device", "truth", "inception_weights"), str),
            **{name: [str] for name in ("methods", "conditions", "metrics")},
            **dict.fromkeys(("limit", "views", "seed"), int),
        },
    ),
}
NEEDED = ("suite", "dataset", "views", "seed", "device", "methods", "conditions", "objects")
# Suites with a procedure of their own measure other things.
_LACKING = {"latent": ("conditions", "objects"), "stability": ("conditions",)}


def misfit(manifest: Mapping[str, Any]) -> str:
    """Return what a manifest lacks, or the first entry of another type; "" where it fits."""
    suite = manifest.get("suite")
    needed = [name for name in NEEDED if name not in _LACKING.get(str(suite), ())]
    if lacking := [name for name in needed if name not in manifest]:
        return f"no {', '.join(lacking)}"
    return next((f"{place} is not {named}" for place, named in _misfits(manifest, SCHEMA, "")), "")


def _misfits(value: Any, wanted: Any, place: str) -> Iterable[tuple[str, str]]:
    """Yield the places where a value has another type, each with what it should be."""
    if isinstance(wanted, tuple):
        if all(any(True for _ in _misfits(value, kind, place)) for kind in wanted):
            yield from _misfits(value, wanted[-1], place)
    elif isinstance(wanted, list):
        if not isinstance(value, list) or (len(wanted) > 1 and len(wanted) != len(value)):
            yield place, f"a list of {len(wanted)}" if len(wanted) > 1 else "a list"
            return
        for i, element in enumerate(value):
            yield from _misfits(element, wanted[i % len(wanted)], f"{place}[{i}]")
    elif isinstance(wanted, Mapping):
        if not isinstance(value, Mapping):
            yield place, "an object"
            return
        for name, element in value.items():
            of_entry = wanted.get(name, wanted.get(str))
            if of_entry is not None:
                yield from _misfits(element, of_entry, f"{place}.{name}".removeprefix("."))
    elif not _fits(value, wanted):
        yield place, "class/name" if wanted is _OBJECT else _NAMES[wanted]


_NAMES = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    None: "null",
}


def _fits(value: Any, wanted: Any) -> bool:
    if isinstance(wanted, re.Pattern):
        return isinstance(value, str) and wanted.fullmatch(value) is not None
    if wanted is None:
        return value is None
    if wanted is int:
        return type(value) is int and abs(value) < 2**63
    return type(value) is wanted and (wanted is not float or math.isfinite(value))
