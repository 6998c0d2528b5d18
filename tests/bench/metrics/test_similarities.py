"""PSNR, FLIP, DISTS, LPIPS and ST-LPIPS by published values, conformance vectors and other
implementations; closed forms, invariants and refusals are in `test_extreme_inputs`."""

from __future__ import annotations

import hashlib
import json
import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy.ndimage import distance_transform_edt
from skimage.io import imread
from skimage.metrics import peak_signal_noise_ratio

from bench.catalogue.metrics import FURTHER_METRICS, IMAGE_METRICS
from bench.catalogue.plugins import find_metric
from bench.metrics import psnr
from bench.metrics.dists import dists, pooled
from bench.metrics.flip import flip
from bench.metrics.image_scores import scores
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.lpips_network import Lpips, lpips
from bench.metrics.packaged_weights import CHECKPOINTS, find_lpips_weights

from .metrics_by_id import METRICS
from .reference import REFERENCE


def disc(radius, value, column=64):
    rows, columns = np.mgrid[:128, :128]
    image = np.full((128, 128, 3), 255, np.uint8)
    image[(rows - 64) ** 2 + (columns - column) ** 2 <= radius**2] = value
    return image


def noise(seed, *shape):
    return np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)


# --- PSNR -----------------------------------------------------------------------------------------

# The sum of squares is a whole number and exact; a quotient, a logarithm and a product round, each
# by at most 2 units of 2^-53 of values up to 100, here and in scikit-image.
PSNR_ROUNDING = 12 * 100 * 2.0**-53


def test_psnr_agrees_with_scikit_image():
    rng = np.random.default_rng(0)
    a = rng.integers(0, 256, (6, 40, 30, 3), np.uint8)
    b = a.copy()
    for i, share in enumerate((1.0, 0.5, 0.1, 0.03, 0.01, 0.003)):
        at = rng.random(a[i].shape) < share
        b[i][at] = rng.integers(0, 256, at.sum(), np.uint8)
    expected = [peak_signal_noise_ratio(x, y, data_range=255) for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(psnr(a, b), expected, rtol=0, atol=PSNR_ROUNDING)


def test_psnr_of_identical_images_is_that_of_one_level_in_one_channel():
    a = np.random.default_rng(1).integers(1, 255, (3, 128, 128, 3), np.uint8)
    b = a.copy()
    b[1:, 70, 20, 1] += 1
    b[2, 0, 0, 0] -= 1
    most = 20 * math.log10(255) + 10 * math.log10(128 * 128 * 3)
    expected = [most, most, most - 10 * math.log10(2)]
    np.testing.assert_allclose(psnr(a, b), expected, rtol=0, atol=PSNR_ROUNDING)
    np.testing.assert_array_equal(scores(a, b)["psnr"], psnr(a, b))


# --- FLIP -----------------------------------------------------------------------------------------


def test_flip_is_the_mean_of_the_map_of_its_package():
    """At 67 pixels per degree; the package's own mean is a sum of float32, off by 1e-4 at most."""
    evaluate = pytest.importorskip("flip_evaluator").evaluate
    truth = np.stack([disc(30, 80), disc(30, 80, column=80)])
    drawn = np.stack([disc(30, 120), disc(28, 80)])
    for value, a, b in zip(flip(truth, drawn), truth / 255, drawn / 255, strict=True):
        images = a.astype(np.float32), b.astype(np.float32)
        _, mean, settings = evaluate(*images, "LDR", applyMagma=False)
        assert settings["ppd"] == pytest.approx(67.0206, abs=1e-4)
        assert value == pytest.approx(mean, abs=1e-4)
        near, _, _ = evaluate(*images, "LDR", applyMagma=False, parameters={"ppd": 67.0206})
        assert value == pytest.approx(near.mean(dtype=np.float64), abs=1e-5)


# --- DISTS and LPIPS ------------------------------------------------------------------------------

RAMP = np.tile(np.arange(128, dtype=np.uint8) * 2, (128, 1))
WHITE, GREY = disc(0, 255), disc(30, 150)
STACKED = np.stack([RAMP, RAMP.T, 255 - RAMP], 2)
IMAGES = {
    "white/white": (WHITE, WHITE),
    "white/black": (WHITE, np.zeros_like(WHITE)),
    "disc 30 grey 150/same moved 3 right": (GREY, disc(30, 150, column=67)),
    "disc 30 grey 150/white": (GREY, WHITE),
    "disc 30 grey 150/disc 30 (200,80,40)": (GREY, disc(30, (200, 80, 40))),
    "noise 0/noise 1": (noise(0, 128, 128, 3), noise(1, 128, 128, 3)),
    "ramp/transposed ramp": (STACKED, STACKED.transpose(1, 0, 2)),
    "ramp/noise 2": (STACKED, noise(2, 128, 128, 3)),
}
# By DISTS_pytorch 0.1 itself in float64 on the same weights, on 2026-11-25.
DISTS = {
    "white/black": 0.373687821513,
    "disc 30 grey 150/white": 0.378907931251,
    "ramp/noise 2": 0.507081203432,
}


@pytest.mark.parametrize(("single", "tolerance"), [(False, 1e-7), (True, 1e-5)])
def test_dists_are_those_of_the_published_code(single, tolerance):
    pairs = np.stack([IMAGES[name] for name in DISTS], axis=1)
    assert dists(*pairs, single=single) == pytest.approx([*DISTS.values()], rel=0, abs=tolerance)


# By stlpips_pytorch 0.0.2 itself in float64 on the same weights, on 2026-11-27.
ST_LPIPS = {
    "white/white": 0.0,
    "white/black": 0.450636545541,
    "disc 30 grey 150/same moved 3 right": 0.017502378043,
    "disc 30 grey 150/white": 0.459140737150,
    "ramp/noise 2": 1.080851130110,
}


@pytest.mark.parametrize(("single", "tolerance"), [(False, 1e-10), (True, 1e-5)])
def test_st_lpips_is_that_of_the_published_code_and_forgives_shifts(single, tolerance):
    pairs = np.stack([IMAGES[name] for name in ST_LPIPS], axis=1)
    try:
        actual = lpips(*pairs, "shift-tolerant", single=single)
    except WeightsUnavailable as error:
        pytest.skip(str(error))
    assert actual == pytest.approx([*ST_LPIPS.values()], rel=0, abs=tolerance)
    striped = disc(30, 80)
    striped[40:88, 40:88:8] = 255
    shifted = striped, np.roll(striped, 1, axis=1)
    assert 3 * lpips(*shifted, "shift-tolerant", single=single) < lpips(*shifted, single=single)


# --- metrics by their ids -------------------------------------------------------------------------


def flip_of_its_package(truth, drawn):
    evaluate = pytest.importorskip("flip_evaluator").evaluate
    images = (image.astype(np.float32) / 255 for image in (truth, drawn))
    near, _, _ = evaluate(*images, "LDR", applyMagma=False, parameters={"ppd": 67.0206})
    return near.mean(dtype=np.float64)


def hole_in_one_piece(truth, drawn):
    far_inside = distance_transform_edt((truth < 255).any(axis=-1)) >= 3
    return np.count_nonzero(far_inside & (drawn == 255).all(axis=-1))


def part_in_one_piece(truth, drawn):
    far_outside = distance_transform_edt((truth == 255).all(axis=-1)) >= 3
    return np.count_nonzero(far_outside & (drawn < 255).any(axis=-1))


OURS = (*IMAGE_METRICS, *FURTHER_METRICS)
ON_WHITE = "disc 30 grey 150/white"
# By id: two images, what others have measured of them, and how far float32 may be off.
BY_ID = {
    "flip": (*IMAGES[ON_WHITE], flip_of_its_package, 1e-5),
    "dists": (*IMAGES[ON_WHITE], DISTS[ON_WHITE], 1e-5),
    "st-lpips": (*IMAGES[ON_WHITE], ST_LPIPS[ON_WHITE], 1e-5),
    "invented-holes": (disc(20, 80), disc(10, 80), hole_in_one_piece, 0),
    "invented-parts": (disc(10, 80), disc(20, 80), part_in_one_piece, 0),
}


@pytest.mark.parametrize("metric", FURTHER_METRICS)
def test_a_metric_on_request_is_what_its_id_says(metric):
    truth, drawn, expected, tolerance = BY_ID[metric]
    if callable(expected):
        expected = expected(truth, drawn)
    try:
        (actual,) = find_metric(metric).score(truth[None], drawn[None])
    except WeightsUnavailable as error:
        pytest.skip(str(error))
    assert actual == pytest.approx(expected, rel=0, abs=tolerance)


def test_no_two_metrics_of_images_are_one():
    """Each id gives a value of its own for a disc on a rod, drawn paler, smaller and aside."""
    truth, drawn = disc(30, 80)[None], disc(27, 120, column=67)[None]
    truth[:, 90:125, 63:65], drawn[:, 90:110, 64:67] = 80, 120
    values = {name: float(METRICS[name](truth, drawn)[0]) for name in OURS}
    values |= {f"{name}, of a run": float(v[0]) for name, v in scores(truth, drawn).items()}
    assert len(values) == len(OURS) + len(IMAGE_METRICS) - 1  # a run takes lpips by its network
    ordered = sorted(values.items(), key=lambda item: item[1])
    for (one, low), (other, high) in pairwise(ordered):
        same = one.partition(",")[0].replace("_", "-") == other.partition(",")[0].replace("_", "-")
        assert (high - low < 1e-9) == same, (one, other)


def test_pooling_by_hand():
    """One pixel of 4: a quarter of it counts half, beside it an eighth of 16, at a corner 1/16."""
    image = torch.zeros(1, 1, 4, 4, dtype=torch.float64)
    image[0, 0, 1, 2] = 4.0
    expected = torch.tensor([[0.0, 2.0], [0.0, 2.0]], dtype=torch.float64).sqrt()
    torch.testing.assert_close(pooled(image)[0, 0], expected, rtol=0, atol=1e-6)


@pytest.fixture(scope="module")
def reference():
    return json.loads((REFERENCE / "lpips_reference.json").read_text())


NETS = {"alex": "alexnet", "vgg": "vgg16"}  # and their names in the reference


# As the reference states: float64 on the float32 weights, and what float32 leaves of it.
@pytest.mark.parametrize(("single", "tolerance"), [(False, 1e-9), (True, 1e-5)])
@pytest.mark.parametrize("net", NETS)
def test_lpips_conforms_to_its_reference(reference, net, single, tolerance):
    assert CHECKPOINTS[net].sha256 == reference["checkpoints"][NETS[net]]
    dtype = torch.float32 if single else torch.float64
    network = Lpips(find_lpips_weights(net), net, dtype)
    cases = {case["case"]: case for case in reference["cases"]}
    assert [*cases] == [*IMAGES]
    for name in list(cases)[:: 1 if net == "alex" or single else 3]:  # the slow one of four
        case, (a, b) = cases[name], IMAGES[name]
        assert [hashlib.sha256(x.tobytes()).hexdigest() for x in (a, b)] == case["sha256"]
        actual = lpips(a[None], b[None], net, single=single)
        assert actual.dtype == np.float64
        assert actual[0] == pytest.approx(case[f"lpips_{NETS[net]}"], rel=0, abs=tolerance)
        (features,) = network.encode(a[None]).features.numpy()
        stated = case[f"features_{NETS[net]}"]
        assert len(features) == stated["dim"]
        assert features[:5] == pytest.approx(stated["first5"], rel=0, abs=tolerance)
        assert np.linalg.norm(features) == pytest.approx(stated["norm"], rel=tolerance)


@pytest.mark.parametrize("net", NETS)
def test_lpips_of_the_published_pair_and_of_the_smallest_images(reference, net):
    ref, near, far = (
        imread(REFERENCE / "lpips" / f"ex_{name}.png")[None, ..., :3]
        for name in ("ref", "p1", "p0")
    )
    actual = [float(lpips(ref, other, net, single=True)[0]) for other in (far, near)]
    # Both are rounded, to three and to four decimals; and 1e-5 is what float32 leaves.
    if net == "alex":
        assert actual == pytest.approx(reference["published"]["alexnet"], rel=0, abs=5e-4 + 1e-5)
    reproduced = reference["published_reproduced_float32"][NETS[net]]
    assert actual == pytest.approx(reproduced, rel=0, abs=5e-5 + 1e-5)
    side = {"alex": 31, "vgg": 16}[net]
    assert 0 < lpips(noise(0, 1, side, side, 3), noise(1, 1, side, side, 3), net)[0] < 2
