"""The shards of a run put together to one run, as if it had not been divided (`bench merge`).

Jobs are copied and their images checked; tables, figures and the report are made as at the end of
any run. No method draws anything again, and neither dataset nor weights need to be at hand. A
merge that was stopped goes on where it was.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Generic, NamedTuple

from bench.records.job import tenths
from bench.records.run_folder import CONDITION_IDENTITIES, FIXED, TRUTH, entry, read_finished
from bench.records.store import JobRow, Store, open_store
from bench.running.environment import ENVIRONMENTS, command_line, environments_entry
from bench.running.options import Element, read_shard
from bench.running.protocol import WHOLE
from bench.running.run import Outputs, Publish, open_run, write_export
from data_prep.failures import BadInput
from data_prep.progress import progress

# Entries of the manifest that all shards must have in common.
ALIKE = (
    *(*FIXED, TRUTH),
    *("methods", "identities", "conditions", "skipped_metrics", "feature_identity", "environment"),
    *(CONDITION_IDENTITIES, "versions"),
)
Part = tuple[Path, Mapping[str, Any]]  # the folder of a shard, and its manifest
EACH = ("shard", "started", "finished", "machine", "git")  # entries kept for each shard


class Merged(NamedTuple, Generic[Outputs]):
    """The outputs of a complete run, and how many jobs it has and were copied."""

    outputs: Outputs
    jobs: int
    copied: int


def merge(directories: Sequence[Path], out: Path, publish: Publish[Outputs]) -> Merged[Outputs]:
    """Put the shards of a run together in `out`; `publish` is as in `bench.running.run.run`.

    Raises BadInput, which names the folder, where one is no finished shard, is missing, given
    twice, of another run or damaged; and as `open_run`. The shards stay as they are.
    """
    parts = _in_order([(directory, _read_part(directory)) for directory in directories])
    manifest = _describe([manifest for _, manifest in parts])
    with open_run(out, manifest) as store:
        jobs = _collect(parts, manifest["objects"], store)
        manifest[ENVIRONMENTS] = environments_entry(store.environments())
        seconds: dict[str, float] = {}
        write_export(out, store, seconds)
        outputs = publish(out, seconds)
        manifest["stage_seconds"] = _added(manifest, {"stage_seconds": seconds})
    return Merged(outputs, jobs, store.appended)


def _read_part(directory: Path) -> dict[str, Any]:
    manifest = read_finished(directory)
    if manifest.get("shard", WHOLE) is WHOLE:
        raise BadInput(f"{directory}: is a whole run, no shard; give what '--shard k/N' has made")
    complete = len(manifest["objects"])
    if complete < (planned := manifest.get("planned", 0)):
        raise BadInput(
            f"{directory}: {complete} of its {planned} objects are complete; run the shard again "
            "with its command, which goes on with the others"
        )
    return manifest


def _in_order(parts: Sequence[Part]) -> list[Part]:
    """Return shards 1 to N; refuse others than those of one run, each once."""
    first, manifest = parts[0]
    count = read_shard(manifest["shard"]).count
    by_number: dict[int, Part] = {}
    for directory, other in parts:
        for name in ALIKE:
            if differing := _differing(entry(other, name), entry(manifest, name)):
                raise BadInput(
                    f"{directory}: not of one run with {first}: its {name} is {differing}; make "
                    "both with the same command, packages and drivers"
                )
        shard = read_shard(other["shard"])
        if shard.count != count:
            raise BadInput(
                f"{directory}: is shard {shard}, {first} {manifest['shard']}; give the shards of "
                "one run"
            )
        if shard.number in by_number:
            both = f"{by_number[shard.number][0]} and {directory}"
            raise BadInput(f"shard {shard}: is there twice, in {both}; leave one out")
        by_number[shard.number] = directory, other
    if missing := [f"{k}/{count}" for k in range(1, count + 1) if k not in by_number]:
        named = ", ".join(missing)
        raise BadInput(f"missing: shard {named}; make it with --shard, and give it too")
    return [by_number[k] for k in sorted(by_number)]


def _differing(value: object, other: object) -> str:
    """Return two values as text, of mappings what differs; "" for equal ones."""
    if value == other:
        return ""
    if isinstance(value, Mapping) and isinstance(other, Mapping):
        keys = sorted(k for k in value.keys() | other.keys() if value.get(k) != other.get(k))
        value, other = {k: value.get(k) for k in keys}, {k: other.get(k) for k in keys}
    return f"{value!r}, there {other!r}"


def interleave(shards: Sequence[Sequence[Element]]) -> list[Element]:
    """Return the elements of shards 1 to N in the order they had before `Shard.select`.

    Raises ValueError for lengths that `Shard.select` cannot give.
    """
    lengths = [*map(len, shards)]
    if max(lengths) - min(lengths) > 1 or lengths != sorted(lengths, reverse=True):
        raise ValueError(f"{lengths} elements are not interleaved")
    return [shard[i] for i in range(lengths[0]) for shard in shards if i < len(shard)]


def _added(*parts: Mapping[str, Any]) -> dict[str, float]:
    """Return the sum of the seconds by stage of several manifests."""
    total = defaultdict[str, float](float)
    for part in parts:
        for stage, seconds in part.get("stage_seconds", {}).items():
            total[stage] += seconds
    return tenths(total)


def _describe(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the manifest of the whole run; refuse missing and repeated objects."""
    try:
        objects = interleave([list(part["objects"]) for part in parts])
    except ValueError as error:
        counts = ", ".join(f"{part['shard']} has {len(part['objects'])}" for part in parts)
        raise BadInput(
            f"objects: {counts}; were they made with one --limit, and of one dataset?"
        ) from error
    if doubled := [name for name, times in Counter(objects).items() if times > 1]:
        raise BadInput(f"{doubled[0]}: is in several shards; were they made of one dataset?")
    first = parts[0]
    processors = dict.fromkeys(str(part.get("machine", {}).get("cpu")) for part in parts)
    kept = {name: value for name, value in first.items() if name not in ("worker_shares", "git")}
    return kept | {
        "objects": objects,
        "planned": len(objects),
        "shard": WHOLE,
        "merged": [{name: part.get(name) for name in EACH} for part in parts],
        "machine": first.get("machine", {}) | {"cpu": "; ".join(processors)},
        "workers": max(int(part.get("workers", 1)) for part in parts),
        "stage_seconds": _added(*parts),
        "command": command_line(),
        "finished": None,
    }


def _collect(parts: Sequence[Part], objects: Sequence[str], store: Store) -> int:
    """Bring all jobs into the store, list them object by object, and count them."""
    of_all = parts[0][1]
    planned = 1 + len(of_all["methods"]) * len(of_all["conditions"])  # with the ground truth
    count = 0
    with ExitStack() as opened:
        sources: dict[str, Store] = {}
        for directory, part in parts:
            source = opened.enter_context(open_store(directory))
            sources |= dict.fromkeys(part["objects"], source)

        def jobs_of(name: str) -> list[JobRow]:
            return [*sources[name].listed(*name.split("/", 1))]

        with progress("merging, objects", len(objects)) as advance:
            for name in objects:
                listed = jobs_of(name)
                keys = {job.key for job in listed}
                if len(listed) < planned or keys - store.copy(keys, sources[name]):
                    raise BadInput(
                        f"{sources[name].path}: has not all jobs of {name} any more; run the shard "
                        "again"
                    )
                count += len(keys)
                advance(0)
        store.list_jobs((job.key, job.name) for name in objects for job in jobs_of(name))
    return count
