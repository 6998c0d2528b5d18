"""The receipt of a run: at most 4 kB of JSON by which others verify the run.

A receipt is a function of what was measured and of the results alone: it has no times, no paths and
no number of workers, so that two runs of one request in one environment have the same receipt.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from bench.catalogue.lookup import find
from bench.catalogue.suites import PROCEDURES, SUITES
from bench.checking.objects import environment_of
from bench.receipts.digests import digest_folder, digest_inputs
from bench.records.record import SCHEMA_VERSION
from bench.records.run_folder import PROTOCOL, SHARD, TRUTH, read_finished
from bench.running.options import REPEATED, Options
from bench.running.protocol import name_of, objects_of
from bench.running.shards import read_shard
from data_prep.datasets.objects import SceneObject
from data_prep.datasets.protocol_version import refuse_other_version
from data_prep.datasets.registry import open_dataset
from data_prep.failures import BadInput
from data_prep.files.safe_read import read_file

FORMAT = 1
MOST_BYTES = 4096
PACKAGE = "pc2pix-bench"
DIGEST = "digest"  # of the rest of the receipt
CHECKSUM = re.compile(r"\b[0-9a-f]{64}\b")
TEXTS: dict[str, Any] = {"*": str}  # a mapping from any name to a text
SHAPE: dict[str, Any] = {  # of a receipt: the type of each entry
    "code": {"version": str, "commit": str, "clean": bool, "sha256": str},
    DIGEST: str,
    "environment": TEXTS,
    "format": int,
    "inputs": {"objects": int, "sha256": str},
    "jobs": {"count": int, "parts": str, "sha256": str},
    "metrics": TEXTS,
    PROTOCOL: int,
    "records": str,
    "request": {
        **dict.fromkeys(("suite", "dataset", "device"), str),
        "methods": [str],
        "conditions": [str],
        **dict.fromkeys(("views", "seed"), int),
    },
    "schema": int,
    "tables": TEXTS,
    "weights": TEXTS,
}
CHOSEN: dict[str, Any] = {
    TRUTH: str,
    SHARD: str,
    "limit": int,
    "metrics": [str],
}  # in some requests


def make_receipt(directory: Path) -> dict[str, Any]:
    """Return the receipt of a finished run.

    Raises
    ------
    BadInput
        Where there is no finished run, or one without jobs; where images, records or tables are
        missing or altered; where a request cannot choose its objects; and where the receipt would
        be longer than `MOST_BYTES`.
    """
    manifest = read_finished(directory)
    receipt = describe_manifest(directory, manifest)
    objects = find_objects(receipt["request"])
    if [name_of(obj) for obj in objects] != manifest["objects"]:
        raise BadInput(
            f"{directory}: the {len(manifest['objects'])} objects of the run are not the "
            f"{len(objects)} that its request chooses now; finish it with its command, or bring "
            "its dataset back as it was"
        )
    folder = digest_folder(directory, manifest)
    if folder.problems:
        raise BadInput(f"{directory}: {folder.problems[0]}; start the run again with its command")
    request = receipt["request"]
    receipt |= folder.entries | {
        "inputs": digest_inputs(objects, request["views"], request["seed"])
    }
    return _shortened(directory, receipt)


def describe_manifest(directory: Path, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a receipt that the manifest gives.

    Raises BadInput for a run without jobs, and for a manifest that is damaged or of an earlier
    version.
    """
    if manifest["suite"] in [suite.id for suite in PROCEDURES]:
        raise BadInput(
            f"{directory}: a run of {manifest['suite']} has no jobs that could be computed again; "
            "give one of a suite with records"
        )
    needed = ("request", "code", "methods", "conditions", "objects", "identities")
    if lacking := [name for name in needed if not manifest.get(name)]:
        raise BadInput(
            f"{directory}: no {', '.join(lacking)} in its manifest, as in an earlier version; "
            "start the run again with its command, which keeps its jobs"
        )
    try:
        git = manifest.get("git") or {}
        return {
            "format": FORMAT,
            "schema": manifest["schema_version"],
            PROTOCOL: manifest[PROTOCOL],
            "request": _pinned(manifest),
            "code": {
                "version": manifest["versions"][PACKAGE],
                "commit": git.get("commit", ""),
                "clean": bool(git.get("clean", True)),
                "sha256": manifest["code"],
            },
            "weights": weights_of({m: i[1] for m, i in manifest["identities"].items()}),
            "metrics": weights_of(manifest["feature_identity"]),
            "environment": environment_with_python(manifest),
        }
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise BadInput(
            f"{directory}: its manifest is damaged ({type(error).__name__}: {error}); bring back a "
            "copy"
        ) from error


def environment_with_python(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return what the last digits of results depend on beside code and weights."""
    identities = {
        name: [
            CHECKSUM.sub("", str(part)) for part in identity
        ]  # weights have entries of their own
        for name, identity in {
            **manifest["identities"],
            **{f"metric {name}": [text] for name, text in manifest["feature_identity"].items()},
        }.items()
    }
    return environment_of(manifest) | {
        "python": str(manifest["versions"].get("python")),
        "identities": sha256(to_text(identities).encode()).hexdigest(),
    }


def weights_of(identities: Mapping[str, str]) -> dict[str, str]:
    """Return a checksum of the weights that each identity names; none for one without weights."""
    sums = {name: CHECKSUM.findall(identity) for name, identity in identities.items()}
    # A method may have the weights of several networks.
    return {
        name: parts[0] if len(parts) == 1 else sha256(" ".join(parts).encode()).hexdigest()
        for name, parts in sums.items()
        if parts
    }


def _pinned(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the request that makes the run again, with nothing left to defaults."""
    request = {name: value for name, value in manifest["request"].items() if name in REPEATED}
    pinned = request | {name: manifest[name] for name in ("methods", "conditions", "views", "seed")}
    # A path of this machine means nothing elsewhere, and the weights have their checksum.
    pinned.pop("inception_weights", None)
    if manifest.get(TRUTH):
        pinned[TRUTH] = manifest[TRUTH]
    if manifest.get(SHARD):
        return pinned | {SHARD: manifest[SHARD]}
    classes = Counter(name.partition("/")[0] for name in manifest["objects"])
    return pinned | {"limit": max(classes.values())}


def options_of(request: Mapping[str, Any], dataset: str | None = None) -> Options:
    """Return the options of a receipt's request; `dataset` says where its dataset lies here."""
    given = {name: value for name, value in request.items() if name != SHARD}
    given |= {name: tuple(value) for name, value in given.items() if isinstance(value, list)}
    if dataset is not None:
        given["dataset"] = dataset
    shard = read_shard(request[SHARD]) if SHARD in request else None
    return Options(**given, shard=shard)


def find_objects(request: Mapping[str, Any]) -> tuple[SceneObject, ...]:
    """Return the objects that a receipt's request chooses."""
    options = options_of(request)
    suite = find(options.suite, SUITES, "suite")
    return objects_of(suite, open_dataset(options.dataset), options)


def _shortened(directory: Path, receipt: dict[str, Any]) -> dict[str, Any]:
    """Return the receipt with its digest, with one digest for a list of many where it is long."""
    signed = with_digest(receipt)
    for name in ("weights", "tables"):
        if len(to_text(signed)) <= MOST_BYTES:
            break
        receipt |= {name: condensed(receipt[name])}
        signed = with_digest(receipt)
    if (size := len(to_text(signed))) > MOST_BYTES:
        raise BadInput(
            f"{directory}: its receipt would have {size} bytes, and the most are {MOST_BYTES}; run "
            "fewer methods"
        )
    return signed


def condensed(sums: Mapping[str, str]) -> dict[str, str]:
    """Return one digest, under the name "all", in place of a checksum for each name."""
    return {"all": sha256(to_text(sums).encode()).hexdigest()}


def with_digest(receipt: Mapping[str, Any]) -> dict[str, Any]:
    """Return the receipt with the digest of its other entries."""
    rest = {name: value for name, value in receipt.items() if name != DIGEST}
    return rest | {DIGEST: sha256(to_text(rest).encode()).hexdigest()}


def to_text(receipt: Mapping[str, Any]) -> str:
    """Return the one text, in ASCII, that a receipt has."""
    return json.dumps(receipt, sort_keys=True, indent=1, allow_nan=False) + "\n"


def read_receipt(path: Path) -> dict[str, Any]:
    """Return the receipt in a file.

    Raises BadInput for a file that is none, a garbled one, and one of another format, protocol or
    schema.
    """
    data = read_file(path, MOST_BYTES)
    try:
        receipt = json.loads(data)
        text = to_text(receipt)
        format_, protocol, digest, _ = (receipt[n] for n in ("format", PROTOCOL, DIGEST, "request"))
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise BadInput(f"{path}: no receipt; give what 'bench receipt DIR' prints") from error
    if text.encode() != data or with_digest(receipt)[DIGEST] != digest:
        raise BadInput(f"{path}: garbled, its digest is another; fetch the receipt again")
    if format_ != FORMAT:
        raise BadInput(
            f"{path}: of format {format_!r}, this version reads {FORMAT}; use the version that "
            "made it"
        )
    refuse_other_version(path, protocol, "ask for a receipt of a run of this version")
    if problem := _problem_of(receipt):
        raise BadInput(f"{path}: {problem}; use the version that made it")
    return receipt


def _problem_of(receipt: Mapping[str, Any]) -> str:
    """Return why a receipt whose digest is right cannot be used; empty if it can."""
    request = receipt["request"] if isinstance(receipt["request"], dict) else {}
    chosen = {name: shape for name, shape in CHOSEN.items() if name in request}
    if not _fits(receipt, SHAPE | {"request": SHAPE["request"] | chosen}):
        return "its entries are not those of a receipt"
    if receipt["schema"] != SCHEMA_VERSION:
        return f"of schema {receipt['schema']}, this version has {SCHEMA_VERSION}"
    made_by, here = receipt["code"]["version"], version(PACKAGE)
    if made_by.partition(".")[0] != here.partition(".")[0]:
        return f"of {PACKAGE} {made_by}, this is {here}"
    return ""


def _fits(value: object, shape: Any) -> bool:
    """Return whether a value of JSON has a shape."""
    if isinstance(shape, list):
        return isinstance(value, list) and all(_fits(part, shape[0]) for part in value)
    if not isinstance(shape, dict):
        return type(value) is shape
    if not isinstance(value, dict):
        return False
    if shape is TEXTS:
        return all(isinstance(text, str) for text in value.values())
    return value.keys() == shape.keys() and all(_fits(value[name], shape[name]) for name in shape)
