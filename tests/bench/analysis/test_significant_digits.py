"""The digits that survive rounding: the half width of an error, and what follows from it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2, norm

from bench.analysis.comparison import Estimate, Quality, difference_precision
from bench.analysis.significant_digits import (
    COLUMNS,
    FILE_DECIMALS,
    MOST_DIGITS,
    ROUNDING_FILE,
    ObjectDeviation,
    Precision,
    RoundingErrors,
    half_of_mean,
    precision,
    precision_of_difference,
    rounding_errors,
    significant_digits,
    surviving_decimals,
)
from bench.catalogue.methods import METHODS
from data_prep.failures import BadInput

NAN = math.nan
# A few functions of float64, of other implementations of the same inverses.
ALIKE = 1e-12

# APSS, ssim of a chair by rounding, of 24 degrees of freedom: -log10 of the half width over 24
# chairs is 2.08, so that two decimals survive.
APSS = ObjectDeviation(0.0156, 24)


@pytest.mark.parametrize(
    ("samples", "bits"),
    [
        ((0.776, 0.771, 0.779, 0.774, 0.7765, 0.768), 5.061607986641647),
        ((40.1, 39.2, 41.3, 40.4), 2.8982377645161423),
        ((0.1, 0.10001, 0.09999, 0.10002, 0.1, 0.10001, 0.09998, 0.1), 10.571630165811275),
    ],
)
def test_half_widths_are_those_of_the_package_significantdigits(samples, bits):
    """Its version 0.6.0 (Verificarlo project) gave these bits.

    By `significant_digits(samples, reference=mean, axis=0, error="absolute", method="cnh",
    probability=0.95, confidence=0.9)`: its interval of the deviation has two sides, and of these
    only the upper one matters here. It counts bits from the first of the mean.
    """
    values = np.array(samples)
    half = ObjectDeviation(float(values.std()), len(values) - 1).half_width()
    first = math.floor(math.log2(values.mean()))
    assert first - math.log2(half) == pytest.approx(bits, rel=ALIKE)


def test_a_half_width_is_that_of_its_formula():
    half = norm.ppf(0.975) * 0.0156 * math.sqrt(24 / chi2.ppf(0.05, 24)) / math.sqrt(24)
    assert APSS.half_width(24) == pytest.approx(half, rel=ALIKE)
    assert 0.0082 < half < 0.0083  # by tables: 1.960 x 0.0156 x 1.3163 / 4.899


def test_half_widths_at_their_limits():
    assert ObjectDeviation(0.0, 0).half_width(24) == 0.0
    assert ObjectDeviation(1.0, 1e12).half_width() == pytest.approx(norm.ppf(0.975), rel=1e-5)
    assert math.isnan(APSS.half_width(0))
    assert APSS.half_width(100) == pytest.approx(APSS.half_width() / 10, rel=ALIKE)


@pytest.mark.parametrize("degrees", [2, 24])
def test_so_many_errors_are_within_their_half_width(degrees):
    """The half width holds for 95 % of errors where the deviation is no larger than its bound.

    Of 4,000 measured deviations the bound is below the true one in 5 %, within 4 standard errors.
    """
    measured = np.sqrt(np.random.default_rng(0).chisquare(degrees, 4000) / degrees)
    bounds = np.array([ObjectDeviation(float(s), degrees).half_width() for s in measured])
    too_small = np.mean(bounds < norm.ppf(0.975))
    assert too_small == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / 4000))


@pytest.mark.parametrize(
    ("half", "decimals"),
    [(0.0082, 2), (0.02, 1), (0.5, 0), (3.0, -1), (14.0, -2), (1e-9, FILE_DECIMALS), (0, 6)],
)
def test_a_digit_survives_an_error_below_one_unit_of_it(half, decimals):
    assert surviving_decimals(half) == decimals


@pytest.mark.parametrize(
    ("value", "half", "digits"),
    [
        (0.776, 0.0082, 2),
        (0.776, 0.02, 1),
        (0.0123, 0.0082, 1),
        (0.0023, 0.0082, 0),
        (-0.776, 0.0082, 2),
        (123.4, 14.0, 1),
        (123.4, 0.5, 3),
        (0.776, 0.0, MOST_DIGITS),
        (123.4, 0.0, MOST_DIGITS),
        (0.0123, 0.0, 5),  # a file has .012300
        (0.0, 0.0, MOST_DIGITS),
        (0.0, 0.01, 0),
        (0.776, NAN, None),
        (NAN, 0.01, None),
    ],
)
def test_significant_digits_count_from_the_first_that_is_not_0(value, half, digits):
    assert significant_digits(value, half) == digits


@pytest.mark.parametrize(
    ("declared", "value", "half", "printed"),
    [
        (3, 0.776, NAN, Precision(3)),
        (3, 0.776, 0.0, Precision(3)),
        (3, 0.776, 0.00082, Precision(3)),
        (3, 0.776, 0.0082, Precision(2, 0.0082)),
        (3, 0.776, 0.3, Precision(1, 0.3)),  # the first digit is printed nonetheless
        (3, 0.0123, 0.3, Precision(2, 0.3)),
        (3, 0.0, 0.3, Precision(0, 0.3)),
        (1, 123.4, 14.0, Precision(0, 14.0)),
        (1, 123.4, 0.05, Precision(1)),
        (3, NAN, 0.02, Precision(1, 0.02)),
    ],
)
def test_digits_that_are_printed(declared, value, half, printed):
    assert precision(declared, value, half) == printed


@given(
    declared=st.integers(0, 6),
    value=st.floats(1e-5, 1e4),
    half=st.floats(1e-8, 1e4),
)
def test_no_digit_but_the_first_is_printed_that_does_not_survive(declared, value, half):
    decimals, lost = precision(declared, value, half)
    assert 0 <= decimals <= declared
    assert (lost is None) == (half < 10.0**-declared or surviving_decimals(half) >= declared)
    first = 10.0 ** math.floor(math.log10(value))
    unit = 10.0**-decimals
    # 1e-9: the power of ten and the logarithm are rounded.
    assert half <= unit * (1 + 1e-9) or unit >= min(first, 1.0) * (1 - 1e-9)


def test_a_difference_has_the_digits_of_the_coarser_of_its_values():
    both = precision_of_difference(3, [(0.776, 0.0082), (0.7, 0.00001)])
    assert both.decimals == 2
    assert both.half == pytest.approx(math.hypot(0.0082, 0.00001), rel=ALIKE)
    assert precision_of_difference(3, [(0.776, NAN), (0.7, 0.0082)]) == (2, 0.0082)
    assert precision_of_difference(3, [(0.776, NAN), (0.7, NAN)]) == (3, None)
    a, b = (
        Quality("psnr", Estimate(value, NAN, NAN), np.zeros(2), half)
        for value, half in ((20.0, 0.02), (21.0, 0.3))
    )
    assert difference_precision(a, b).decimals == 0
    assert (a.precision.decimals, b.precision.decimals) == (1, 0)


def test_errors_of_a_mean_add_up_as_independent_ones():
    assert half_of_mean([0.03, 0.04]) == pytest.approx(0.025, rel=ALIKE)
    assert math.isnan(half_of_mean([0.03, NAN]))
    assert math.isnan(half_of_mean([]))


def deviations(rows):
    return RoundingErrors({key: ObjectDeviation(*value) for key, value in rows.items()})


def test_what_was_not_measured_takes_the_largest_of_its_relatives():
    errors = deviations({
        ("surface-apss", "2048", "ssim"): (0.01, 24),
        ("surface-apss", "512", "ssim"): (0.03, 24),
        ("surface-bpa", "2048", "ssim"): (0.02, 24),
        ("splat-net", "2048", "ssim"): (1e-5, 24),
        ("splat-net@grey", "512", "ssim"): (0.9e-5, 2),  # of fewer: its half width is larger
        ("pc2pix", "2048", "lpips"): (0.5, 24),
    })  # fmt: skip

    def half(method, condition="2048", metric="ssim"):
        return errors.half_width(method, condition, metric, 4)

    def expected(deviation, degrees=24):
        return ObjectDeviation(deviation, degrees).half_width(4)

    assert half("surface-apss") == expected(0.01)
    assert half("surface-apss", "noise-0.10") == expected(0.03)
    assert half("surface-fit") == expected(0.03)  # of the paper's chain, as these two are
    assert half("surface-apss@7") == expected(0.03)
    assert half("splat-net@chair") == expected(0.9e-5, 2)
    assert half("splat-net@chair") > expected(1e-5)
    for unknown in (("alpha-wrap",), ("pc2pix",), ("pc2pix", "2048", "psnr")):
        assert math.isnan(half(*unknown))
    assert half("pc2pix@all", "512", "lpips") == expected(0.5)


def test_a_file_is_read(tmp_path):
    path = tmp_path / "rounding.csv"
    path.write_text(
        ",".join(COLUMNS) + "\n"
        "surface-apss,2048,ssim,0.776000,0.0156,24,12,20,3\n"
        "blank,2048,ssim,0.500000,0.000000,0,12,20,3\n"
    )
    errors = rounding_errors(path)
    assert errors.half_width("surface-apss", "2048", "ssim", 24) == APSS.half_width(24)
    assert errors.half_width("blank", "2048", "ssim", 24) == 0.0
    path.write_text("gone")
    assert rounding_errors(path) is errors  # read once


def test_without_a_file_nothing_is_known(tmp_path):
    errors = rounding_errors(tmp_path / "rounding.csv")
    assert math.isnan(errors.half_width("surface-apss", "2048", "ssim", 24))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("method,condition,metric\n", "no column value, object_deviation, degrees; copy it from"),
        (",".join(COLUMNS) + "\nsplat,2048,ssim,0.5,much,24,12,20,3\n", ":2: could not convert"),
        (",".join(COLUMNS) + "\nsplat,2048,ssim,0.5,-1,24,12,20,3\n", ":2: a deviation of -1 with"),
        (",".join(COLUMNS) + "\nsplat,2048,ssim,0.5,0.1,0,12,20,3\n", "with 0 degrees of freedom"),
        (",".join(COLUMNS) + "\nsplat,2048,ssim,0.5,nan,24,12,20,3\n", "a deviation of nan with"),
    ],
)
def test_a_file_that_is_not_one_of_the_suite_is_refused(tmp_path, text, message):
    path = tmp_path / "rounding.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match="rounding.csv.*" + message):
        rounding_errors(path)


def test_the_packaged_file_knows_methods_of_the_package():
    """Its rows have methods of the catalogue; without a file there is nothing to look at."""
    if not ROUNDING_FILE.is_file():
        pytest.skip("no results/rounding.csv in this checkout")
    lines = ROUNDING_FILE.read_text(encoding="utf-8").splitlines()
    assert tuple(lines[0].split(","))[: len(COLUMNS)] == COLUMNS
    known = {method.id for method in METHODS}
    assert {line.split(",")[0].partition("@")[0] for line in lines[1:]} <= {
        method_id.partition("@")[0] for method_id in known
    }
    rounding_errors()
