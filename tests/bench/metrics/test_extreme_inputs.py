"""Metrics at the edges of their domain: closed forms, invariants and refusals by name.

Comparisons with other implementations, and cases in which those say the same, are in the tests of
each metric. NumPy's warnings are errors (pyproject.toml).

Tolerances, with U = 2^-53: a mean over the 118 x 118 windows of three channels is off by SUMS at
most, sums of at most 576 x 3 values of at most 1, and of 25 tiles. A moment of one window of noise
is a sum of 11 sums of 11 products of at most 255^2, off by 22 U of that; four moments over the
least of the divisors, C3, by ONE_WINDOW. FLIP and the networks compute in float32.
"""

from __future__ import annotations

import functools
import math
import re

import numpy as np
import pytest

from bench.catalogue.metrics import JUDGE
from bench.judges.answers import azimuth_error_deg, elevation_error_deg
from bench.metrics.dists import BATCH as DISTS_BATCH
from bench.metrics.dists import dists
from bench.metrics.frechet import TooFewSamples
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.lpips_network import BATCH as LPIPS_BATCH
from bench.metrics.lpips_network import lpips
from bench.metrics.silhouette import contrast, foreground, object_boxes
from bench.metrics.thin_parts import evaluated

from .metrics_by_id import METRICS, OF_FEATURES, SSIM, extractor, rounding_of_frechet

# By the protocol, not the code's own.
C1, C2, C3 = 2.55**2, 7.65**2, 7.65**2 / 2
WINDOW, SIGMA, WINDOWS = 11, 1.5, 118**2
U = 2.0**-53
SUMS = (576 * 3 + 25) * U
ONE_WINDOW = 4 * 22 * U * 255**2 / C3
BANDS = 1e-9  # those of a flat image err by 1e-12 of 255, beside K = 1
FLIP_IN_FLOAT32 = 1e-6
FEATURES_IN_FLOAT32 = 1e-4  # sums of up to 864 products a layer, of features up to some 10
CODE_LENGTH = 18 * 2.0**-24  # half of the 32 roundings of a sum of squares, a root, a quotient
COARSEST = 0.2363 / (0.0448 + 0.2856 + 0.3001 + 0.2363)  # weight of the fourth scale of MS-SSIM
FLIP_WHITE_BLACK = (
    0.967388  # of every pixel, printed by the tool `flip` of the package, version 1.7
)
THIN = ("thin-recall", "thin-precision")
SSIMS = (*SSIM, "ssim-object")
NETWORKS = {
    "lpips in float64": lpips,
    "lpips of vgg": functools.partial(lpips, net="vgg"),
    "lpips of squeeze": functools.partial(lpips, net="squeeze"),
    "dists in float64": dists,
}
# Of one array: silhouettes and thin parts.
OF_ONE = (foreground, contrast, object_boxes, evaluated)
PARTS = {f"{f.__name__} of one": lambda a, b, f=f: f(a) for f in OF_ONE}
FUNCTIONS = METRICS | NETWORKS | PARTS


def flat(level, count=1, side=128):
    return np.full((count, side, side, 3), level, np.uint8)


def noise(seed, side=128):
    return np.random.default_rng(seed).integers(0, 256, (1, side, side, 3), dtype=np.uint8)


def painted(level, rows, columns, ground=255):
    image = flat(ground)
    image[:, rows, columns] = level
    return image


def speck(ground, level, at):
    """A flat image with one pixel: (64, 64) is in 121 windows of SSIM, the corner (0, 0) in one."""
    return painted(level, at, at, ground)


def leg(level=80, rows=slice(40, 80), columns=slice(60, 63)):
    """A bar of 40 x 3 px on white, all of it thin."""
    return painted(level, rows, columns)


def stripes(shift):
    """Vertical stripes with a period of 32 px."""
    row = np.round(127.5 + 100 * np.sin(2 * np.pi * (np.arange(128) + shift) / 32))
    return np.broadcast_to(row[:, None], (1, 128, 128, 3)).astype(np.uint8)


def boxes():
    """Six images of coloured boxes on white."""
    rng, images = np.random.default_rng(0), flat(255, 6)
    for image in images:
        top, left, height, width = rng.integers(10, 60, 4)
        image[top : top + height, left : left + width] = rng.integers(0, 255, 3)
    return images


def luminance(p, q):
    return (2 * p * q + C1) / (p * p + q * q + C1)


def window(size):
    offsets = np.arange(size, dtype=np.longdouble) - np.longdouble(size - 1) / 2
    weights = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * (SIGMA * size / WINDOW) ** 2))
    return weights / weights.sum()


def of_speck(p, q, at):
    """SSIM and its components in the windows that have one pixel q among p, against flat ones.

    Mean p + (q - p) w, variance (q - p)^2 w (1 - w); against a flat window the structure is C3/C3.
    """
    weights = window(WINDOW).astype(float)
    weights = weights[:1, :1] if at == 0 else weights
    mean, variance = p + (q - p) * weights, (q - p) ** 2 * weights * (1 - weights)
    light, contrast = luminance(p, mean), C2 / (variance + C2)
    return {"ssim": light * contrast, "luminance": light, "contrast": contrast}


def of_one_window(a, b):
    """SSIM and its components of images of a single window, from the definition."""
    weights = window(a.shape[1])[..., None]
    x, y = a[0].astype(np.longdouble), b[0].astype(np.longdouble)
    mean_x, mean_y = ((weights * z).sum((0, 1)) for z in (x, y))
    x, y = x - mean_x, y - mean_y
    var_x, var_y, cov = ((weights * z).sum((0, 1)) for z in (x * x, y * y, x * y))
    root, light = np.sqrt(var_x * var_y), luminance(mean_x, mean_y)
    contrast, structure = (2 * root + C2) / (var_x + var_y + C2), (cov + C3) / (root + C3)
    values = (light * contrast * structure, light, contrast, structure)
    return {n: float(v.mean()) for n, v in zip(SSIM, values, strict=True)}


def computed(metric, *arrays):
    try:
        return FUNCTIONS[metric](*arrays)
    except WeightsUnavailable as error:
        pytest.skip(str(error))


def assert_values(metric, a, b, expected, within=0.0):
    """Of each pair of images a value, or NaN."""
    actual = computed(metric, a, b)
    assert actual.shape == (len(a),)
    np.testing.assert_allclose(actual, np.broadcast_to(expected, actual.shape), rtol=0, atol=within)


@pytest.mark.parametrize("pair", [(0, 255), (255, 0), (0, 1), (128, 127), (200, 7), (255, 218)])
def test_flat_images(pair):
    images = [flat(level) for level in pair]
    for metric in ("ssim", "luminance"):
        assert_values(metric, *images, luminance(*pair), SUMS)
    for metric in ("contrast", "structure"):
        assert_values(metric, *images, 1.0)
    # Contrast 37 of the 37.5 that is asked for is no object.
    assert_values("ssim-object", *images, math.nan if pair[1] == 218 else luminance(*pair), SUMS)
    for metric in THIN:
        assert_values(metric, *images, math.nan)


@pytest.mark.parametrize("at", [64, 0])
@pytest.mark.parametrize(("p", "q"), [(255, 254), (255, 0), (0, 1), (0, 255), (128, 127)])
def test_one_pixel(p, q, at):
    """The corner pixel, one level off, moves the mean by 1.3e-12, five times SUMS and more."""
    parts = of_speck(p, q, at)
    for metric, values in parts.items():
        expected = 1.0 + float((values - 1.0).sum()) / WINDOWS
        assert_values(metric, flat(p), speck(p, q, at), expected, SUMS)
    assert_values("structure", flat(p), speck(p, q, at), 1.0)
    # On white only the windows with a drawn pixel count; another ground fills the frame.
    of_object, within = expected_of_object(p, q, parts["ssim"])
    assert_values("ssim-object", flat(p), speck(p, q, at), of_object, within)
    if (p, q) == (255, 0):
        assert_values("ssim-object", speck(p, q, at), flat(p), of_object, within)


def expected_of_object(p, q, ssim):
    if p < 255:
        return 1.0 + float((ssim - 1.0).sum()) / WINDOWS, SUMS
    return (float(ssim.mean()), ONE_WINDOW) if q == 0 else (math.nan, 0.0)


@pytest.mark.parametrize("side", [1, 7, 8, 11])
def test_small_images_have_one_window(side):
    a, b = noise(side, side), noise(side + 100, side)
    expected = of_one_window(a, b)
    for metric, value in expected.items():
        assert_values(metric, a, b, value, ONE_WINDOW)
    assert_values("ssim-object", a, b, expected["ssim"], ONE_WINDOW)
    assert_values("ms-ssim", a, b, max(expected["ssim"], 0.0), ONE_WINDOW)  # of one scale


def test_strips_and_negatives():
    for cut in ((slice(None), slice(1)), (slice(None), slice(None), slice(1))):
        a, b = noise(3, 30)[cut], noise(4, 30)[cut]  # windows of one pixel: luminance
        expected = luminance(a.astype(float), b.astype(float)).mean()
        for metric in SSIM:
            of_metric = expected if metric in ("ssim", "luminance") else 1.0
            assert_values(metric, a, b, of_metric, SUMS)
    a = noise(2, WINDOW)
    assert_values("contrast", a, 255 - a, 1.0, ONE_WINDOW)
    assert_values("structure", a, 255 - a, of_one_window(a, 255 - a)["structure"], ONE_WINDOW)
    assert_values("ms-ssim", a, 255 - a, 0.0)  # the structure of its one scale is negative


WHITE, BLACK, LEG = flat(255), flat(0), leg()
MOVED, HALF = leg(columns=slice(61, 64)), leg(rows=slice(40, 60))
TWO_LEGS, LEG_AND_WHITE = np.concatenate([LEG, LEG]), np.concatenate([LEG, WHITE])
BLACK_AND_LEG, WHITE_AND_LEG = np.concatenate([BLACK, LEG]), np.concatenate([WHITE, LEG])
DISTANCES = ("lpips", "lpips in float64", "lpips of vgg", "dists", "dists in float64")
VALUES = [  # metrics, images, value, tolerance
    *((m, (x, x), 1.0, 0.0) for m in SSIM for x in (noise(1), LEG, WHITE, BLACK)),
    *(("ssim-object", (x, x), 1.0, 0.0) for x in (noise(1), LEG, BLACK)),
    *((m, (WHITE, WHITE), math.nan, 0.0) for m in ("ssim-object", *THIN)),
    *((m, (LEG, LEG), 1.0, 0.0) for m in THIN),
    ("thin-recall", (LEG, WHITE), 0.0, 0.0),
    ("thin-precision", (LEG, WHITE), math.nan, 0.0),
    *((m, (LEG, MOVED), 2 / 3, U) for m in THIN),
    *((m, (leg(254), leg(254)), 1.0, 0.0) for m in THIN),  # the faintest leg
    ("thin-recall", (leg(254), WHITE), 0.0, 0.0),
    *(
        (m, (BLACK_AND_LEG, WHITE_AND_LEG), [luminance(0, 255), 1.0], SUMS)
        for m in ("ssim", "ssim-object")
    ),
    *((m, (BLACK_AND_LEG, WHITE_AND_LEG), [math.nan, 1.0], 0.0) for m in THIN),
    *((m, (leg(columns=slice(0, 3)),) * 2, 1.0, 0.0) for m in THIN),  # along the frame
    *((m, (leg(rows=slice(40, 44), columns=slice(60, 62)),) * 2, 1.0, 0.0) for m in THIN),  # 8 px
    *((m, (leg(rows=slice(40, 47), columns=60),) * 2, math.nan, 0.0) for m in THIN),  # 7 px
    ("silhouette-iou", (LEG, LEG), 1.0, 0.0),
    ("silhouette-iou", (WHITE, WHITE), 1.0, 0.0),  # neither shows anything: they agree
    ("silhouette-iou", (LEG, WHITE), 0.0, 0.0),
    ("silhouette-iou", (WHITE, LEG), 0.0, 0.0),
    ("silhouette-iou", (LEG, HALF), 0.5, 0.0),
    ("silhouette-iou", (LEG, MOVED), 0.5, 0.0),  # 2 of 3 columns drawn, 1 beside them
    ("silhouette-iou", (LEG, BLACK), 120 / 128**2, U),
    # Contrasts 38 and 37 of the 37.5 that is asked for; half of a light leg's contrast all over.
    ("silhouette-iou", (leg(0), leg(217)), 1.0, 0.0),
    ("silhouette-iou", (leg(0), leg(218)), 0.0, 0.0),
    ("silhouette-iou", (LEG, np.minimum(LEG, flat(218))), 1.0, 0.0),
    ("silhouette-iou", (WHITE, flat(218)), 1.0, 0.0),
    ("silhouette-iou", (leg(235), np.minimum(leg(235), flat(245))), 120 / 128**2, U),
    ("silhouette-iou", (TWO_LEGS, LEG_AND_WHITE), [1.0, 0.0], 0.0),
    *(("ms-ssim", (x, x), 1.0, 0.0) for x in (noise(1), LEG, WHITE, BLACK)),
    *(("cw-ssim", (x, x), 1.0, BANDS) for x in (noise(1), LEG, WHITE, BLACK)),
    *(("flip", (x, x), 0.0, 0.0) for x in (noise(1), LEG, WHITE, BLACK)),
    ("ms-ssim", (WHITE, BLACK), luminance(0, 255) ** COARSEST, SUMS),
    ("cw-ssim", (WHITE, BLACK), 1.0, BANDS),  # no structure in either
    ("flip", (WHITE, BLACK), FLIP_WHITE_BLACK, FLIP_IN_FLOAT32),
    ("flip", (BLACK, WHITE), FLIP_WHITE_BLACK, FLIP_IN_FLOAT32),
    # A coefficient of a stripe turns by 360 degrees / 32 and pixel, all of them alike.
    ("cw-ssim", (stripes(0), stripes(1)), 1.0, 1e-3),
    ("cw-ssim", (stripes(0), stripes(16)), 1.0, 1e-3),
    ("ms-ssim", (stripes(0), stripes(16)), 0.0, 0.0),  # structure is negative
    *((m, (flat(0, 0), flat(0, 0)), 1.0, 0.0) for m in (*THIN, "silhouette-iou", JUDGE)),  # none
    *((m, (x, x), 0.0, 0.0) for m in DISTANCES for x in (noise(1), LEG, WHITE, BLACK)),
    # Codes of length 1, and finite angles.
    *((JUDGE, (x, x), 1.0, CODE_LENGTH) for x in (BLACK, WHITE, LEG, noise(5), speck(255, 0, 0))),
]


@pytest.mark.parametrize(("metric", "images", "expected", "within"), VALUES)
def test_values_of_images(metric, images, expected, within):
    assert_values(metric, *images, expected, within)


NOT_UINT8 = [(WHITE / 255, np.full(WHITE.shape, np.nan)), (WHITE.astype("i8"), LEG.astype("i8"))]
NOT_UINT8 += [(WHITE.astype("f4") / 255, LEG.astype("f4") / 255), (WHITE, LEG / 255)]
OF_PIXELS = ("ms-ssim", "cw-ssim", "flip")
OF_OBJECTS = ("ssim-object", *THIN, "silhouette-iou")
BY_NETWORKS = ("fd-views", "fd-views-grey", JUDGE)
OF_DISTANCES = ("lpips", "lpips of vgg", "dists")
EVERY = (*SSIM, "psnr", *OF_PIXELS, *OF_OBJECTS, *BY_NETWORKS, "fd-alexnet", *OF_DISTANCES)
CHANNELS_4 = np.zeros((2, 128, 128, 4), np.uint8)
SIZES = (BLACK[:, :64], BLACK[:, :, :64], BLACK[..., :1], BLACK[0])  # that the judges do not take
REFUSED = [  # metrics, images, part of the message
    *((EVERY, x, "images must be uint8") for x in NOT_UINT8),
    *((PARTS, x, f"must be uint8 (range 0..255), got {x[0].dtype}") for x in NOT_UINT8[:3]),
    ((*SSIM, "psnr", *OF_OBJECTS, *BY_NETWORKS, *OF_DISTANCES), (LEG[0],) * 2, "[128, 128, 3]"),
    ((*SSIM, *OF_OBJECTS), (LEG[0, :, :, 0],) * 2, "[128, 128]"),
    (BY_NETWORKS, (LEG[0, :, :, 0],) * 2, "images must be uint8 ["),
    ((*BY_NETWORKS, *OF_DISTANCES), (CHANNELS_4,) * 2, "images must be uint8 ["),
    *(
        (("fd-views", JUDGE), (x,) * 2, f"[N, 128, 128, 3], got {x.dtype} {list(x.shape)}")
        for x in (*SIZES, BLACK / 255)
    ),
    (("flip",), (CHANNELS_4,) * 2, "images must be [N, H, W, 3]"),
    ((*SSIM, "psnr", *OF_PIXELS, *OF_DISTANCES), (flat(0, side=64), BLACK), "the same shape"),
    (OF_OBJECTS, (flat(0, side=64), BLACK), "of truths [1, 64, 64, 3]"),
    (OF_FEATURES[:2], (flat(0, side=64), BLACK), "[1, 64, 64, 3]"),
    ((*SSIM, "psnr", *OF_DISTANCES), (BLACK, flat(0, 2)), "the same shape"),
    (OF_OBJECTS, (BLACK, flat(0, 2)), "of truths [1, 128, 128, 3]"),
    ((*SSIMS, "psnr", *OF_PIXELS), (flat(0, 0), flat(0, 0)), "nothing to compare"),
    ((*SSIMS, "psnr", *THIN), (BLACK[..., :0], BLACK[..., :0]), "nothing to compare"),
    (("cw-ssim",), (noise(7, 7), noise(8, 7)), "sides must be multiples of 8, at least 64"),
    (("lpips",), (BLACK[:, :30],) * 2, "of 31 x 31 pixels or more"),
    (("lpips of vgg", "dists"), (BLACK[:, :, :15],) * 2, "of 16 x 16 pixels or more"),
    (("lpips of squeeze",), (BLACK, BLACK), "alex or vgg, got 'squeeze'"),
]


@pytest.mark.parametrize(("metrics", "images", "says"), REFUSED)
def test_refused_images(metrics, images, says):
    for metric in dict.fromkeys(metrics):
        with pytest.raises(ValueError, match=re.escape(says)):
            computed(metric, *images)


# Sums of up to 4,608 products of float64 in another order; of float32 for FLIP.
COMPANY = {"lpips in float64": 1e-12, "lpips of vgg": 1e-12, "dists in float64": 1e-12}
COMPANY |= {"flip": FLIP_IN_FLOAT32, "cw-ssim": 1e-15}
DIRECTED = ("ssim-object", "silhouette-iou", *THIN)


@pytest.mark.parametrize("metric", [*SSIM, "psnr", "ms-ssim", *OF_OBJECTS, *COMPANY])
def test_neither_company_nor_sides_nor_strides_matter(metric):
    truth = np.concatenate([boxes()[:2], LEG, WHITE])[:, 32:96, 32:96]
    drawn = np.concatenate([noise(1), boxes()[2:3], MOVED, BLACK])[:, 32:96, 32:96]
    close = {"rtol": 0, "atol": COMPANY.get(metric, 0.0)}
    together = computed(metric, truth, drawn)
    assert len(set(together.tolist())) > 2
    alone = [computed(metric, truth[i : i + 1], drawn[i : i + 1])[0] for i in range(4)]
    np.testing.assert_allclose(alone, together, **close)
    if metric not in DIRECTED:
        np.testing.assert_allclose(computed(metric, drawn, truth), together, **close)
    mirrored = truth[:, :, ::-1], drawn[:, :, ::-1]  # negative strides, which torch refuses
    copies = [side.copy() for side in mirrored]
    np.testing.assert_array_equal(computed(metric, *mirrored), computed(metric, *copies))


@pytest.mark.parametrize(("metric", "batch"), [("lpips", LPIPS_BATCH), ("dists", DISTS_BATCH)])
def test_more_images_than_a_batch_none_and_true_images_that_change(metric, batch):
    distance = NETWORKS[f"{metric} in float64"]
    a, b = (
        np.random.default_rng(seed).integers(0, 256, (batch + 2, 32, 32, 3), np.uint8)
        for seed in (6, 7)
    )
    together = distance(a, b)
    np.testing.assert_allclose(distance(a[batch:], b[batch:]), together[batch:], rtol=1e-12)
    assert distance(a[:0], b[:0]).shape == (0,)
    # What is kept of the images of the last call is not taken for those of this one.
    few, before = a[:2], distance(a[:2], b[:2])
    few[0, 0, 0] ^= 255
    changed = distance(few, b[:2])
    assert changed[0] != before[0]
    np.testing.assert_array_equal(changed, distance(few.copy(), b[:2].copy()))


# --- features of images ---------------------------------------------------------------------------


def largest_move(root, features, rows):
    """The largest move of a distance whose features are off by FEATURES_IN_FLOAT32 in both sets.

    Its root moves by at most D = e sqrt(d n / (n - 1)) a set: it is a metric, and pairing each row
    with itself is one way to carry one Gaussian to the other (Gelbrich 1990).
    """
    move = 2 * FEATURES_IN_FLOAT32 * math.sqrt(features * rows / (rows - 1))
    return 2 * root * move + move**2


@pytest.mark.parametrize("metric", OF_FEATURES)
def test_distances_of_few_images(metric):
    features, images = extractor(metric), boxes()
    d = 256 if metric == "fd-alexnet" else 64
    within = rounding_of_frechet(features(images), features(images))
    assert 0 <= computed(metric, images, images) <= within
    assert 0 <= computed(metric, images, images[::-1]) <= largest_move(0, d, 6)
    white, black = flat(255, 3), flat(0, 3)
    assert 0 <= computed(metric, white, white) <= largest_move(0, d, 3)
    square = ((features(white)[0].astype(float) - features(black)[0]) ** 2).sum()
    off = largest_move(math.sqrt(square), d, 3)
    assert computed(metric, white, black) == pytest.approx(square, rel=0, abs=off)
    for few in (1,) if metric == "fd-alexnet" else (0, 1):  # AlexNet takes no empty stack
        with pytest.raises(TooFewSamples, match=re.escape(f"[{few}, {d}]")):
            computed(metric, flat(0, few), flat(255, few))


def test_of_colour_only_the_luma_counts_in_grey():
    luma = np.floor((boxes() @ np.array([299.0, 587.0, 114.0]) + 500) / 1000)  # rounded half up
    grey = np.repeat(luma.astype(np.uint8)[..., None], 3, axis=-1)
    features = extractor("fd-views-grey")(grey)
    within = rounding_of_frechet(features, features)
    assert 0 <= computed("fd-views-grey", boxes(), grey) <= within


# --- angles ---------------------------------------------------------------------------------------


def answers(azimuth_deg, elevation_deg=0.0, length=1.0, dtype=np.float32):
    """The answers of a judge that is never wrong, [n, 3]."""
    radians = np.radians(np.array(azimuth_deg, np.float64))
    elevation = np.full(len(radians), elevation_deg / 40)
    columns = length * np.sin(radians), length * np.cos(radians), elevation
    return np.stack(columns, axis=1).astype(dtype)


NAN = math.nan
ANGLE_DEG = math.degrees(2.0**-23)  # sine and cosine in float32
ANSWERS = {  # answers, true angles, expected errors of the azimuth and of the elevation
    "right": (answers([-170, 0, 90]), [-170, 0, 90], [0, 0, 0], None),
    "opposite": (answers([-90, 0]), [90, 180], [180, 180], None),
    "both sides of 180": (answers([179.5, -180]), [-179.5, 180], [1, 0], None),
    "turned ten million times": (answers([90]), [90 + 3.6e9], [0], None),
    "undecided": (np.zeros((2, 3), np.float32), [30, -120], [30, 120], [30, 120]),
    "tiny": (answers([90], length=1e-40), [90], [0], None),
    "huge": (answers([45], length=1e38), [45], [0], None),
    "ends of elevation": (answers([0, 0], 40), [40, -40], None, [0, 80]),
    "NaN": (np.full((2, 3), NAN, np.float32), [0, 30], [NAN, NAN], [NAN, NAN]),
    "none": (np.empty((0, 3), np.float32), [], [], []),
}


@pytest.mark.parametrize("name", ANSWERS)
def test_errors_of_angles(name):
    given, asked, azimuth, elevation = ANSWERS[name]
    if azimuth is not None:
        actual = azimuth_error_deg(given, np.array(asked, float))
        np.testing.assert_allclose(actual, azimuth, rtol=0, atol=ANGLE_DEG)
    if elevation is not None:
        actual = elevation_error_deg(given, np.array(asked, float))
        np.testing.assert_array_equal(actual, elevation)


def test_answers_in_float16():
    """Sine and cosine are off by 2^-11 of themselves."""
    given, asked = answers([30], 20, dtype=np.float16), np.array([20.0])
    off = math.degrees(2.0**-11)
    assert azimuth_error_deg(given, asked) == pytest.approx([10.0], rel=0, abs=off)
    assert elevation_error_deg(given, asked).tolist() == [0.0]
