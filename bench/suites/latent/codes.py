"""Paths between codes and sums of codes (the paper's Figures 5 and 6), and their measures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import starmap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.splat import Splat
from bench.catalogue.lookup import variant_of
from bench.catalogue.methods import find_method
from bench.judges.views import ViewsNetwork, view_features
from bench.metrics.structural_similarity import ssim_per_image
from bench.report.sheets import image_sheet
from bench.suites.latent.chairs import CHANGES, ChairPair, SpecifiedChair, Triple, specified_chairs
from data_prep.arrays import Floats
from data_prep.clouds.sampling import sample_surface
from data_prep.failures import BadInput, StageFailure
from data_prep.progress import progress
from data_prep.randomness import generator
from data_prep.rendering.images import to_uint8
from data_prep.rendering.opengl import render
from data_prep.scene import Mesh, PointCloud, Points, UInt8Images, View
from pc2pix.latent import add_difference, decode, interpolate
from pc2pix.losses import chamfer
from pc2pix.model import Decoder
from pc2pix.renderer import Pc2pixRenderer
from pc2pix.weights import load_decoder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Clouds = NDArray[np.float32]  # clouds [N, 2048, 3] in unit-sphere coordinates
Measured = dict[str, dict[str, float]]  # for each path or code, its values by metric

# --- figures --------------------------------------------------------------------------------------


class _StripTile(NamedTuple):
    """A cloud [N, 3] above an image uint8 [128, 128, 3] and perhaps the true one, with a title."""

    title: str
    cloud: Points
    image: NDArray[np.uint8]
    truth: NDArray[np.uint8] | None = None


_Strip = tuple[str, Sequence[_StripTile]]  # the row of one path or sum: its label and its tiles


def strips_figure(strips: Sequence[_Strip], view: View, **size: Any) -> Figure:
    """Return a figure with rows of clouds, images and, where there are any, true images.

    The titles of columns are those of the first strip. `size` holds further arguments of
    `image_sheet`.
    """
    rows = []
    for label, tiles in strips:
        rows.append((f"{label}\ndecoded", [draw_discs(tile.cloud, view) for tile in tiles]))
        rows.append((f"{label}\ndrawn", [tile.image for tile in tiles]))
        if any(tile.truth is not None for tile in tiles):
            none = np.full_like(tiles[0].image, 255)
            true = [none if tile.truth is None else tile.truth for tile in tiles]
            rows.append((f"{label}\ntrue", true))
    titles = [tile.title for tile in strips[0][1]]
    return image_sheet(titles, rows, **size)


def draw_discs(cloud: Points, view: View) -> NDArray[np.uint8]:
    """Return a cloud as discs, grey by depth: uint8 [128, 128, 3]."""
    splat = Splat()
    return to_uint8(splat.draw(splat.prepare(PointCloud(cloud)), [view]))[0]


# --- networks -------------------------------------------------------------------------------------

BUNDLED = "chair"  # the weights of the method `pc2pix`


@dataclass(frozen=True, eq=False)
class LatentNetwork:
    """A network that turns clouds into codes, and codes into clouds and images."""

    method: str
    renderer: Pc2pixRenderer
    decoder: Decoder
    decoder_sha256: str
    view: View

    def encode(self, name: str, cloud: PointCloud) -> Tensor:
        """Return the whitened code [1, d] of a cloud; `name` stands in error messages.

        Raises BadInput where the code is not finite.
        """
        with self._usable(f"encode {name}"):
            return self.renderer.prepare(cloud)

    def decode(self, codes: Tensor) -> NDArray[np.float32]:
        """Return clouds float32 [K, 2048, 3] of whitened codes [K, d]."""
        return decode(self.decoder, codes)

    def draw(self, codes: Tensor) -> NDArray[np.uint8]:
        """Return images uint8 [K, 128, 128, 3] of whitened codes [K, d], all from the same view.

        Raises BadInput where an image is not finite.
        """
        with self._usable("draw"):
            # Drawn one by one, as the last bits of an image would depend on the others of a batch.
            drawn = [self.renderer.draw(code[None], [self.view]) for code in codes]
        return to_uint8(np.concatenate(drawn))

    @contextmanager
    def _usable(self, what: str) -> Iterator[None]:
        try:
            yield
        except StageFailure as error:
            raise BadInput(
                f"{self.method}: cannot {what} ({error}); these weights cannot be measured"
            ) from error


def weights_of(method: str) -> str:
    """Return the name or path of a method's weights. Raises BadInput for a method without codes."""
    chosen = find_method(method)
    if chosen.family != "pc2pix":
        raise BadInput(
            f"--methods {method}: has no code to do arithmetic with; use pc2pix or "
            "pc2pix@FILE.safetensors"
        )
    return variant_of(chosen.id) or BUNDLED


def load_network(method: str, device: str, view: View) -> LatentNetwork:
    """Return a method's network with the decoder of its weights.

    Raises BadInput where the weights cannot be used, or their decoder is missing.
    """
    weights = weights_of(method)
    renderer = find_method(method).load(device)
    assert isinstance(renderer, Pc2pixRenderer)
    decoder, sha256 = load_decoder(weights, renderer.weights)
    return LatentNetwork(method, renderer, decoder.to(renderer.device), sha256, view)


def _sample_chair(
    chair: SpecifiedChair, view: View, seed: int
) -> tuple[PointCloud, NDArray[np.uint8]]:
    """Return the cloud [2048, 3] of a chair, and its true image uint8 [128, 128, 3]."""
    mesh = chair.load()
    return cloud_of(mesh, chair, seed), render(mesh, [view])[0]


def cloud_of(mesh: Mesh, chair: SpecifiedChair, seed: int) -> PointCloud:
    """Return the 2,048 points that other suites sample for the same chair and seed."""
    sampled = sample_surface(mesh, generator(seed, "cloud", "chair", chair.id))
    return PointCloud(sampled.points)  # leaves out the mesh, which no method may see


# --- paths ----------------------------------------------------------------------------------------

CODE, FADE, NOISE, TRUTH = "code", "cross-fade", "noise", "truth"

PATHS = {
    CODE: "straight line between the whitened codes of two test chairs, decoded and drawn",
    FADE: "the images at its two ends faded into each other: no chair in between, and yet even",
    NOISE: "straight line between two random codes, each number from N(0, 1)",
    TRUTH: "true images of the two chairs: what the classifier makes of the real thing",
}
PATH_METRICS = {
    "picture-unevenness": "largest step over mean step between neighbouring images (root mean "
    "square); 1 is even",
    "picture-step": "mean step between neighbouring images, in 0..1",
    "cloud-unevenness": "largest step over mean step between neighbouring decoded clouds (Chamfer)",
    "cloud-step": "mean step between neighbouring decoded clouds",
    "end-cloud": "Chamfer distance of the decoded clouds at the ends to the original ones",
    "end-ssim": "SSIM of the images at the ends with the true ones",
    "end-to-end": "Chamfer distance between the decoded clouds at the two ends",
    "to-nearer-end": "Chamfer distance of what is decoded in between to the nearer decoded end",
    "family-confidence": "largest probability that the classifier of `fd-views` gives to a "
    "structural family, mean along the path",
    "family-confidence-min": "the smallest along the path",
}
PATH_REMARK = (
    "Means over paths with 95 % intervals. Chamfer distances are in squared radii of the unit "
    "sphere: mean squared distance to the nearest point, there and back. "
    "An even path is no achievement by itself: a cross-fade is even, and so is a network that "
    "draws next to nothing of a code. Read evenness beside the length of the steps, and beside "
    "the classifier's confidence, which asks whether the images in between still show some kind "
    "of thing. All ends are chairs, hence no confidence in a class: `family-confidence` is about "
    "structural families, of any class. A classifier can be sure of nonsense, too."
)


def walk(
    network: LatentNetwork, classifier: ViewsNetwork, pair: ChairPair, seed: int, positions: int
) -> tuple[Measured, _Strip]:
    """Return the values of a path between two chairs with its baselines, and its strip."""
    chairs = (pair.start, pair.end)
    ends = [_sample_chair(chair, network.view, seed) for chair in chairs]
    (start_cloud, _), (end_cloud, _) = ends
    start = network.encode(pair.start.id, start_cloud)
    end = network.encode(pair.end.id, end_cloud)
    line = interpolate(start, end, positions)
    clouds, images = network.decode(line), network.draw(line)
    true_clouds = np.stack([cloud.points for cloud, _ in ends])
    true_images = np.stack([image for _, image in ends])
    rng = generator(seed, "latent noise", pair.id)
    random = torch.from_numpy(rng.standard_normal((2, start.shape[1])).astype(np.float32))
    first_code, last_code = random.to(start.device).split(1)
    random_line = interpolate(first_code, last_code, positions)
    of_code = _evenness(classifier, images) | _cloud_path(clouds)
    of_code["end-cloud"] = _chamfer_distances(clouds[[0, -1]], true_clouds).mean()
    of_code["end-ssim"] = ssim_per_image(true_images, images[[0, -1]]).ssim.mean()
    of_fade = _evenness(classifier, _cross_fade(images[0], images[-1], positions))
    of_noise = _evenness(classifier, network.draw(random_line))
    of_noise |= _cloud_path(network.decode(random_line))
    of_truth = _confidence(classifier, true_images)
    measured: Measured = {CODE: of_code, FADE: of_fade, NOISE: of_noise, TRUTH: of_truth}
    between = [
        _StripTile(f"{i}/{positions - 1}", cloud, image)
        for i, (cloud, image) in enumerate(zip(clouds, images, strict=True))
    ]
    first, last = (_StripTile("original", cloud.points, image) for cloud, image in ends)
    label = f"{pair.start.spec.family}\nto {pair.end.spec.family}"
    return measured, (label, [first, *between, last])


def _evenness(classifier: ViewsNetwork, images: UInt8Images) -> dict[str, float]:
    steps = image_steps(images)
    values = {"picture-unevenness": unevenness(steps), "picture-step": steps.mean()}
    return values | _confidence(classifier, images)


def _confidence(classifier: ViewsNetwork, images: UInt8Images) -> dict[str, float]:
    values = family_confidence(classifier, images)
    return {"family-confidence": values.mean(), "family-confidence-min": values.min()}


def _cloud_path(clouds: Clouds) -> dict[str, float]:
    steps = _chamfer_distances(clouds[:-1], clouds[1:])
    between = clouds[1:-1]
    to_first = _chamfer_distances(between, np.broadcast_to(clouds[0], between.shape))
    to_last = _chamfer_distances(between, np.broadcast_to(clouds[-1], between.shape))
    return {
        "cloud-unevenness": unevenness(steps),
        "cloud-step": steps.mean(),
        "end-to-end": _chamfer_distances(clouds[:1], clouds[-1:])[0],
        "to-nearer-end": np.minimum(to_first, to_last).mean(),
    }


# --- sums -----------------------------------------------------------------------------------------

SUM, NOTHING, TRAIN, ANSWER = "a-b+c", "c", "nearest-train", "d"

ANSWERS = {
    SUM: "A - B + C",
    NOTHING: "C, left as it is: the floor",
    TRAIN: "the train chair whose code is nearest to A - B + C",
    ANSWER: "the code of D itself: the ceiling for this encoder, decoder and generator",
}
SUM_METRICS = {
    "cloud": "Chamfer distance of the decoded cloud to the cloud of D",
    "ssim": "SSIM of the drawn image with the true one of D",
    "code": "root-mean-square difference to the code of D, in standard deviations",
    "cloud-gain": "how much smaller `cloud` is than doing nothing, paired; above 0 is better",
    "ssim-gain": "how much larger `ssim` is than doing nothing, paired; above 0 is better",
    "cosine": "of the angle between A - B and D - C: 1 where the change is one direction in the "
    "space of codes, 0 where it has nothing in common from chair to chair",
}
SUM_REMARK = (
    "A is B with one change, D is C with the same change, so that A - B + C has a right answer. "
    + "Changes: "
    + "; ".join(f"{change.id}: {change.about}" for change in CHANGES)
    + ". Means over triples with 95 % intervals."
)


def add_up(
    network: LatentNetwork, triple: Triple, train: Tensor, seed: int
) -> tuple[Measured, _Strip]:
    """Return the values of A - B + C with its baselines, and its strip; `train` is [N, d]."""
    chairs = (triple.a, triple.b, triple.c, triple.d)
    sampled = [_sample_chair(chair, network.view, seed) for chair in chairs]
    a, b, c, d = [
        network.encode(chair.id, cloud) for chair, (cloud, _) in zip(chairs, sampled, strict=True)
    ]
    total = add_difference(a, b, c)
    nearest = train[(train - total).square().sum(dim=1).argmin()][None]
    codes = {SUM: total, NOTHING: c, TRAIN: nearest, ANSWER: d}
    stacked = torch.cat(list(codes.values()))
    clouds, images = network.decode(stacked), network.draw(stacked)
    answer, true_image = sampled[-1]  # of D
    count = len(codes)
    columns = {  # the values of all codes, by metric
        "cloud": _chamfer_distances(clouds, np.stack([answer.points] * count)),
        "ssim": ssim_per_image(np.stack([true_image] * count), images).ssim,
        "code": (stacked - d).square().mean(dim=1).sqrt().cpu().numpy(),
    }
    measured: Measured = {}
    for row, what in enumerate(codes):
        measured[what] = {metric: values[row] for metric, values in columns.items()}
    floor = measured[NOTHING]
    for what in (SUM, TRAIN, ANSWER):
        measured[what]["cloud-gain"] = floor["cloud"] - measured[what]["cloud"]
        measured[what]["ssim-gain"] = measured[what]["ssim"] - floor["ssim"]
    measured[SUM]["cosine"] = cosine((a - b)[0].cpu().numpy(), (d - c)[0].cpu().numpy())
    terms = torch.cat([a, b, c])
    true = [image for _, image in sampled[:3]]
    shown = zip(("A", "− B", "+ C"), network.decode(terms), network.draw(terms), true, strict=True)
    tiles = list(starmap(_StripTile, shown))
    tiles.append(_StripTile("= A − B + C", clouds[0], images[0]))
    tiles.append(_StripTile("D by its code", clouds[-1], images[-1], true_image))
    return measured, (triple.change, tiles)


def train_codes(network: LatentNetwork, count: int) -> Tensor:
    """Return the codes [count, d] of the first chairs of the train split."""
    with progress(f"train chairs, {network.method}", count) as advance:
        codes = []
        for chair in specified_chairs("train", count):
            codes.append(network.encode(chair.id, cloud_of(chair.load(), chair, seed=0)))
            advance(0)
    return torch.cat(codes)


# --- measures -------------------------------------------------------------------------------------


def unevenness(steps: Floats) -> float:
    """Return the largest of the steps [K - 1] of a path over their mean: 1 where all are equal.

    At most K - 1, for a single jump; NaN for a path without any move.
    """
    mean = steps.mean()
    return float(steps.max() / mean) if mean > 0 else float("nan")


def image_steps(images: UInt8Images) -> Floats:
    """Return the RMS difference of neighbours [K - 1], 0..1, along a path of K images."""
    values = images.astype(np.float64) / 255
    return np.sqrt(np.square(np.diff(values, axis=0)).mean(axis=(1, 2, 3)))


def _chamfer_distances(a: Clouds, b: Clouds) -> Floats:
    """Return the Chamfer distance [N] of each pair of clouds, in squared radii, as in training.

    It is the mean squared distance to the nearest neighbour, from a to b plus from b to a.
    """
    distances = []
    for first, second in zip(a, b, strict=True):
        distances.append(float(chamfer(torch.tensor(first)[None], torch.tensor(second)[None])))
    return np.array(distances)


def _cross_fade(start: NDArray[np.uint8], end: NDArray[np.uint8], positions: int) -> UInt8Images:
    """Return rounded weighted means [positions, H, W, 3] of two images [H, W, 3]; exact ends."""
    share = np.linspace(0, 1, positions)[:, None, None, None]
    return np.floor((1 - share) * start + share * end + 0.5).astype(np.uint8)


def family_confidence(network: ViewsNetwork, images: UInt8Images) -> Floats:
    """Return the classifier's largest probability of a structural family [N]."""
    features = torch.from_numpy(view_features(network, images))
    with torch.inference_mode():
        return network.heads["family"](features).double().softmax(dim=1).amax(dim=1).numpy()


def cosine(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Return the cosine of the angle between two vectors [d]; NaN where one is zero."""
    x, y = a.astype(np.float64), b.astype(np.float64)
    length = np.linalg.norm(x) * np.linalg.norm(y)
    return float(x @ y / length) if length > 0 else float("nan")
