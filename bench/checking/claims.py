"""The claims of the paper (Atienza 2019) that can be put to a test, as a literal table.

Each has a short quotation, where it stands, what is measured here, and the suite whose run can
tell. A claim without a rule cannot be tested by what is here, and says why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from bench.checking import claim_rules as rules
from bench.checking.claim_rules import Finding

CHAIRS, CLASSES, SPEED, LATENT = "chair-robustness", "thirteen-classes", "speed", "latent"
FEWER = ("1024", "512")
NOISY = ("noise-0.05", "noise-0.10")


@dataclass(frozen=True)
class Claim:
    """One claim.

    id        kebab-case, unique
    quoted    the paper's words, shortened
    where     section, table or figure
    measured  what is held against it, and when it counts as supported
    suite     whose run can tell; empty where none can
    rule      evidence of such a run -> findings; None where nothing here can tell
    why_not   why nothing can; empty otherwise
    """

    id: str
    quoted: str
    where: str
    measured: str
    suite: str = ""
    rule: Callable[[Any], list[Finding]] | None = None
    why_not: str = ""


def _table_3(metric: str, condition: str, ahead: rules.Ahead, printed: str) -> Claim:
    """A pair of columns in Table 3; `printed` is SR and PC2PIX."""
    words = {"surface": "SR is ahead", "network": "pc2pix is ahead", "equal": "they are equal"}
    return Claim(
        id=f"table-3-{metric}-{condition.replace('.', '')}",
        quoted=f"{metric} of SR and PC2PIX: {printed}",
        where=f"Table 3, {condition}",
        measured=f"{words[ahead]} by {metric} on chairs"
        + (f", within {rules.EQUAL}" if ahead == "equal" else ""),
        suite=CHAIRS,
        rule=partial(rules.ordering, metric=metric, condition=condition, ahead=ahead),
    )


def _table_4(condition: str, printed: str) -> Claim:
    return Claim(
        id=f"table-4-{condition.replace('.', '')}",
        quoted=f"FID of SR and PC2PIX: {printed}",
        where=f"Table 4, {condition}",
        measured="pc2pix is ahead by FID on chairs",
        suite=CHAIRS,
        rule=partial(rules.ordering, metric="fid", condition=condition, ahead="network"),
    )


def _table_5(class_name: str, ahead: rules.Ahead, printed: str) -> Claim:
    return Claim(
        id=f"table-5-{class_name}",
        quoted=f"FID of SR and PC2PIX: {printed}",
        where=f"Table 5, {class_name}",
        measured=f"{'SR' if ahead == 'surface' else 'pc2pix'} is ahead by FID",
        suite=CLASSES,
        rule=partial(rules.class_ordering, class_name=class_name, ahead=ahead),
    )


CLAIMS = (
    # what the abstract and the introduction promise
    Claim(
        "a-gan-can-render",
        "we theorize that a GAN can render point clouds",
        "section 1",
        "pc2pix is ahead of a blank picture on chairs, by SSIM and by FID",
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
        rules.more_similar_class,
    ),
    Claim(
        "significantly-faster",
        "pc2pix is also significantly faster",
        "abstract",
        "a picture costs less than SR's, 20 of a cloud, preparing included, one thread",
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
        "-",
        why_not="seconds on one graphics card of 2016; the suite speed compares the two roads",
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
        "class-confidence, mean over classes: SR is below true pictures",
        CLASSES,
        rules.unrecognisable,
    ),
    # Table 3, as printed
    _table_3("ssim", "2048", "surface", "0.70, 0.64"),
    _table_3("ssim", "1024", "surface", "0.67, 0.64"),
    _table_3("ssim", "512", "network", "0.63, 0.64"),
    _table_3("ssim", "noise-0.05", "network", "0.46, 0.63"),
    _table_3("ssim", "noise-0.10", "network", "0.30, 0.63"),
    _table_3("luminance", "2048", "surface", "0.95, 0.94"),
    _table_3("luminance", "1024", "surface", "0.95, 0.94"),
    _table_3("luminance", "512", "equal", "0.94, 0.94"),
    _table_3("luminance", "noise-0.05", "network", "0.92, 0.94"),
    _table_3("luminance", "noise-0.10", "network", "0.88, 0.94"),
    _table_3("contrast", "2048", "surface", "0.87, 0.79"),
    _table_3("contrast", "1024", "surface", "0.85, 0.79"),
    _table_3("contrast", "512", "surface", "0.82, 0.79"),
    _table_3("contrast", "noise-0.05", "network", "0.69, 0.79"),
    _table_3("contrast", "noise-0.10", "network", "0.53, 0.79"),
    _table_3("structure", "2048", "equal", "0.77, 0.77"),
    _table_3("structure", "1024", "network", "0.75, 0.77"),
    _table_3("structure", "512", "network", "0.73, 0.78"),
    _table_3("structure", "noise-0.05", "network", "0.65, 0.77"),
    _table_3("structure", "noise-0.10", "network", "0.65, 0.77"),
    # Table 4
    _table_4("2048", "94.0, 31.5"),
    _table_4("1024", "133.6, 34.0"),
    _table_4("512", "183.8, 36.7"),
    _table_4("noise-0.05", "293.0, 33.0"),
    _table_4("noise-0.10", "294.2, 39.0"),
    # Table 5
    _table_5("airplane", "network", "54.6, 13.6"),
    _table_5("bench", "network", "93.0, 43.6"),
    _table_5("cabinet", "network", "188.8, 57.9"),
    _table_5("car", "network", "203.1, 40.0"),
    _table_5("chair", "network", "94.0, 28.8"),
    _table_5("display", "network", "148.4, 121.7"),
    _table_5("lamp", "surface", "51.6, 112.1"),
    _table_5("loudspeaker", "network", "193.6, 78.2"),
    _table_5("rifle", "surface", "26.3, 29.0"),
    _table_5("sofa", "network", "135.6, 41.8"),
    _table_5("table", "network", "127.2, 39.7"),
    _table_5("telephone", "network", "103.7, 94.4"),
    _table_5("vessel", "network", "67.4, 43.0"),
    _table_5("average", "network", "114.4, 57.2"),
    # what section 4.2 makes of it
    Claim(
        "rifle-is-no-difference",
        "on rifle, the small difference on FID may be considered not significant",
        "section 4.2",
        "the interval of the difference holds 0",
        CLASSES,
        partial(rules.insignificant, class_name="rifle"),
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
        "-",
        why_not="no run of a suite; the benchmark class_data does, see docs/thirteen-classes.md",
    ),
    Claim(
        "imbalance-hurts",
        "it suffers when there is dataset imbalance",
        "section 4.2",
        "-",
        why_not="no run of a suite; the benchmark class_data does, see docs/thirteen-classes.md",
    ),
    Claim(
        "colours-are-predicted",
        "even the regularity in the pattern of color is predicted correctly: cars have uniform "
        "body color, tinted windows and windshields, and black tires",
        "section 4.2, Figure 4",
        "-",
        why_not="no metric looks at colour alone; look at figures/classes.png",
    ),
    Claim(
        "better-visual-quality",
        "a much better visual quality in terms of smoothness and texture",
        "sections 1 and 4.2, Figures 3 and 4",
        "-",
        why_not="nobody was asked; FID is the paper's own stand-in, see Tables 4 and 5",
    ),
    Claim(
        "better-than-points2pix",
        "built on the better performing ACGAN; the generator produces images with higher scores",
        "section 1",
        "-",
        why_not="points2pix is not implemented here",
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
        "-",
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
