"""Every metric at the edges of its domain: closed forms, invariants and refusals by name.

Comparisons with other implementations are in the tests of each metric. NumPy's warnings are errors
(pyproject.toml).

Tolerances, with U = 2^-53: a mean over the 118 x 118 windows of three channels is off by SUMS at
most, sums of at most 576 x 3 values of at most 1, and of 25 tiles. FLIP and the networks compute in
float32.
"""

from __future__ import annotations

import functools
import math
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bench.catalogue.metrics import JUDGE
from bench.judges.answers import azimuth_error_deg, elevation_error_deg
from bench.metrics import psnr, ssim
from bench.metrics.dists import dists
from bench.metrics.frechet import TooFewSamples
from bench.metrics.inception_weights import WeightsUnavailable
from bench.metrics.kernel_distance import kernel_distance
from bench.metrics.lpips_network import lpips
from bench.metrics.silhouette import contrast, foreground, object_boxes
from bench.metrics.thin_parts import evaluated

from .metrics_by_id import METRICS, OF_FEATURES, SSIM, extractor, rounding_of_frechet

C1 = 2.55**2  # by the protocol, not the code's own
U = 2.0**-53
SUMS = (576 * 3 + 25) * U
FLIP_IN_FLOAT32 = 1e-6
FEATURES_IN_FLOAT32 = 1e-4  # sums of up to 864 products a layer, of features up to some 10
CODE_LENGTH = 18 * 2.0**-24  # half of the 32 roundings of a sum of squares, a root, a quotient
FLIP_WHITE_BLACK = 0.967388  # of every pixel, printed by the tool `flip` of the package, 1.7
THIN = ("thin-recall", "thin-precision")
INVENTED = ("invented-holes", "invented-parts")
SSIMS = (*SSIM, "ssim-object")
NETWORKS = {
    "lpips in float64": lpips,
    "lpips of vgg": functools.partial(lpips, net="vgg"),
    "lpips of squeeze": functools.partial(lpips, net="squeeze"),
    "dists in float64": dists,
    "st-lpips in float64": functools.partial(lpips, net="shift-tolerant"),
}
# Of one array: silhouettes and thin parts.
OF_ONE = (foreground, contrast, object_boxes, evaluated)
PARTS = {f"{f.__name__} of one": lambda a, b, f=f: f(a) for f in OF_ONE}
FUNCTIONS = METRICS | NETWORKS | PARTS | {"kernel-distance": kernel_distance}


def flat(level, count=1, side=128):
    return np.full((count, side, side, 3), level, np.uint8)


def noise(seed, side=128):
    return np.random.default_rng(seed).integers(0, 256, (1, side, side, 3), dtype=np.uint8)


def painted(level, rows, columns, ground=255):
    image = flat(ground)
    image[:, rows, columns] = level
    return image


def leg(level=80, rows=slice(40, 80), columns=slice(60, 63)):
    """A bar of 40 x 3 px on white, all of it thin."""
    return painted(level, rows, columns)


def boxes():
    """Six images of coloured boxes on white."""
    rng, images = np.random.default_rng(0), flat(255, 6)
    for image in images:
        top, left, height, width = rng.integers(10, 60, 4)
        image[top : top + height, left : left + width] = rng.integers(0, 255, 3)
    return images


def luminance(p, q):
    return (2 * p * q + C1) / (p * p + q * q + C1)


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


def test_two_images_are_a_pair():
    a, b = LEG[0], BLACK[0]
    assert ssim(a, b) == ssim(LEG[:1], BLACK[:1])
    for metric in (psnr, NETWORKS["lpips in float64"]):
        assert metric(a, b) == metric(LEG[:1], BLACK[:1])[0]
    with pytest.raises(ValueError, match=re.escape("must be [N, H, W, C]")):
        psnr(a, BLACK[:1])
    for metric in (ssim, psnr):  # a stack in grey is no image
        with pytest.raises(ValueError, match=re.escape("[N, H, W, C], got uint8 [1, 128, 128]")):
            metric(LEG[..., 0], BLACK[..., 0])


def test_grey_and_opacity_are_channels():
    """A channel that both images share scores 1."""
    coloured = ssim(LEG, BLACK).ssim
    opaque = (np.concatenate([x, WHITE[..., :1]], axis=3) for x in (LEG, BLACK))
    assert ssim(LEG[..., :1], BLACK[..., :1]).ssim == pytest.approx(coloured, abs=SUMS)
    assert ssim(*opaque).ssim == pytest.approx((3 * coloured + 1) / 4, abs=SUMS)


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


WHITE, BLACK, LEG = flat(255), flat(0), leg()
MOVED, HALF = leg(columns=slice(61, 64)), leg(rows=slice(40, 60))
TWO_LEGS, LEG_AND_WHITE = np.concatenate([LEG, LEG]), np.concatenate([LEG, WHITE])
BLACK_AND_LEG, WHITE_AND_LEG = np.concatenate([BLACK, LEG]), np.concatenate([WHITE, LEG])
DISTANCES = ("lpips", "lpips in float64", "lpips of vgg", "dists", "dists in float64", "st-lpips")
VALUES = [  # metrics, images, value, tolerance
    *((m, (x, x), 1.0, 0.0) for m in SSIM for x in (noise(1), LEG, WHITE, BLACK)),
    *(("ssim-object", (x, x), 1.0, 0.0) for x in (noise(1), LEG, BLACK)),
    *(  # flat against one pixel, which is in 121 windows of SSIM, or in one
        ("structure", (flat(p), painted(q, at, at, p)), 1.0, 0.0)
        for p, q in ((255, 254), (255, 0), (128, 127), (0, 255))
        for at in (0, 64)
    ),
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
    *(("flip", (x, x), 0.0, 0.0) for x in (noise(1), LEG, WHITE, BLACK)),
    ("flip", (WHITE, BLACK), FLIP_WHITE_BLACK, FLIP_IN_FLOAT32),
    ("flip", (BLACK, WHITE), FLIP_WHITE_BLACK, FLIP_IN_FLOAT32),
    *((m, (flat(0, 0), flat(0, 0)), 1.0, 0.0) for m in (*THIN, "silhouette-iou", JUDGE)),  # none
    *((m, (flat(0, 0), flat(0, 0)), 0.0, 0.0) for m in INVENTED),
    *((m, (x[:, 40:80, 40:80],) * 2, 0.0, 0.0) for m in DISTANCES for x in (noise(1), LEG, BLACK)),
    # Codes of length 1, and finite angles.
    *((JUDGE, (x, x), 1.0, CODE_LENGTH) for x in (BLACK, WHITE, LEG, noise(5))),
]


@pytest.mark.parametrize(("metric", "images", "expected", "within"), VALUES)
def test_values_of_images(metric, images, expected, within):
    assert_values(metric, *images, expected, within)


NOT_UINT8 = [(WHITE / 255, np.full(WHITE.shape, np.nan)), (WHITE.astype("i8"), LEG.astype("i8"))]
NOT_UINT8 += [(WHITE.astype("f4") / 255, LEG.astype("f4") / 255), (WHITE, LEG / 255)]
OF_OBJECTS = ("ssim-object", *THIN, "silhouette-iou")
BY_NETWORKS = ("fd-views", "fd-views-grey", JUDGE)
OF_DISTANCES = ("lpips", "lpips of vgg", "dists", "st-lpips")
EVERY = (
    *SSIM,
    "psnr",
    "flip",
    *OF_OBJECTS,
    *INVENTED,
    *BY_NETWORKS,
    "fd-alexnet",
    *OF_DISTANCES,
)
CHANNELS_4 = np.zeros((2, 128, 128, 4), np.uint8)
SIZES = (BLACK[:, :64], BLACK[:, :, :64], BLACK[..., :1], BLACK[0])  # that the judges do not take
OF_IMAGES = (*SSIM, "psnr", "flip", *OF_OBJECTS, *INVENTED, *OF_DISTANCES)
CHANNELS_FIRST = [BLACK.transpose(0, 3, 1, 2), np.repeat(BLACK[..., :1], 2, axis=3)]
NO_ARRAYS = [
    (BLACK.tolist(), "list"),
    ("image.png", "str"),
    (Path("image.png"), "pathlib.PosixPath"),
    (Image.fromarray(BLACK[0]), "PIL.Image.Image"),
]
X = np.random.default_rng(1).standard_normal((8, 4))
OF_SETS = ("frechet-distance", "kernel-distance")


def with_one(features, value):
    features = features.copy()
    features[3, 2] = value
    return features


REFUSED = [  # metrics, images, part of the message
    *((EVERY, x, "images must be uint8") for x in NOT_UINT8),
    *((PARTS, x, f"must be uint8 (range 0..255), got {x[0].dtype}") for x in NOT_UINT8[:3]),
    ((*SSIM, *OF_OBJECTS, *BY_NETWORKS, "dists"), (LEG[0],) * 2, "[128, 128, 3]"),
    ((*SSIM, *OF_OBJECTS, *INVENTED), (LEG[0, :, :, 0],) * 2, "[128, 128]"),
    (BY_NETWORKS, (LEG[0, :, :, 0],) * 2, "images must be uint8 ["),
    ((*BY_NETWORKS, *OF_DISTANCES, "flip"), (CHANNELS_4,) * 2, "images must be uint8 ["),
    *(
        (("fd-views", JUDGE), (x,) * 2, f"[N, 128, 128, 3], got {x.dtype} {list(x.shape)}")
        for x in (*SIZES, BLACK / 255)
    ),
    ((*SSIM, "psnr", "flip", *OF_DISTANCES), (flat(0, side=64), BLACK), "the same shape"),
    ((*OF_OBJECTS, *INVENTED), (flat(0, side=64), BLACK), "the same shape, got uint8 [1, 64"),
    (OF_FEATURES[:2], (flat(0, side=64), BLACK), "[1, 64, 64, 3]"),
    ((*SSIM, "psnr", *OF_DISTANCES), (BLACK, flat(0, 2)), "the same shape"),
    ((*OF_OBJECTS, *INVENTED), (BLACK, flat(0, 2)), "the same shape, got uint8 [1, 128"),
    ((*SSIMS, "psnr", "flip", *OF_DISTANCES), (flat(0, 0),) * 2, "nothing to compare"),
    ((*SSIMS, "psnr", *THIN), (BLACK[..., :0], BLACK[..., :0]), "nothing to compare"),
    *((OF_IMAGES, (x,) * 2, "channels") for x in CHANNELS_FIRST),
    *(
        ((*OF_IMAGES, *PARTS), (x,) * 2, f"arrays uint8 [N, H, W, C], got a {kind}; numpy.asarray")
        for x, kind in NO_ARRAYS
    ),
    (("st-lpips",), (BLACK[:, :20],) * 2, "of 21 x 21 pixels or more"),
    (("lpips",), (BLACK[:, :30],) * 2, "of 31 x 31 pixels or more"),
    (("lpips of vgg", "dists"), (BLACK[:, :, :15],) * 2, "of 16 x 16 pixels or more"),
    (("lpips of squeeze",), (BLACK, BLACK), "alex or vgg or shift-tolerant, got 'squeeze'"),
    (OF_SETS, (X[:0], X), "at least 2 samples, got float64 [0, 4]"),
    (OF_SETS, (X, X[:1]), "at least 2 samples, got float64 [1, 4]"),
    (OF_SETS, (X * 1e200, X * 1e200), "no finite covariance; scale them down"),
    (OF_SETS, (X.astype(complex), X), "features must be real numbers, got complex128"),
    (OF_SETS, (X > 0, X > 0), "features must be real numbers, got bool"),
    (OF_SETS, (X.astype(str), X), "features must be real numbers, got <U"),
    (OF_SETS, (X[:, 0], X), "features must be [n, d], got float64 [8]"),
    (OF_SETS, (X[:, :0], X[:, :0]), "features must be [n, d], got float64 [8, 0]"),
    (OF_SETS, (X[:, :3], X[:, :2]), "sets of 3 and 2 features"),
    (OF_SETS, (with_one(X, np.nan), X), "1 of 32 feature values are not finite"),
    (OF_SETS, (X, with_one(X.astype("f2"), -np.inf)), "1 of 32 feature values are not finite"),
    (OF_SETS, (X, X.astype("g") * np.longdouble("1e400")), "32 of 32 feature values are not"),
]


@pytest.mark.parametrize(("metrics", "images", "says"), REFUSED)
def test_refused_images(metrics, images, says):
    for metric in dict.fromkeys(metrics):
        with pytest.raises(ValueError, match=re.escape(says)) as caught:
            computed(metric, *images)
        assert caught.type is (TooFewSamples if "samples" in says else ValueError)


# Sums of up to 4,608 products of float64 in another order; of float32 for FLIP.
COMPANY = {"lpips in float64": 1e-12, "lpips of vgg": 1e-12, "dists in float64": 1e-12}
COMPANY |= {"flip": FLIP_IN_FLOAT32, "st-lpips in float64": 1e-12}
DIRECTED = ("ssim-object", "silhouette-iou", *THIN)


@pytest.mark.parametrize("metric", [*SSIM, "psnr", *OF_OBJECTS, *COMPANY])
def test_neither_company_nor_sides_nor_strides_matter(metric):
    part = slice(32, 96, 2 if metric in NETWORKS else 1)  # few pixels of what takes long
    truth = np.concatenate([boxes()[:2], LEG, WHITE])[:, part, part]
    drawn = np.concatenate([noise(1), boxes()[2:3], MOVED, BLACK])[:, part, part]
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


@pytest.mark.parametrize("metric", ["lpips in float64", "dists in float64"])
def test_what_is_kept_of_the_last_images_is_not_taken_for_others(metric):
    images = np.random.default_rng(6).integers(0, 256, (2, 32, 32, 3), np.uint8)
    before = computed(metric, images, images[::-1])
    images[0, 0, 0] ^= 255
    changed = computed(metric, images, images[::-1])
    assert changed[0] != before[0]
    np.testing.assert_array_equal(changed, computed(metric, images.copy(), images[::-1].copy()))


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
    "float16": (answers([45], 20, dtype=np.float16), [20], [25], [0]),  # equal sine and cosine
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
