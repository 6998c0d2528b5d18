from __future__ import annotations

import csv
import io
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from bench.suites.stability.formats import (
    CASES,
    GROUP,
    OVERFLOWS,
    SCALES,
    WEIGHTS,
    FormatRow,
    allowed,
    case_points,
    format_outcomes,
    formats_table,
    measure_formats,
)

ROW = FormatRow(
    weights="chair",
    case="plain",
    format="float16",
    code_scale=2.0,
    code_error_largest=0.001,
    code_error_mean=0.0002,
    grey_error_largest=7.0,
    grey_error_mean=0.04,
    largest=68.4375,
    largest_in="generator.blocks.4.shortcut",
    overflowed="",
    refused="",
)
NO_ERRORS = {f"{what}_error_{of}": None for what in ("code", "grey") for of in ("largest", "mean")}
OVERFLOWED = {"overflowed": "input of encoder.points.0", "refused": "encode"}
REFUSED = replace(ROW, case="scaled-1e9", **NO_ERRORS, **OVERFLOWED)


@pytest.mark.slow
def test_the_whole_matrix_is_as_stated():
    rows = measure_formats()
    outcomes = format_outcomes(rows)
    assert [o for o in outcomes if o.kind == "unexpected"] == []
    assert [(o.subject, o.case) for o in outcomes] == [
        (f"{row.format} ({row.weights})", row.case) for row in rows
    ]
    # 2 weights x 6 clouds x 4 formats; of float16, three clouds that do not fit for either network,
    # and two more for the second
    assert Counter(o.kind for o in outcomes) == {"holds": 39, "refused": 8, "differs": 1}
    assert {o.group for o in outcomes} == {GROUP}
    assert {(row.weights, row.case, row.format) for row in rows if row.overflowed} == set(OVERFLOWS)
    largest = {(r.weights, r.case): r.largest for r in rows if r.format == "float64"}
    for weights in WEIGHTS:
        # far from the origin a ReLU network is linear; what remains of the biases is below 1e-8
        ratio = largest[weights, "scaled-1e30"] / largest[weights, "scaled-1e9"]
        assert ratio == pytest.approx(1e21, rel=1e-6)
        assert largest[weights, "plain"] < 100


def test_clouds():
    plain = case_points("plain")
    assert plain.shape == (2048, 3)
    assert np.abs(plain).max() <= 1
    for case, scale in SCALES.items():
        # one rounding of the scale, one of the product, 6e-8 each
        np.testing.assert_allclose(case_points(case), plain.astype(float) * scale, rtol=2e-7)
    outlier = case_points("outlier-1e6")
    assert outlier[0].tolist() == [1e6, 0, 0]
    assert np.array_equal(outlier[1:], plain[1:])
    assert set(CASES) == {"plain", *SCALES, "outlier-1e6"}
    with pytest.raises(KeyError):
        case_points("scaled-2")


def test_what_is_allowed_goes_with_the_roundoff():
    assert allowed(ROW) == (pytest.approx(100 * 2 / 2048), pytest.approx(1000 / 2048))
    assert allowed(replace(ROW, case="scaled-1e3"))[1] == pytest.approx(1500 / 2048)
    assert allowed(replace(ROW, format="bfloat16", code_scale=0.5))[0] == pytest.approx(100 / 256)
    assert allowed(replace(ROW, format="float64")) == (0, 0)


CODE, GREY = allowed(ROW)
UNNOTICED = replace(ROW, case="scaled-1.3e3", overflowed="generator.blocks.0.conv1")


@pytest.mark.parametrize(
    ("row", "kind"),
    [
        (ROW, "holds"),
        (replace(ROW, code_error_largest=CODE, grey_error_mean=GREY), "holds"),
        (replace(ROW, code_error_largest=CODE * 1.01), "unexpected"),
        (replace(ROW, grey_error_mean=GREY * 1.01), "unexpected"),
        (replace(ROW, code_error_largest=float("nan")), "unexpected"),
        (replace(ROW, overflowed="generator.conv"), "unexpected"),
        (replace(ROW, format="float64"), "unexpected"),
        (replace(ROW, case="scaled-1e9"), "unexpected"),
        (replace(REFUSED, case="plain"), "unexpected"),
        (REFUSED, "refused"),
        (replace(REFUSED, overflowed="encoder.points.1"), "unexpected"),
        (replace(REFUSED, refused="generate"), "unexpected"),
        (UNNOTICED, "differs"),
        (replace(UNNOTICED, refused="generate"), "unexpected"),
    ],
)
def test_verdicts(row, kind):
    (outcome,) = format_outcomes([row])
    assert outcome.kind == kind


def test_words_and_tables():
    held, refused = format_outcomes([ROW, REFUSED])
    assert (held.subject, held.case) == ("float16 (chair)", "plain")
    assert held.expected == "code within 0.098 sd, image within 0.49 grey levels on average"
    error = "code within 0.001 sd; image within 0.04 grey levels on average, 7 at most"
    assert held.observed == error
    assert refused.expected == "overflow in input of encoder.points.0, refused at encode"
    assert refused.observed == refused.expected
    table = formats_table([ROW, REFUSED])
    first, second = csv.DictReader(io.StringIO(table.to_csv()))
    values = [first[name] for name in ("case", "largest", "grey_error_mean")]
    assert values == ["plain", "68.4375", "0.04"]
    assert [second[n] for n in ("case", "grey_error_mean", "refused")] == [
        "scaled-1e9",
        "",
        "encode",
    ]
    assert "| 0.001 | 0.04 | 7 | 68.4 |" in table.to_markdown()
    assert "| not finite | not finite | not finite |" in table.to_markdown()
