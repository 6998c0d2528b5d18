"""The decimals that values are printed with, by metric and method."""

from __future__ import annotations

import csv

import pytest

from bench.analysis.digits import DECIMALS_FILE, decimals, is_coarse
from bench.catalogue.methods import find_method
from bench.catalogue.metrics import IMAGE_METRICS, KERNEL_METRICS, SET_METRICS


@pytest.mark.parametrize(
    ("metric", "methods", "expected", "coarse"),
    [
        ("ssim", (), 3, False),
        ("ssim", ("pc2pix",), 3, False),
        ("ssim", ("surface-apss",), 2, True),
        ("ssim", ("surface-apss@resolution=50",), 2, True),  # as its method
        ("ssim", ("pc2pix", "surface-fit"), 2, True),  # a difference: of the coarser value
        ("luminance", ("surface-apss",), 3, False),  # not in the file
        ("psnr", ("surface-bpa",), 1, True),
        ("fd-views", ("surface-apss",), 0, True),
        ("fd-views", ("denoised-wrap@ball=3", "alpha-wrap"), 0, True),
        ("fd-views", ("no-such-method",), 1, False),
        ("azimuth-error-deg", ("surface-apss",), 2, False),
    ],
)
def test_decimals(metric, methods, expected, coarse):
    assert (decimals(metric, *methods), is_coarse(metric, *methods)) == (expected, coarse)


def test_the_file_has_methods_and_metrics_of_the_benchmark_and_takes_digits_away():
    lines = list(csv.DictReader(DECIMALS_FILE.read_text(encoding="utf-8").splitlines()))
    assert len({(line["method"], line["metric"]) for line in lines}) == len(lines) > 30
    metrics = {*IMAGE_METRICS, *SET_METRICS, *KERNEL_METRICS}
    for line in lines:
        assert find_method(line["method"]).id == line["method"]
        assert line["metric"] in metrics
        assert 0 <= int(line["decimals"]) < decimals(line["metric"])
