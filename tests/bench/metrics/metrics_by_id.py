"""The metrics as functions of two arrays, by their ids: true images and images, two sets of
features, the judge's answers and the true angles."""

from __future__ import annotations

import functools

import numpy as np

from bench.catalogue.metrics import JUDGE, find_extractor
from bench.judges.answers import azimuth_error_deg, elevation_error_deg
from bench.metrics.frechet import frechet_distance
from bench.metrics.image_scores import FURTHER_SCORES, further_score, scores
from bench.metrics.lpips_network import lpips
from bench.metrics.peak_signal_to_noise import psnr
from bench.metrics.silhouette import Pairs, overlap
from bench.metrics.structural_similarity import ssim_per_image
from bench.metrics.thin_parts import thin_scores

SSIM = ("ssim", "luminance", "contrast", "structure")
OF_FEATURES = ("fd-views", "fd-views-grey", "fd-alexnet")  # Fréchet distances of networks' features
ANGLES = ("azimuth-error-deg", "elevation-error-deg")


@functools.cache
def extractor(name):
    source = find_extractor(name)
    return source.load(str(source.weights(None)), "cpu")


def code_lengths(truth, images):
    """Return the length of the judge's shape code of each image; NaN if not finite."""
    answers = extractor(JUDGE)(images).astype(np.float64)
    return np.linalg.norm(answers[:, 3:], axis=1) + 0.0 * answers[:, :3].sum(axis=1)


def distance_of_features(name, truth, images):
    return frechet_distance(extractor(name)(truth), extractor(name)(images))


def silhouette_iou(truth, images):
    pairs = Pairs(truth, images)
    return overlap(pairs.shown, pairs.drawn(pairs.shown))


METRICS = {
    **{name: lambda a, b, name=name: getattr(ssim_per_image(a, b), name) for name in SSIM},
    "psnr": psnr,
    "ssim-object": lambda a, b: scores(a, b)["ssim_object"],
    "silhouette-iou": silhouette_iou,
    "thin-recall": lambda a, b: thin_scores(Pairs(a, b)).recall,
    "thin-precision": lambda a, b: thin_scores(Pairs(a, b)).precision,
    "lpips": functools.partial(lpips, single=True),
    **{name: further_score(name, "cpu") for name in FURTHER_SCORES},
    "frechet-distance": frechet_distance,
    **{name: functools.partial(distance_of_features, name) for name in OF_FEATURES},
    JUDGE: code_lengths,
    ANGLES[0]: azimuth_error_deg,
    ANGLES[1]: elevation_error_deg,
}


def rounding_of_frechet(x, y):
    """Return the rounding of the distance of two sets: a singular value errs by a few 2^-53 of the
    largest one, the sum of d of them by d times that of the traces; 1e-12 is for d = 2,048."""
    x, y = x.astype(np.float64), y.astype(np.float64)
    shift = x.mean(axis=0) - y.mean(axis=0)
    return 1e-12 * float(x.var(axis=0, ddof=1).sum() + y.var(axis=0, ddof=1).sum() + shift @ shift)
