"""`bench list`: suites, methods, conditions, metrics and datasets by their ids."""

from __future__ import annotations


def list_all() -> None:
    """List suites, methods and their variants, conditions, metrics and datasets."""
    from bench.catalogue.methods import COST_VARIANTS, METHODS, plugin_ids
    from bench.catalogue.metrics import (
        CONTROL_METRICS,
        IMAGE_METRICS,
        KERNEL_METRICS,
        RECOGNITION_METRICS,
        SET_METRICS,
    )
    from bench.catalogue.parameters import PARAMETERS
    from bench.catalogue.plugins import metric_ids
    from bench.catalogue.suites import ALL_SUITES
    from data_prep.clouds.conditions import CONDITIONS
    from data_prep.plugins import DATASETS, entry_point_names

    sections = {
        "suites": [(s.id, s.about) for s in ALL_SUITES],
        "methods": [
            *((m.id, m.source) for m in METHODS),
            *((id_, _of_package("method", id_)) for id_ in plugin_ids()),
        ],
        "variants": [
            *((f"{k.method}@{k.name}=", f"{k.low:g} to {k.high:g}: {k.about}") for k in PARAMETERS),
            *((m.id, m.source) for m in COST_VARIANTS),
        ],
        "conditions": [(c.id, c.source) for c in CONDITIONS],
        "metrics": [
            *IMAGE_METRICS.items(),
            *((m.id, m.about) for m in SET_METRICS),
            *((name, about) for name, (_, about) in KERNEL_METRICS.items()),
            *RECOGNITION_METRICS.items(),
            *CONTROL_METRICS.items(),
            *((id_, _of_package("metric", id_, "; see 'bench score'")) for id_ in metric_ids()),
        ],
        "datasets": [
            ("procedural", "parametric shapes, without a download (the default); test split"),
            ("procedural:validation", "parametric shapes, the split for making choices"),
            (
                "procedural:sealed",
                "parametric shapes, the split for final numbers: choose nothing by it",
            ),
            ("procedural:novel-families", "chairs of structures that no other split has"),
            ("procedural:widened", "for training: shapes that vary more than their classes do"),
            ("folder:PATH", "your meshes; sub-folders are classes"),
            ("shapenet:PATH", "ShapeNetCore v1 or v2, split by all.csv if it has that file"),
            ("modelnet:PATH", "ModelNet10 or 40, split by folders or by lists"),
            ("exported:PATH", "a folder of 'bench data export': clouds, views and true images"),
            (
                "paper:PATH",
                "clouds, 20 images of each and their cameras, as the paper's code has them",
            ),
            *((f"{id_}:PATH", _of_package("dataset", id_)) for id_ in entry_point_names(DATASETS)),
        ],
    }
    for title, entries in sections.items():
        print(f"{title}:")
        for name, about in entries:
            print(f"  {name:<25} {about}")


def _of_package(kind: str, id_: str, use: str = "") -> str:
    from bench.catalogue.plugins import plugin_problem

    problem = plugin_problem(kind, id_)
    return f"refused: {problem}" if problem else f"of another installed package{use}"
