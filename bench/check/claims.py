"""The claims of the paper (Atienza 2019), each with the suite and the rule that can test it.

The claims of the paper's text are the lines of `claims.csv`. The claims of its Tables 3 to 5, one
for each pair of values, are made here from the values in `results/paper`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from bench.analysis.paper import AVERAGE, SURFACE
from bench.catalogue.metrics import higher_is_better
from bench.check import rules
from bench.check.rules import ClaimFinding
from bench.tables.paper import published_rows

CHAIRS, CLASSES, SPEED, LATENT = "chair-robustness", "thirteen-classes", "speed", "latent"
FEWER = ("1024", "512")  # the conditions with fewer points
NOISY = ("noise-0.05", "noise-0.10")  # the conditions with noise
AHEAD = {"surface": "SR is ahead", "network": "pc2pix is ahead", "equal": "they are equal"}
# The id of the first claim of the paper's conclusions. The claims of the tables stand before it.
_CONCLUSIONS = "rifle-is-no-difference"

_Rule = Callable[[Any], list[ClaimFinding]]


@dataclass(frozen=True)
class Claim:
    """A claim of the paper."""

    id: str  # kebab-case, unique
    quoted: str  # the paper's words, shortened
    where: str  # the section, table or figure of the paper that has the claim
    suite: str  # the suite whose runs test the claim; empty where no suite does
    criterion: str  # what is measured, and when the claim counts as supported
    why_not: str = ""  # the reason why no suite tests the claim
    rule: _Rule | None = None  # the function that tests the claim: from evidence to findings

    @property
    def family(self) -> str:
        """Return the family: "text", or the table of the paper that the claim is in.

        Verdicts are corrected for the number of claims of a family.
        """
        return self.where.partition(",")[0] if self.id.startswith("table-") else "text"


# Claims about thirteen classes are tested on the mean over classes, for the first network of a run.
_of_classes = partial(rules.ordering, class_name=AVERAGE, most=1)
# The rule that tests each claim of the paper's text, by the id of the claim in claims.csv.
RULES: Mapping[str, _Rule] = {
    "a-gan-can-render": rules.above_blank,
    "higher-class-similarity": partial(_of_classes, metric=rules.CONFIDENCE, ahead="network"),
    "significantly-faster": partial(rules.faster, times=1.0),
    "nine-times-faster": partial(rules.faster, times=9.0),
    "sr-degrades-with-fewer-points": partial(rules.degrades, metric="ssim", conditions=FEWER),
    "sr-degrades-with-noise": partial(rules.degrades, metric="ssim", conditions=NOISY),
    "operates-on-fewer-points": partial(rules.steady, metric="ssim", conditions=FEWER),
    "robust-to-noise": partial(rules.steady, metric="ssim", conditions=NOISY),
    "structure-is-kept": partial(rules.steady, metric="structure", conditions=(*FEWER, *NOISY)),
    "fid-is-kept": partial(rules.steady, metric="fid", conditions=(*FEWER, *NOISY)),
    "often-not-recognizable": partial(
        _of_classes, metric=rules.CONFIDENCE, subject=SURFACE, other="true-mesh", ahead="surface"
    ),
    "rifle-is-no-difference": partial(_of_classes, class_name="rifle", ahead="undecided"),
    "chairs-gain-from-other-classes": partial(
        rules.ordering, subject="pc2pix@all", other="pc2pix", ahead="network"
    ),
    "interpolations-are-meaningful": partial(
        rules.mean_above, metric="family-confidence", what="code", than="cross-fade"
    ),
    "arithmetic-adds-features": partial(rules.mean_above, metric="cloud-gain", what="a-b+c"),
    "arithmetic-finds-the-unseen": partial(
        rules.mean_above, metric="cloud-gain", what="a-b+c", than="nearest-train"
    ),
}


def claims() -> tuple[Claim, ...]:
    """Return all claims, in the order of the checklist.

    Raises BadInput where the published values are missing.
    """
    rows = pd.read_csv(Path(__file__).with_suffix(".csv"), dtype=str, keep_default_na=False)
    text_claims = []
    for row in rows.to_dict("records"):
        fields = {str(name): text.format(share=f"{rules.SHARE:.0%}") for name, text in row.items()}
        text_claims.append(Claim(**fields, rule=RULES.get(fields["id"])))
    first = [claim.id for claim in text_claims].index(_CONCLUSIONS)
    return (
        *text_claims[:first],
        *_table_claims(CHAIRS),
        *_table_claims(CLASSES),
        *text_claims[first:],
    )


def _table_claims(suite: str) -> Iterator[Claim]:
    """Yield the claims of the paper's tables that a suite tests: Tables 3 and 4, or Table 5.

    Such a claim says which of two printed values is better, that of SR or that of PC2PIX.
    """
    rows = published_rows(suite)
    for keys, pair in rows.groupby(["table", "class", "metric", "condition"], sort=False):
        table, class_name, metric, condition = map(str, keys)
        surface, network = pair["value"]
        ahead: rules.Ahead = "equal"
        if surface != network:
            higher = float(network) > float(surface)
            ahead = "network" if higher == higher_is_better(metric) else "surface"
        label = "FID" if metric == "fid" else metric
        if suite == CHAIRS:
            place, subject = condition, " on chairs"
            rule = partial(rules.ordering, metric=metric, condition=condition, ahead=ahead)
        else:
            place, subject = class_name, ""
            rule = partial(_of_classes, class_name=class_name, ahead=ahead)
        # Only Table 3 has several metrics.
        column = f"{metric}-{place}" if table == "3" else place
        within = f", within {rules.EQUAL}" if ahead == "equal" else ""
        yield Claim(
            id=f"table-{table}-{column}".replace(".", ""),
            quoted=f"{label} of SR and PC2PIX: {surface}, {network}",
            where=f"Table {table}, {place}",
            suite=suite,
            criterion=f"{AHEAD[ahead]} by {label}{subject}{within}",
            rule=rule,
        )
