"""`bench merge`: the shards of a run become one run, as if it had not been divided.

Journals, artifacts and records of the shards are brought together; tables, figures and the report
are made from them as at the end of any run. No method draws anything again, and neither dataset nor
weights need to be at hand. What has been copied is checked against its checksum. A merge that was
stopped goes on where it was.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic

from bench.records.artifacts import artifact_path, artifact_sha256
from bench.records.job import Result
from bench.records.journal import FIXED, Journal, read_finished, read_lines
from bench.records.parquet import JobRow, read_jobs
from bench.records.record import GROUND_TRUTH
from bench.running.extension import refuse_narrowing
from bench.running.protocol import WHOLE, Shard, interleave, read_shard
from bench.running.run import Outputs, WrittenRun, open_run, write_parquet
from data_prep.failures import BadInput, CannotWrite
from data_prep.progress import progress

# What all shards must have in common, beside what one directory has one value of.
ALIKE = (
    *FIXED,
    *("methods", "identities", "conditions", "skipped_metrics", "feature_identity", "environment"),
    "versions",
)
OWN = ("shard", "started", "finished", "machine", "git")  # stated for each


@dataclass(frozen=True)
class Part:
    """A finished shard."""

    directory: Path
    shard: Shard
    manifest: Mapping[str, Any]


@dataclass(frozen=True)
class Merged(Generic[Outputs]):
    """A complete run: where it is, what was made of it, its jobs, and how many were copied now."""

    directory: Path
    outputs: Outputs
    jobs: int
    copied: int


def merge(
    directories: Sequence[Path], out: Path, publish: Callable[[WrittenRun], Outputs]
) -> Merged[Outputs]:
    """Put the shards of a run together in `out`; `publish` as in `bench.running.run.run`.

    Raises BadInput where a directory is no finished shard, one is missing, there twice or of
    another run, naming it; where images of a shard are missing or altered; and where `out` holds
    another run, or one with more methods, conditions or objects. The shards stay as they are.
    """
    parts = _in_order([_read_part(directory) for directory in directories])
    manifest = _describe(parts)
    refuse_narrowing(out, manifest)
    with open_run(out, manifest) as journal:
        jobs = _collect(parts, manifest["objects"], journal)
        seconds: dict[str, float] = {}
        outputs = publish(
            write_parquet(
                out,
                manifest["suite"],
                jobs,
                lambda job: journal.lines.result(job.key).records,
                manifest["feature_identity"],
                seconds,
            )
        )
        stages = manifest["stage_seconds"]
        stages |= {name: round(stages.get(name, 0) + timing, 1) for name, timing in seconds.items()}
    return Merged(out, outputs, len(jobs), len(journal.added))


def _read_part(directory: Path) -> Part:
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
    return Part(directory, read_shard(name), manifest)


def _in_order(parts: Sequence[Part]) -> list[Part]:
    """Shards 1 to N. Raises BadInput where they are not those of one run, each of them once."""
    first = parts[0]
    for part in parts[1:]:
        for name in ALIKE:
            if part.manifest.get(name) != first.manifest.get(name):
                raise BadInput(
                    f"{part.directory}: not of one run with {first.directory}: its {name} is "
                    f"{_differing(part.manifest.get(name), first.manifest.get(name))}; make both "
                    "with the same command, packages and drivers"
                )
        if part.shard.count != first.shard.count:
            raise BadInput(
                f"{part.directory}: is shard {part.shard}, {first.directory} {first.shard}; give "
                "the shards of one run"
            )
    found: dict[int, Part] = {}
    for part in parts:
        if (other := found.setdefault(part.shard.number, part)) is not part:
            raise BadInput(
                f"shard {part.shard}: is there twice, in {other.directory} and {part.directory}; "
                "leave one out"
            )
    count = first.shard.count
    if missing := [f"{k}/{count}" for k in range(1, count + 1) if k not in found]:
        named = ", ".join(missing)
        raise BadInput(f"missing: shard {named}; make it with --shard, and give it too")
    return [found[k] for k in range(1, count + 1)]


def _differing(own: object, others: object) -> str:
    """Two values of a manifest, of mappings only what differs."""
    if isinstance(own, Mapping) and isinstance(others, Mapping):
        keys = [key for key in own.keys() | others.keys() if own.get(key) != others.get(key)]
        own, others = ({key: of.get(key) for key in sorted(keys)} for of in (own, others))
    return f"{own!r}, there {others!r}"


def _describe(parts: Sequence[Part]) -> dict[str, Any]:
    """The manifest of the whole. Raises BadInput where objects are missing or there twice."""
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
        "merged": [{name: part.manifest.get(name) for name in OWN} for part in parts],
        "machine": first.get("machine", {}) | {"cpu": "; ".join(processors)},
        "workers": max(int(p.manifest.get("workers", 1)) for p in parts),
        "stage_seconds": seconds,
        "command": sys.argv,
        "finished": None,
    }


def _collect(parts: Sequence[Part], objects: Sequence[str], journal: Journal) -> list[JobRow]:
    """All jobs in the order of the whole run, each in the journal and with its artifact."""
    rank = {name: place for place, name in enumerate(objects)}
    listed = [(part, read_jobs(part.directory)) for part in parts]
    with progress("merging", sum(len(jobs) for _, jobs in listed)) as advance:
        for part, jobs in listed:
            lines = read_lines(part.directory)
            for job in jobs:
                if job.key not in lines:
                    raise BadInput(
                        f"{part.directory}: {' '.join(job.item)} is not in its journal any more; "
                        "run the shard again"
                    )
                _take(part.directory, job, lines.result(job.key), journal)
                advance(0)
    return sorted(
        (job for _, jobs in listed for job in jobs),
        key=lambda job: (job.item.method != GROUND_TRUTH, rank["/".join(job.item.object)]),
    )


def _take(source: Path, job: JobRow, result: Result, journal: Journal) -> None:
    """Bring a job over unless it is there. Its line is written when its artifact is whole."""
    target = artifact_path(journal.directory, job.key)
    there = journal.lines.result(job.key) if job.key in journal.lines else None
    wanted = result.artifact_sha256
    if there == result and (wanted is None or artifact_sha256(target) == wanted):
        return
    if wanted is not None:
        _copy(artifact_path(source, job.key), target)
        if artifact_sha256(target) != wanted:
            raise BadInput(
                f"{artifact_path(source, job.key)}: missing or altered; run the shard again with "
                "its command, which makes it anew"
            )
    journal.append(result)


def _copy(source: Path, target: Path) -> None:
    """A second name for the file where the file system allows it, else a copy."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.unlink(missing_ok=True)
    except OSError as error:
        raise CannotWrite(f"{target}: cannot be written ({error.strerror}); give --out") from error
    if not source.is_file():
        return
    with suppress(OSError):  # another file system, or one without links
        os.link(source, target)
        return
    try:
        shutil.copyfile(source, target)
    except OSError as error:
        raise CannotWrite(f"{target}: cannot be written ({error.strerror}); make room") from error
