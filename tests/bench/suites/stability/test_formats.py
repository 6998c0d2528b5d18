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

pytestmark = pytest.mark.slow

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
REFUSED = replace(
    ROW,
    case="scaled-1e9",
    code_error_largest=None,
    code_error_mean=None,
    grey_error_largest=None,
    grey_error_mean=None,
    overflowed="input of encoder.points.0",
    refused="encode",
)


@pytest.fixture(scope="module")
def rows():
    return measure_formats()


def test_the_whole_matrix_is_as_stated(rows):
    outcomes = format_outcomes(rows)
    assert [o for o in outcomes if o.kind == "unexpected"] == []
    assert {(o.subject, o.case) for o in outcomes} == {
        (f"{row.format} ({row.weights})", row.case) for row in rows
    }
    # 2 weights x 6 clouds x 4 formats; of float16, three clouds that do not fit for either network,
    # and two more for the second
    assert Counter(o.kind for o in outcomes) == {"holds": 39, "refused": 8, "differs": 1}
    assert {o.group for o in outcomes} == {GROUP}


def test_only_float16_overflows(rows):
    assert {row.format for row in rows if row.overflowed} == {"float16"}
    assert {(row.weights, row.case, row.format) for row in rows if row.overflowed} == set(OVERFLOWS)


def test_activations_grow_with_the_cloud(rows):
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


def verdict(row):
    (outcome,) = format_outcomes([row])
    return outcome.kind


def test_what_is_allowed_goes_with_the_roundoff():
    assert allowed(ROW) == (pytest.approx(100 * 2 / 2048), pytest.approx(1000 / 2048))
    assert allowed(replace(ROW, case="scaled-1e3"))[1] == pytest.approx(1500 / 2048)
    assert allowed(replace(ROW, format="bfloat16", code_scale=0.5))[0] == pytest.approx(100 / 256)
    assert allowed(replace(ROW, format="float64")) == (0, 0)


def test_verdicts():
    code, grey = allowed(ROW)
    assert verdict(ROW) == "holds"
    assert verdict(replace(ROW, code_error_largest=code, grey_error_mean=grey)) == "holds"
    assert verdict(replace(ROW, code_error_largest=code * 1.01)) == "unexpected"
    assert verdict(replace(ROW, grey_error_mean=grey * 1.01)) == "unexpected"
    assert verdict(replace(ROW, code_error_largest=float("nan"))) == "unexpected"
    assert verdict(replace(ROW, overflowed="generator.conv")) == "unexpected"
    assert verdict(replace(REFUSED, case="plain")) == "unexpected"
    assert verdict(replace(ROW, format="float64")) == "unexpected"


def test_verdicts_on_overflows():
    assert verdict(REFUSED) == "refused"
    assert verdict(replace(REFUSED, overflowed="encoder.points.1")) == "unexpected"
    assert verdict(replace(REFUSED, refused="generate")) == "unexpected"
    assert verdict(replace(ROW, case="scaled-1e9")) == "unexpected"
    unnoticed = replace(ROW, case="scaled-1.3e3", overflowed="generator.blocks.0.conv1")
    assert verdict(unnoticed) == "differs"
    assert verdict(replace(unnoticed, refused="generate")) == "unexpected"


def test_words():
    held, refused = format_outcomes([ROW, REFUSED])
    assert held.subject == "float16 (chair)"
    assert held.case == "plain"
    assert held.expected == "code within 0.098 sd, picture within 0.49 grey levels on average"
    assert held.observed == (
        "code within 0.001 sd; picture within 0.04 grey levels on average, 7 at most"
    )
    assert refused.expected == "overflow in input of encoder.points.0, refused at encode"
    assert refused.observed == refused.expected


def test_csv():
    table = list(csv.DictReader(io.StringIO(formats_table([ROW, REFUSED]).to_csv())))
    assert [line["case"] for line in table] == ["plain", "scaled-1e9"]
    assert table[0]["largest"] == "68.4375"
    assert float(table[0]["grey_error_mean"]) == 0.04
    assert table[1]["grey_error_mean"] == ""
    assert table[1]["refused"] == "encode"


def test_markdown():
    lines = formats_table([ROW, REFUSED]).to_markdown().splitlines()[2:]
    assert len({line.count("|") for line in lines}) == 1
    assert lines[2] == (
        "| chair | plain | float16 | 0.001 | 0.04 | 7 | 68.4 | generator.blocks.4.shortcut |  |  |"
    )
    assert "| not finite | not finite | not finite |" in lines[3]
    assert lines[3].endswith("| input of encoder.points.0 | encode |")
