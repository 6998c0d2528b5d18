"""Number formats for pc2pix at ordinary and extreme clouds: errors, and layers that overflow.

The matrix has both bundled weights, the formats of `pc2pix.number_formats`, and the cloud of one
procedural test chair, plain and made extreme. A format is compared with float64 on the *same*
cloud, whatever the image: that of a cloud a thousand times too large is a saturated pattern in
every format, as the network was trained on the unit sphere only.

Tolerances. Rounding goes with the unit roundoff u of a format (`ROUNDOFF`); its amplification by
the layers was measured on 60 validation chairs (24 in float16; 12 of them also made extreme), with
`chair`, and on 12 with `chair-acgan`, whose rotated codes are small sums of large numbers:

* The code, in standard deviations: its largest error was at most 43 u (`chair-acgan`: 90 u) times
  the code's largest value (at least 1). Allowed: 100 u (200 u).
* The image, in grey levels: the mean error over all pixels was at most 463 u (1036 u) on plain
  clouds and 763 u (2588 u) on extreme ones, which drive the last tanh to -1 and 1, so that a
  rounding error that changes a sign costs 255. Allowed: 1000 u and 1500 u (2000 u and 5000 u). The
  largest error of a pixel is shown, not bounded: along edges the image of `chair` is that steep.

That is twice the measured errors; the amplification varied from chair to chair by a factor of 3.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.suites.stability.expectations import Kind
from bench.suites.stability.outcomes import CaseOutcome
from bench.tables.grid import Block, grid
from bench.tables.table import Table, columns_of

if TYPE_CHECKING:
    from data_prep.scene import Points
    from pc2pix.number_formats import Format

GROUP = "number-format"
WEIGHTS = ("chair", "chair-acgan")
PLAIN = "plain"
SCALES = {"scaled-1e3": 1e3, "scaled-1.3e3": 1.3e3, "scaled-1e9": 1e9, "scaled-1e30": 1e30}
OUTLIER = "outlier-1e6"  # the first point at (1e6, 0, 0)
CASES = (PLAIN, *SCALES, OUTLIER)
REFERENCE = "float64"
ROUNDOFF: dict[Format, float] = {  # relative to a value
    "float32": 2.0**-24,
    "bfloat16": 2.0**-8,
    "float16": 2.0**-11,
}
# In roundoffs: the code, the image of a plain cloud, that of an extreme one, whose pixels saturate.
MOST_ROUNDOFFS = {"chair": (100.0, 1000.0, 1500.0), "chair-acgan": (200.0, 2000.0, 5000.0)}


@dataclass(frozen=True)
class FormatRow:
    """The measurements of one cloud in one format.

    weights     bundled name
    case        one of CASES
    format      see `pc2pix.number_formats`
    code_scale  largest absolute value of the code in float64, in standard deviations
    code_error_largest, code_error_mean  against float64, in standard deviations; None where a code
                is not finite
    grey_error_largest, grey_error_mean  of the images, against float64, in grey levels 0..255;
                None where an image is not finite
    largest     absolute value within the networks that is finite, and the layer that it is in
    overflowed  the first layer with a value that is not finite; "" where all are finite
    refused     the stage at which the renderer refuses this, "encode" or "generate"; "" if it draws
    """

    weights: str
    case: str
    format: Format
    code_scale: float
    code_error_largest: float | None
    code_error_mean: float | None
    grey_error_largest: float | None
    grey_error_mean: float | None
    largest: float
    largest_in: str
    overflowed: str
    refused: str


# The layer that overflows, and the stage that refuses it ("" where none does). float16 ends at
# 65,504; the other formats hold 3e38, and everything else is expected to hold.
OVERFLOWS: dict[tuple[str, str, Format], tuple[str, str]] = {
    # The cloud itself does not fit.
    **{
        (weights, case, "float16"): ("input of encoder.points.0", "encode")
        for weights in WEIGHTS
        for case in ("scaled-1e9", "scaled-1e30", OUTLIER)
    },
    # Largest value at 1e3 in float64: 102,171 in block 4's shortcut; block 3's comes before that.
    ("chair-acgan", "scaled-1e3", "float16"): ("generator.blocks.3.shortcut", "generate"),
    # The sum that ends block 2 is beyond 65,504 already.
    ("chair-acgan", "scaled-1.3e3", "float16"): ("input of generator.blocks.3.bn1", "generate"),
    # 59 times the scale, so beyond 65,504 from 1.11e3 on. All of it is below 0, and the ReLU after
    # it makes 0 of minus infinity: image and code are finite, and no check sees it.
    ("chair", "scaled-1.3e3", "float16"): ("generator.blocks.0.conv1", ""),
}


def measure_formats() -> list[FormatRow]:
    """Return the whole matrix, in a fixed order: about 20 s on one thread."""
    from data_prep.scene import View
    from pc2pix.number_formats import FORMATS, GREY_LEVELS, deviation, infer
    from pc2pix.weights import load_weights

    views = (View(30.0, 20.0), View(-130.0, -15.0))
    rows = []
    for name in WEIGHTS:
        weights = load_weights(name)
        for case in CASES:
            points = case_points(case)
            exact = infer(weights, points, views, REFERENCE)
            for fmt in FORMATS:
                result = exact if fmt == REFERENCE else infer(weights, points, views, fmt)
                code = deviation(result.code, exact.code)
                image = deviation(result.images, exact.images)
                largest = max(result.layers, key=lambda layer: layer.largest)
                rows.append(
                    FormatRow(
                        weights=name,
                        case=case,
                        format=fmt,
                        code_scale=float(abs(exact.code).max()),
                        code_error_largest=code.largest if code else None,
                        code_error_mean=code.mean if code else None,
                        grey_error_largest=GREY_LEVELS * image.largest if image else None,
                        grey_error_mean=GREY_LEVELS * image.mean if image else None,
                        largest=largest.largest,
                        largest_in=largest.name,
                        overflowed=result.overflowed or "",
                        refused=result.refused or "",
                    )
                )
    return rows


def case_points(case: str) -> Points:
    """Return the cloud of a case, float32 [2048, 3].

    Raises KeyError for an unknown case.
    """
    import numpy as np

    from data_prep.clouds.sampling import sample_surface
    from data_prep.datasets.registry import ProceduralObject
    from data_prep.randomness import generator

    mesh = ProceduralObject("chair", "test", 0).load()
    points = sample_surface(mesh, generator("stability", "formats")).points.copy()
    if case == OUTLIER:
        points[0] = (1e6, 0.0, 0.0)
        return points
    return points if case == PLAIN else points * np.float32(SCALES[case])


def format_outcomes(rows: Iterable[FormatRow]) -> list[CaseOutcome]:
    """Return one verdict for each row, whose subject is the format with the weights."""
    return [_outcome(row) for row in rows]


def allowed(row: FormatRow) -> tuple[float, float]:
    """Return the allowed largest error of the code and mean error of the image, as in a row."""
    if row.format == REFERENCE:
        return 0.0, 0.0
    u = ROUNDOFF[row.format]
    code, plain, saturated = MOST_ROUNDOFFS[row.weights]
    return code * u * max(row.code_scale, 1.0), (plain if row.case == PLAIN else saturated) * u


def _outcome(row: FormatRow) -> CaseOutcome:
    expected = OVERFLOWS.get((row.weights, row.case, row.format))
    kind: Kind = "unexpected"
    if expected is None:
        code, grey = allowed(row)
        words = f"code within {code:.2g} sd, image within {grey:.2g} grey levels on average"
        errors = (row.code_error_largest, code), (row.grey_error_mean, grey)
        within = all(error is not None and error <= most for error, most in errors)
        if within and not row.overflowed:
            kind = "holds"
    else:
        words = _overflow(*expected)
        if (row.overflowed, row.refused) == expected:
            kind = "refused" if row.refused else "differs"
    return CaseOutcome(
        case=row.case,
        group=GROUP,
        subject=f"{row.format} ({row.weights})",
        expected=words,
        observed=_observed(row),
        kind=kind,
    )


def _overflow(layer: str, refused: str) -> str:
    then = f"refused at {refused}" if refused else "unnoticed: code and image are finite"
    return f"overflow in {layer}, {then}"


def _observed(row: FormatRow) -> str:
    parts = [_overflow(row.overflowed, row.refused)] if row.overflowed else []
    if row.code_error_largest is not None:
        parts.append(f"code within {row.code_error_largest:.2g} sd")
    if row.grey_error_mean is not None and row.grey_error_largest is not None:
        parts.append(
            f"image within {row.grey_error_mean:.2g} grey levels on average, "
            f"{row.grey_error_largest:.2g} at most"
        )
    return "; ".join(parts)


def formats_table(rows: Sequence[FormatRow]) -> Table[FormatRow]:
    """Return the numbers of the matrix; for people "not finite" in place of an error."""
    title = "pc2pix in number formats"
    return Table("number_formats", title, columns_of(FormatRow, ".6g"), tuple(rows), _layout)


def _layout(rows: Sequence[FormatRow]) -> Iterator[Block]:
    heads = [
        *("weights", "cloud", "format", "code, largest error (sd)"),
        *("image, mean error (grey levels)", "image, largest", "largest value", "in layer"),
        *("overflows in", "refused at"),
    ]
    lines = []
    for row in rows:
        errors = (row.code_error_largest, row.grey_error_mean, row.grey_error_largest)
        texts = ("not finite" if error is None else f"{error:.2g}" for error in errors)
        layers = f"{row.largest:.3g}", row.largest_in, row.overflowed, row.refused
        lines.append([row.weights, row.case, row.format, *texts, *layers])
    yield grid(heads, lines)
