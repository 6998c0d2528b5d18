"""The manifest of a run that is about to start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bench.catalogue.claims import manifest_entry
from bench.catalogue.conditions import condition_ids, find_condition
from bench.catalogue.methods import objectives
from bench.catalogue.truth import truth_entry
from bench.records.record import SCHEMA_VERSION
from bench.records.run_folder import CONDITION_IDENTITIES, PROTOCOL
from bench.running.environment import machine_info
from bench.running.options import Options
from bench.running.protocol import Protocol, method_identity, name_of
from bench.running.shards import WHOLE
from data_prep.datasets.protocol_version import PROTOCOL_VERSION


def describe(
    protocol: Protocol, workers: int, skipped_metrics: Mapping[str, str]
) -> dict[str, Any]:
    """Return the manifest of a run of a suite of jobs."""
    return manifest_of(
        protocol,
        protocol.suite.id,
        protocol.views,
        protocol.environment,
        shard=str(protocol.shard) if protocol.shard else WHOLE,
        methods=list(protocol.methods),
        identities={
            id_: method_identity(m, protocol.device) for id_, m in protocol.methods.items()
        },
        objectives=objectives(protocol.methods.values()),
        **manifest_entry(
            {
                id_: (m.images.root, m.images.claims)
                for id_, m in protocol.methods.items()
                if m.images
            }
        ),
        **truth_entry(protocol.suite),
        conditions=list(protocol.conditions),
        **_condition_identities(protocol),
        objects=[name_of(obj) for obj in protocol.objects],
        skipped_metrics=dict(skipped_metrics),
        feature_identity=dict(protocol.feature_identity),
        workers=workers,
    )


def _condition_identities(protocol: Protocol) -> dict[str, dict[str, str]]:
    """Return the entry for what clouds of other packages' conditions depend on; none without."""
    others = [name for name in protocol.conditions if name in condition_ids()]
    keys = {name: find_condition(name).key for name in others}
    return {CONDITION_IDENTITIES: keys} if keys else {}


def manifest_of(
    request: Protocol | Options,
    suite: str,
    views: int,
    environment: Mapping[str, str],
    **entries: object,
) -> dict[str, Any]:
    """Return the manifest of a run of any suite; `entries` are those of this kind of suite."""
    repeated = {"request": request.request} if isinstance(request, Options) else {}
    return {
        "schema_version": SCHEMA_VERSION,
        PROTOCOL: PROTOCOL_VERSION,
        **repeated,
        "suite": suite,
        "dataset": request.dataset,
        "views": views,
        "seed": request.seed or 0,
        "device": request.device,
        **entries,
        "environment": dict(environment),
    } | machine_info()
