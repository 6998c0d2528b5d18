"""Suites against another truth: the same objects, clouds and views, with true meshes in grey.

A cloud has no colour. Against truth in colours a part of every score is luck with the lightness;
against truth in grey only the shape counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from bench.catalogue.gone import unknown
from bench.catalogue.lookup import find
from bench.catalogue.methods import find_method
from bench.catalogue.suite_types import (
    IMAGE_TABLE,
    SET_TABLE,
    TRUTHS,
    Suite,
    TableKind,
    TableSpec,
    Truth,
)
from bench.catalogue.suites import SUITES
from bench.records.run_folder import COLOURED, TRUTH

# The networks behind these were trained on images in colours.
_OF_COLOURS = {"fid", "kid", "fd-views", "kd-views", "class-confidence"}
CEILING = "true-mesh"
_IN_GREY = {"fd-views": "fd-views-grey"}
# Tables of the paper, which has no truth in grey, under names that do not number them.
_UNNUMBERED: dict[TableKind, TableSpec] = {
    "images": IMAGE_TABLE,
    "sets": SET_TABLE,
    "classes": TableSpec("classes", "table_classes", "Classes"),
}


def with_truth(suite: Suite, truth: str | None) -> Suite:
    """Return the suite with true images in colours or in grey; None leaves it as it is.

    In grey, the list of methods has none that makes up colours and those of `grey_methods`, and
    there are no metrics that need colours, none of the paper's values and no check of its
    orderings. Raises BadInput for an unknown truth.
    """
    if truth is None or truth == COLOURED:
        return suite
    if truth not in TRUTHS:
        raise unknown(truth, list(TRUTHS), "truth")
    return replace(
        suite,
        about=f"{suite.about}; here in grey",
        methods=_methods_in_grey(suite),
        set_metrics=_metrics_in_grey(suite.set_metrics),
        class_metrics=_metrics_in_grey(suite.class_metrics),
        frontier=_metrics_in_grey(suite.frontier),
        condition_sweep=_metrics_in_grey(suite.condition_sweep),
        tables=tuple(
            replace(_UNNUMBERED.get(table.kind, table), paper_layout=False)
            for table in suite.tables
            if table.kind != "orderings"
        ),
        truth="grey",
    )


def left_out_in_grey(suite: Suite) -> dict[str, str]:
    """Return the methods that the suite's default list does not have in grey, with the reasons.

    Reference methods stay, but for the grey twin of `true-mesh`.
    """
    reasons = {}
    for method in map(find_method, suite.methods):
        if method.color == "invented" and method.kind != "reference":
            reasons[method.id] = "makes up colours"
        elif method.sees_mesh and method.color == "none" and CEILING in suite.methods:
            reasons[method.id] = f"is {CEILING} in grey"
    return reasons


def _methods_in_grey(suite: Suite) -> tuple[str, ...]:
    left = left_out_in_grey(suite)
    kept = [method for method in suite.methods if method not in left]
    references = [method for method in kept if find_method(method).kind == "reference"]
    compete = [method for method in kept if method not in references]
    return tuple(dict.fromkeys((*compete, *suite.grey_methods, *references)))


def _metrics_in_grey(metrics: Sequence[str]) -> tuple[str, ...]:
    names = (_IN_GREY.get(metric, metric) for metric in metrics)
    return tuple(dict.fromkeys(name for name in names if name not in _OF_COLOURS))


def stored_suite(manifest: Mapping[str, Any]) -> Suite:
    """Return the suite of a run, with the truth of the run. Raises BadInput for unknown ones."""
    return with_truth(find(str(manifest.get("suite")), SUITES, "suite"), manifest.get(TRUTH))


def truth_entry(suite: Suite) -> dict[str, Truth]:
    """Return the entry of manifests for the truth; none for colours."""
    return {TRUTH: suite.truth} if suite.truth != COLOURED else {}
