"""The metadata of an exported dataset in Croissant 1.0 (docs.mlcommons.org/croissant)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.catalogue.suite_types import TRUTHS
from bench.records.run_folder import COLOURED
from bench.running.protocol import Protocol
from data_prep.datasets.exported import CLOUDS, COLUMNS, OBJECTS, VIEWS
from data_prep.datasets.protocol_version import PROTOCOL_VERSION

PAPER = (
    "https://openaccess.thecvf.com/content_CVPRW_2019/papers/3D-WidDGET/"
    "Atienza_A_Conditional_Generative_Adversarial_Network_for_Rendering_Point_Clouds_"
    "CVPRW_2019_paper.pdf"
)
CONTEXT = Path(__file__).with_name("croissant_context.json")  # of the specification
_ABOUT = {
    OBJECTS: "The objects and their meshes.",
    CLOUDS: "The clouds that methods get: float32 coordinates in the unit sphere, +Y up, front -Z.",
    VIEWS: "True images, 128 x 128 RGB on white, with azimuth and elevation in degrees.",
}
_TYPES = {
    "protocol": "sc:Integer",
    "seed": "sc:Integer",
    "points": "sc:Integer",
    "view": "sc:Integer",
    "azimuth_deg": "sc:Float",
    "elevation_deg": "sc:Float",
}


def metadata(
    protocol: Protocol, lists: Mapping[str, str], checksum: str, published: str
) -> dict[str, Any]:
    """Return the JSON-LD of an export.

    `lists` are its CSV files with their checksums, `checksum` is that of what methods see of it
    (`data_prep.datasets.exported.checksum_of`), `published` the date as in 2026-01-31.
    """
    suite = protocol.suite.id + f"-truth-{protocol.suite.truth}" * (
        protocol.suite.truth != COLOURED
    )
    described = {
        "@context": json.loads(CONTEXT.read_text(encoding="utf-8")),
        "@type": "sc:Dataset",
        "name": f"pc2pix-bench-{suite}",
        "description": (
            f"Inputs of the benchmark pc2pix-bench, suite {protocol.suite.id} with images of "
            f"{TRUTHS[protocol.suite.truth]}, protocol {PROTOCOL_VERSION}: "
            f"{len(protocol.objects)} objects of {protocol.dataset}, seed {protocol.seed}, "
            f"{protocol.views} views each, conditions {', '.join(protocol.conditions)}. Paths and "
            "checksums of all files are in the lists."
        ),
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "version": f"{PROTOCOL_VERSION}.0.0",
        "identifier": checksum,
        "datePublished": published,
        "url": PAPER,
        "citeAs": "The pc2pix-bench developers: pc2pix-bench (CITATION.cff)",
    }
    if protocol.dataset.startswith("procedural"):
        described["license"] = "https://spdx.org/licenses/MIT.html"
    return described | {
        "distribution": [_list_file(name, checksum) for name, checksum in lists.items()],
        "recordSet": [_records(name) for name in lists],
    }


def _list_file(name: str, checksum: str) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "description": _ABOUT[name],
        "contentUrl": name,
        "encodingFormat": "text/csv",
        "sha256": checksum,
    }


def _records(name: str) -> dict[str, Any]:
    title = name.removesuffix(".csv")
    return {
        "@type": "cr:RecordSet",
        "@id": title,
        "name": title,
        "description": _ABOUT[name],
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{title}/{column}",
                "name": column,
                "dataType": _TYPES.get(column, "sc:Text"),
                "source": {"fileObject": {"@id": name}, "extract": {"column": column}},
            }
            for column in COLUMNS[name]
        ],
    }
