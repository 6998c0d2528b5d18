"""The shards of a run put together to one run, as if it had not been divided (`bench merge`).

Jobs are copied and their images checked; tables, figures and the report are made as at the end of
any run. No method draws anything again, and neither dataset nor weights need to be at hand. A
merge that was stopped goes on where it was.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Generic

from bench.records.run_folder import (
    COLOURED,
    CONDITION_IDENTITIES,
    FIXED,
    TRUTH,
    read_finished,
    read_store,
)
from bench.records.store import JobRow, Store
from bench.running.options import Element, Shard, read_shard
from bench.running.protocol import WHOLE
from bench.running.run import Outputs, Publish, open_run, write_parquet
from data_prep.failures import BadInput
from data_prep.progress import progress

# Entries of the manifest that all shards must have in common.
ALIKE = (
    *(*FIXED, TRUTH),
    *("methods", "identities", "conditions", "skipped_metrics", "feature_identity", "environment"),
    *(CONDITION_IDENTITIES, "versions"),
)
EACH = ("shard", "started", "finished", "machine", "git")  # entries kept for each shard


@dataclass(frozen=True)
class FinishedShard:
    """A finished shard."""

    directory: Path
    shard: Shard
    manifest: Mapping[str, Any]


@dataclass(frozen=True)
class Merged(Generic[Outputs]):
    """A complete run: its folder, its outputs, and how many jobs it has and were copied."""

    directory: Path
    outputs: Outputs
    jobs: int
    copied: int


def merge(directories: Sequence[Path], out: Path, publish: Publish[Outputs]) -> Merged[Outputs]:
    """Put the shards of a run together in `out`; `publish` is as in `bench.running.run.run`.

    Raises BadInput, which names the directory, where one is no finished shard, is missing, given
    twice or of another run, or where images of it are missing or altered; and where `out` holds
    another run, or one with more methods, conditions or objects. The shards stay as they are.
    """
    parts = _in_order([_read_part(directory) for directory in directories])
    manifest = _describe(parts)
    with open_run(out, manifest) as store:
        jobs = _collect(parts, manifest["objects"], store)
        seconds: dict[str, float] = {}
        write_parquet(out, store, manifest["feature_identity"], seconds)
        outputs = publish(out, seconds)
        stages = manifest["stage_seconds"]
        stages |= {name: round(stages.get(name, 0) + timing, 1) for name, timing in seconds.items()}
    return Merged(out, outputs, jobs, store.appended)


def _read_part(directory: Path) -> FinishedShard:
    manifest = read_finished(directory)
    name = manifest.get("shard", WHOLE)
    if name is WHOLE:
        raise BadInput(f"{directory}: is a whole run, no shard; give what '--shard k/N' has made")
    complete, planned = len(manifest["objects"]), manifest.get("planned")
    if planned is not None and complete < planned:
        raise BadInput(
            f"{directory}: {complete} of its {planned} objects are complete; run the shard again "
            "with its command, which goes on with the others"
        )
    return FinishedShard(directory, read_shard(name), manifest)


def _in_order(parts: Sequence[FinishedShard]) -> list[FinishedShard]:
    """Return shards 1 to N. Raises BadInput where they are not the shards of one run, each once."""
    first = parts[0]
    for part in parts[1:]:
        for name in ALIKE:
            default = COLOURED if name == TRUTH else None
            value, other = (p.manifest.get(name, default) for p in (part, first))
            if value != other:
                raise BadInput(
                    f"{part.directory}: not of one run with {first.directory}: its {name} is "
                    f"{_differing(value, other)}; make both with the same command, packages and "
                    "drivers"
                )
        if part.shard.count != first.shard.count:
            raise BadInput(
                f"{part.directory}: is shard {part.shard}, {first.directory} {first.shard}; give "
                "the shards of one run"
            )
    by_number: dict[int, FinishedShard] = {}
    for part in parts:
        if (other := by_number.setdefault(part.shard.number, part)) is not part:
            raise BadInput(
                f"shard {part.shard}: is there twice, in {other.directory} and {part.directory}; "
                "leave one out"
            )
    count = first.shard.count
    if missing := [f"{k}/{count}" for k in range(1, count + 1) if k not in by_number]:
        named = ", ".join(missing)
        raise BadInput(f"missing: shard {named}; make it with --shard, and give it too")
    return [by_number[k] for k in range(1, count + 1)]


def interleave(shards: Sequence[Sequence[Element]]) -> list[Element]:
    """Return the elements of shards 1 to N in the order they had before `Shard.select`.

    Raises ValueError where `Shard.select` cannot give such lengths: each shard has as many elements
    as the one before, or, once, one less.
    """
    total = sum(map(len, shards))
    positions = [Shard(k, len(shards)).select(range(total)) for k in range(1, len(shards) + 1)]
    if [*map(len, shards)] != [*map(len, positions)]:
        raise ValueError(f"{[*map(len, shards)]} elements are not interleaved")
    by_position = dict(zip(chain(*positions), chain(*shards), strict=True))
    return [by_position[position] for position in range(total)]


def _differing(value: object, other: object) -> str:
    """Return two values of a manifest as text; of mappings only the entries that differ."""
    if isinstance(value, Mapping) and isinstance(other, Mapping):
        keys = sorted(k for k in value.keys() | other.keys() if value.get(k) != other.get(k))
        value, other = {k: value.get(k) for k in keys}, {k: other.get(k) for k in keys}
    return f"{value!r}, there {other!r}"


def _describe(parts: Sequence[FinishedShard]) -> dict[str, Any]:
    """Return the manifest of the whole run. Raises BadInput for missing and repeated objects."""
    shards = [list(part.manifest["objects"]) for part in parts]
    try:
        objects = interleave(shards)
    except ValueError as error:
        counts = ", ".join(f"{p.shard} has {len(o)}" for p, o in zip(parts, shards, strict=True))
        raise BadInput(
            f"objects: {counts}; were they made with one --limit, and of one dataset?"
        ) from error
    if doubled := [name for name, times in Counter(objects).items() if times > 1]:
        raise BadInput(f"{doubled[0]}: is in several shards; were they made of one dataset?")
    first = parts[0].manifest
    processors = dict.fromkeys(str(p.manifest.get("machine", {}).get("cpu")) for p in parts)
    seconds: dict[str, float] = {}
    for part in parts:
        for stage, timing in part.manifest.get("stage_seconds", {}).items():
            seconds[stage] = round(seconds.get(stage, 0.0) + timing, 1)
    kept = {name: value for name, value in first.items() if name not in ("worker_shares", "git")}
    return kept | {
        "objects": objects,
        "planned": len(objects),
        "shard": WHOLE,
        "merged": [{name: part.manifest.get(name) for name in EACH} for part in parts],
        "machine": first.get("machine", {}) | {"cpu": "; ".join(processors)},
        "workers": max(int(p.manifest.get("workers", 1)) for p in parts),
        "stage_seconds": seconds,
        "command": sys.argv,
        "finished": None,
    }


def _collect(parts: Sequence[FinishedShard], objects: Sequence[str], store: Store) -> int:
    """Bring all jobs into the store, list them object by object, and count them."""
    count = 0
    with ExitStack() as opened:
        sources: dict[str, Store] = {}
        for part in parts:
            source = opened.enter_context(read_store(part.directory))
            sources |= dict.fromkeys(part.manifest["objects"], source)

        def jobs_of(name: str) -> list[JobRow]:
            return sources[name].listed_of(*name.split("/", 1))

        with progress("merging, objects", len(objects)) as advance:
            for name in objects:
                keys = {job.key for job in jobs_of(name)}
                lacking = keys - store.copy(keys, sources[name])
                if lacking or not keys:
                    raise BadInput(
                        f"{sources[name].path}: has not all jobs of {name} any more; run the shard "
                        "again"
                    )
                count += len(keys)
                advance(0)
        store.list_jobs((job.key, job.name) for name in objects for job in jobs_of(name))
    return count
