"""The claims of the paper (Atienza 2019), each with the suite and the rule that can test it.

The claims of the paper's text are a literal table; those of its Tables 3 to 5 are made from the
values in `results/paper`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from bench.analysis.paper import AVERAGE
from bench.catalogue.metrics import higher_is_better
from bench.checking import claim_rules as rules
from bench.checking.claim_findings import ClaimFinding
from bench.tables.published import published_rows

CHAIRS, CLASSES, SPEED, LATENT = "chair-robustness", "thirteen-classes", "speed", "latent"
FEWER = ("1024", "512")
NOISY = ("noise-0.05", "noise-0.10")
AHEAD = {"surface": "SR is ahead", "network": "pc2pix is ahead", "equal": "they are equal"}


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    id        kebab-case, unique
    quoted    the paper's words, shortened
    where     section, table or figure
    measured  the measurement that tests it, and when it counts as supported
    suite     its runs test the claim; empty where no suite does
    rule      from the evidence of such a run to findings; None where no suite tests the claim
    why_not   why no suite tests it; empty otherwise
    """

    id: str
    quoted: str
    where: str
    measured: str = "-"
    suite: str = ""
    rule: Callable[[Any], list[ClaimFinding]] | None = None
    why_not: str = ""

    @property
    def family(self) -> str:
        """Return the name of the claims corrected together: those of a table, or of the text."""
        return self.where.partition(",")[0] if self.id.startswith("table-") else "text"


def claims() -> tuple[Claim, ...]:
    """Return all claims, in the order of the checklist.

    Raises BadInput where the published values are missing.
    """
    return (*PROMISES, *_printed(CHAIRS), *_printed(CLASSES), *CONCLUSIONS)


def _printed(suite: str) -> Iterator[Claim]:
    """Yield a claim for each pair SR and PC2PIX that Tables 3 to 5 print: which is ahead."""
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
            rule = partial(rules.class_ordering, class_name=class_name, ahead=ahead)
        column = f"{metric}-{place}" if table == "3" else place  # Table 3 alone has several metrics
        within = f", within {rules.EQUAL}" if ahead == "equal" else ""
        yield Claim(
            id=f"table-{table}-{column}".replace(".", ""),
            quoted=f"{label} of SR and PC2PIX: {surface}, {network}",
            where=f"Table {table}, {place}",
            measured=f"{AHEAD[ahead]} by {label}{subject}{within}",
            suite=suite,
            rule=rule,
        )


# Claims of the abstract and the introduction.
PROMISES = (
    Claim(
        "a-gan-can-render",
        "we theorize that a GAN can render point clouds",
        "section 1",
        "pc2pix is ahead of a blank image on chairs, by SSIM and by FID",
        CHAIRS,
        rules.above_blank,
    ),
    Claim(
        "higher-class-similarity",
        "renders point clouds into objects with higher class similarity with the ground truth as "
        "compared to images from surface reconstruction",
        "abstract",
        "class-confidence, mean over classes: pc2pix is ahead of SR",
        CLASSES,
        partial(rules.class_ordering, class_name=AVERAGE, ahead="network", metric=rules.CONFIDENCE),
    ),
    Claim(
        "significantly-faster",
        "pc2pix is also significantly faster",
        "abstract",
        "an image costs less than SR's, 20 of a cloud, preparing included, one thread",
        SPEED,
        partial(rules.faster, times=1.0),
    ),
    Claim(
        "nine-times-faster",
        "pc2pix is 9x faster than rendering after SR",
        "section 4",
        "the same, by a factor of more than 9",
        SPEED,
        partial(rules.faster, times=9.0),
    ),
    Claim(
        "two-hundredths-of-a-second",
        "rendered at the average of 0.02sec using pc2pix and 0.18sec after SR on a GTX 1060",
        "section 4",
        why_not="seconds on one graphics card of 2016; the suite speed compares the two approaches",
    ),
    Claim(
        "sr-degrades-with-fewer-points",
        "rendering after SR degrades with down sampling",
        "section 1, Figure 1",
        "SSIM of SR on chairs is lower at 1024 and 512 than at 2048",
        CHAIRS,
        partial(rules.degrades, metric="ssim", conditions=FEWER),
    ),
    Claim(
        "sr-degrades-with-noise",
        "rendering after SR degrades with ... noise",
        "section 1, Figure 1",
        "SSIM of SR on chairs is lower at noise 0.05 and 0.10 than without",
        CHAIRS,
        partial(rules.degrades, metric="ssim", conditions=NOISY),
    ),
    Claim(
        "operates-on-fewer-points",
        "can operate on a lower number of points",
        "abstract, Table 3",
        f"SSIM lost at 1024 and 512 is less than {rules.SHARE:.0%} of what SR loses",
        CHAIRS,
        partial(rules.steady, metric="ssim", conditions=FEWER),
    ),
    Claim(
        "robust-to-noise",
        "more robust to noise",
        "abstract, Table 3 (up to 0.10)",
        f"SSIM lost at noise 0.05 and 0.10 is less than {rules.SHARE:.0%} of what SR loses",
        CHAIRS,
        partial(rules.steady, metric="ssim", conditions=NOISY),
    ),
    Claim(
        "structure-is-kept",
        "SSIM structure component ... pc2pix remains robust against down sampling and presence "
        "of noise",
        "section 4.1, Table 3",
        f"structure lost at each condition is less than {rules.SHARE:.0%} of what SR loses",
        CHAIRS,
        partial(rules.steady, metric="structure", conditions=(*FEWER, *NOISY)),
    ),
    Claim(
        "fid-is-kept",
        "similar to its qualitative performance, pc2pix is robust against down sampling and noise",
        "section 4.1, Table 4",
        f"FID gained at each condition is less than {rules.SHARE:.0%} of what SR gains",
        CHAIRS,
        partial(rules.steady, metric="fid", conditions=(*FEWER, *NOISY)),
    ),
    Claim(
        "often-not-recognizable",
        "many instances wherein the rendered images after SR are not recognizable",
        "section 4.1, Figure 3",
        "class-confidence, mean over classes: SR is below true images",
        CLASSES,
        rules.unrecognisable,
    ),
)

# Conclusions of section 4.2, and claims about the space of codes.
CONCLUSIONS = (
    Claim(
        "rifle-is-no-difference",
        "on rifle, the small difference on FID may be considered not significant",
        "section 4.2",
        "the interval of the difference holds 0",
        CLASSES,
        partial(rules.class_ordering, class_name="rifle", ahead="undecided"),
    ),
    Claim(
        "chairs-gain-from-other-classes",
        "for the case of chair object, the FID has 2.7 improvement when all 13 classes were used",
        "section 4.2",
        "FID of chairs: the network of all classes is ahead of that of chairs alone",
        CLASSES,
        partial(rules.gains_from_others, alone="pc2pix", together="pc2pix@all"),
    ),
    Claim(
        "lamps-vary-more-than-cars",
        "significant design variations in the lamp objects; cars have very little intricate "
        "design variations",
        "section 4.2",
        "variance of the fd-views features between true lamps is larger than between true cars "
        "(on the procedural set this is a fact about the set, not about ShapeNet)",
        CLASSES,
        partial(rules.varies_more, more="lamp", less="car"),
    ),
    Claim(
        "sr-is-good-where-points-are-dense",
        "SR can generate good quality images whenever the point clouds are dense: airplane, "
        "rifle, and lamp",
        "section 4.2",
        "mean FID of SR over these three is lower than over the other classes",
        CLASSES,
        partial(rules.good_where_thin, thin=("airplane", "rifle", "lamp")),
    ),
    Claim(
        "more-data-helps",
        "pc2pix outputs improve with quantity of the training data",
        "section 4.2",
        why_not="no run of a suite; docs/thirteen-classes.md has trainings that do",
    ),
    Claim(
        "imbalance-hurts",
        "it suffers when there is dataset imbalance",
        "section 4.2",
        why_not="no run of a suite; docs/thirteen-classes.md has trainings that do",
    ),
    Claim(
        "colours-are-predicted",
        "even the regularity in the pattern of color is predicted correctly: cars have uniform "
        "body color, tinted windows and windshields, and black tires",
        "section 4.2, Figure 4",
        why_not="no metric looks at colour alone; look at figures/classes.png",
    ),
    Claim(
        "better-visual-quality",
        "a much better visual quality in terms of smoothness and texture",
        "sections 1 and 4.2, Figures 3 and 4",
        why_not="nobody was asked; FID is the paper's own stand-in, see Tables 4 and 5",
    ),
    Claim(
        "better-than-points2pix",
        "built on the better performing ACGAN; the generator produces images with higher scores",
        "section 1",
        why_not="our points2pix has other inputs and data, not only no ACGAN: docs/studies.md",
    ),
    # the space of codes
    Claim(
        "interpolations-are-meaningful",
        "for each point cloud interpolation, pc2pix renders a meaningful image of a chair",
        "section 4.2, Figure 5",
        "the classifier is surer of some structural family than in a cross-fade of the ends",
        LATENT,
        partial(rules.mean_above, metric="family-confidence", what="code", than="cross-fade"),
    ),
    Claim(
        "interpolation-between-classes",
        "between two different objects ... morph from sofa to car",
        "section 4.2, Figure 5",
        why_not="the suite latent walks between chairs, whose descriptions it needs",
    ),
    Claim(
        "arithmetic-adds-features",
        "subtracting two codes and adding to a third results into another meaningful point cloud "
        "with some features added or removed",
        "section 4.2, Figure 6",
        "A - B + C is nearer to the right answer than C is",
        LATENT,
        partial(rules.mean_above, metric="cloud-gain", what="a-b+c"),
    ),
    Claim(
        "arithmetic-finds-the-unseen",
        "new point cloud configurations that have not been observed before",
        "section 1",
        "A - B + C is nearer to the right answer than the train chair nearest to it is",
        LATENT,
        partial(rules.mean_above, metric="cloud-gain", what="a-b+c", than="nearest-train"),
    ),
)
