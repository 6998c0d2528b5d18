"""The suite `latent` from end to end, with a network that has not learned anything."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
import torch
from PIL import Image

from bench.analysis.intervals import mean_interval
from bench.judges import VIEWS_WEIGHTS
from bench.judges.views import load_views_network
from bench.metrics.structural_similarity import ssim
from bench.running.options import Options
from bench.suites.latent.chairs import ALL, choose_pairs, choose_triples, specified_chairs
from bench.suites.latent.codes import (
    ANSWER,
    NOTHING,
    SUM,
    TRAIN,
    add_up,
    cloud_of,
    cosine,
    family_confidence,
    image_steps,
    load_network,
    unevenness,
    walk,
)
from bench.suites.latent.run import LATENT, VALUES, means, run
from data_prep.failures import BadInput
from data_prep.files.checksums import file_sha256
from data_prep.rendering.opengl import render
from data_prep.scene import View
from learning import checkpoint
from pc2pix.weights import decoder_path, load_weights
from tests.learning.trainings import whole

SMALL = replace(LATENT, pairs=3, triples=3, pool=60, neighbours=5, positions=4, shown=2)


@pytest.fixture(scope="session")
def untrained(tmp_path_factory):
    """Weights as they are before any training, with a decoder beside them."""
    path = tmp_path_factory.mktemp("latent") / "small.safetensors"
    path.write_bytes(whole("pc2pix"))
    decoder_path(path).write_bytes(whole("decoder"))
    return path


def stated(untrained, out, **changes):
    methods = (f"pc2pix@{untrained}",)
    return Options(suite="latent", methods=methods, device="cpu", out=out, **changes)


@pytest.fixture(scope="session")
def measured(untrained, tmp_path_factory):
    """A run of three paths and three sums."""
    return run_small(stated(untrained, tmp_path_factory.mktemp("latent") / "run"))


def run_small(options):
    return run(options, SMALL, environment=dict)


FILES = [
    *("latent_arithmetic.csv", "latent_arithmetic.md", "latent_arithmetic_values.csv"),
    *("latent_interpolation.csv", "latent_interpolation.md", "latent_interpolation_values.csv"),
]


def test_what_a_run_leaves(measured, untrained):
    directory = measured.directory
    assert {p.name for p in directory.iterdir()} == {"figures", "lock", "manifest.json", "tables"}
    assert sorted(p.name for p in (directory / "tables").iterdir()) == FILES
    figures = sorted((directory / "figures").iterdir())
    assert [path.name for path in figures] == ["arithmetic.png", "interpolation.png"]
    for path in figures:
        assert np.asarray(Image.open(path).convert("RGB")).std() > 1, "something is drawn"
    manifest = json.loads((directory / "manifest.json").read_text())
    assert manifest["finished"] is not None
    assert (manifest["suite"], manifest["dataset"], manifest["seed"]) == ("latent", "procedural", 0)
    assert len(manifest["pairs"]) == len(manifest["triples"]) == 3
    files = {"weights": untrained, "decoder": decoder_path(untrained)}
    (weights,) = manifest["weights"].values()
    assert weights == {name: file_sha256(path) for name, path in files.items()}


def test_tables_are_the_means_of_the_values(measured):
    folder = measured.directory / "tables"
    for table in measured.tables:
        assert (folder / f"{table.name}.csv").read_text() == table.to_csv()
        assert (folder / f"{table.name}.md").read_text() == table.to_markdown()
        values = pd.read_csv(folder / f"{table.name}_values.csv").groupby(["what", "metric"])
        means, counts = values["value"].mean(), values["value"].count()
        for row in pd.read_csv(folder / f"{table.name}.csv").query("kind == 'all'").itertuples():
            assert counts[row.what, row.metric] == row.n == 3
            # six digits each
            assert row.value == pytest.approx(means[row.what, row.metric], rel=1e-4, abs=1e-7)


@dataclass(frozen=True)
class Known:
    """Stands in for a network: codes by chair; a code is a point and a level of grey."""

    codes: dict[str, list[float]]
    method: str = "known"
    view = View(30, 20)  # the same for all

    def encode(self, name, cloud):
        return torch.tensor([self.codes[name]])

    def decode(self, codes):
        return codes[:, None, :].numpy()

    def draw(self, codes):
        levels = codes[:, 0].mul(100).byte().numpy()
        return np.broadcast_to(levels[:, None, None, None], (len(levels), 128, 128, 3)).copy()


def squared_to(point, chair):
    """Chamfer distance of one point to the cloud of a chair."""
    squared = np.square(cloud_of(chair.load(), chair, 0).points - np.float32(point)).sum(1)
    return squared.min() + squared.mean()


def test_known_sums():
    (triple,) = choose_triples(specified_chairs("test", 60), 1, np.random.default_rng(0))
    a, b, c, d = [2.5, 1, 0], [1.5, 1, 0], [0, 0, 1], [1, 0, 2]
    names = (chair.id for chair in (triple.a, triple.b, triple.c, triple.d))
    network = Known(dict(zip(names, (a, b, c, d), strict=True)))
    train = torch.tensor([[2.5, 1, 0], [1, 0.5, 1], [1, -1, 1]])  # A, near to the sum, farther
    values, (_, tiles) = add_up(network, triple, train, 0)
    measured = {(what, metric): value for what in values for metric, value in values[what].items()}
    points = {SUM: [1, 0, 1], NOTHING: c, TRAIN: [1, 0.5, 1], ANSWER: d}
    for what, point in points.items():
        # float32 sums of 2,048 numbers
        assert measured[what, "cloud"] == pytest.approx(squared_to(point, triple.d), rel=1e-4)
        difference = np.sqrt(np.mean(np.square(np.subtract(point, d))))
        assert measured[what, "code"] == pytest.approx(difference, abs=1e-6)
        truth = render(triple.d.load(), [network.view])
        image = network.draw(torch.tensor([point]).float())
        assert measured[what, "ssim"] == pytest.approx(ssim(truth, image).ssim, abs=1e-12)
        for metric, sign in (("cloud", -1), ("ssim", 1)) if what != NOTHING else ():
            gain = sign * (measured[what, metric] - measured[NOTHING, metric])
            assert measured[what, f"{metric}-gain"] == pytest.approx(gain, abs=1e-12)
    assert (NOTHING, "cloud-gain") not in measured
    # A - B is (1, 0, 0), D - C is (1, 0, 1)
    assert measured[SUM, "cosine"] == pytest.approx(np.sqrt(0.5))
    assert [tile.cloud.tolist() for tile in tiles] == [[a], [b], [c], [[1, 0, 1]], [d]]
    assert tiles[3].truth is None


def test_a_known_path():
    pair = choose_pairs(specified_chairs("test", 2), np.random.default_rng(0))[0]
    network = Known({pair.start.id: [0.0, 0, 0], pair.end.id: [2.0, 0, 0]})
    values, (_, tiles) = walk(network, load_views_network(VIEWS_WEIGHTS), pair, 0, 5)
    measured = {(what, metric): value for what in values for metric, value in values[what].items()}
    assert [tile.cloud[0, 0] for tile in tiles[1:-1]] == [0, 0.5, 1, 1.5, 2]
    for what in ("code", "cross-fade"):  # grey levels 0, 50, 100, 150, 200
        assert measured[what, "picture-unevenness"] == pytest.approx(1, abs=1e-12)
        assert measured[what, "picture-step"] == pytest.approx(50 / 255, abs=1e-12)
    # Chamfer distances of two points are twice the squared way
    assert measured["code", "cloud-unevenness"] == 1
    assert measured["code", "cloud-step"] == 0.5
    assert measured["code", "end-to-end"] == 8
    assert measured["code", "to-nearer-end"] == pytest.approx((0.5 + 2 + 0.5) / 3)
    ends = [squared_to([0, 0, 0], pair.start), squared_to([2, 0, 0], pair.end)]
    assert measured["code", "end-cloud"] == pytest.approx(np.mean(ends), rel=1e-4)
    truth = [render(chair.load(), [network.view]) for chair in (pair.start, pair.end)]
    drawn = network.draw(torch.tensor([[0.0, 0, 0], [2.0, 0, 0]]))
    assert measured["code", "end-ssim"] == pytest.approx(ssim(np.concatenate(truth), drawn).ssim)
    for tile, true in zip((tiles[0], tiles[-1]), truth, strict=True):
        assert np.array_equal(tile.image, true[0])


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(measured, untrained, tmp_path):
    threads = torch.get_num_threads()
    again = run_small(stated(untrained, tmp_path / "again"))
    assert torch.get_num_threads() == threads
    other = run_small(stated(untrained, tmp_path / "other", seed=1, limit=2))
    for name in FILES:
        first, second, third = (
            (run.directory / "tables" / name).read_bytes() for run in (measured, again, other)
        )
        assert first == second != third
    assert other.tables[0].frame["n"][0] == 2


def test_a_rerun_starts_over_and_a_smaller_limit_keeps_the_run(measured, untrained, tmp_path):
    directory = shutil.copytree(measured.directory, tmp_path / "run")
    before = {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}
    with pytest.raises(BadInput, match=r"run: holds a run with 2 more pairs, .* give a new --out"):
        run(stated(untrained, directory, limit=1), SMALL)
    assert {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()} == before
    (directory / "figures" / "interpolation-2.png").touch()
    (directory / "tables" / FILES[0]).write_text("old")
    run_small(stated(untrained, directory))
    assert (directory / "tables" / FILES[0]).read_bytes() == before[directory / "tables" / FILES[0]]
    assert len(list((directory / "figures").iterdir())) == 2


def test_weights_without_their_decoder(untrained, tmp_path):
    bare, out = tmp_path / "bare.safetensors", tmp_path / "run"
    shutil.copy(untrained, bare)
    with pytest.raises(BadInput, match="there is no decoder for these weights"):
        run_small(stated(bare, out))
    assert not out.exists()


def test_the_decoder_command(command, untrained, tmp_path):
    path = tmp_path / "bare.safetensors"
    shutil.copy(untrained, path)
    arguments = ("train", "decoder", "--weights", path, "--objects", 3, "--steps", 2)
    status, out, err = command(*arguments, "--batch", 2, "--out", tmp_path / "training")
    assert (status, out) == (0, f"{tmp_path}/bare-decoder.safetensors\n")
    assert "decoder: step 2/2, chamfer " in err
    load_network(f"pc2pix@{path}", "cpu", View(0, 0))
    _, header = checkpoint.read_safetensors(decoder_path(path))
    assert header["weights"] == load_weights(path).sha256
    assert json.loads(header["training"])["steps"] == 2
    status, _, err = command(*arguments[:-1], 0, "--out", tmp_path / "training")
    assert (status, err) == (2, "bench: --steps 0: must be at least 1\n")


def flat(*levels):
    return np.stack([np.full((128, 128, 3), level, np.uint8) for level in levels])


def test_unevenness_is_the_largest_step_over_the_mean():
    steps = image_steps(flat(0, 51, 102, 153))
    np.testing.assert_allclose(steps, [0.2, 0.2, 0.2], rtol=1e-15)
    assert unevenness(steps) == pytest.approx(1, rel=1e-15)
    # steps 1, 1, 2: the largest over the mean of 4/3
    assert unevenness(image_steps(flat(10, 20, 30, 50))) == pytest.approx(1.5, rel=1e-12)
    assert unevenness(image_steps(flat(7, 7, 7, 200, 200))) == pytest.approx(4)  # one jump
    assert math.isnan(unevenness(image_steps(flat(9, 9, 9))))


def test_vectors_of_no_length_have_no_cosine():
    assert math.isnan(cosine(np.zeros(2), np.ones(2)))


def test_family_confidence():
    network = load_views_network(VIEWS_WEIGHTS)
    images = np.random.default_rng(2).integers(0, 256, (3, 128, 128, 3), dtype=np.uint8)
    with torch.no_grad():
        head = network.heads["family"]
        head.weight.zero_()
        head.bias.zero_()
        families = len(network.labels.families)  # all equally likely
        equal = np.full(3, 1 / families)
        np.testing.assert_allclose(family_confidence(network, images), equal, rtol=1e-12)
        head.bias[2] = math.log(families - 1)  # as likely as all others together
        np.testing.assert_allclose(family_confidence(network, images), [0.5] * 3, rtol=1e-6)


def values_of(numbers, what="code", kind=ALL, metric="step"):
    rows = [("pc2pix", what, kind, f"{kind} {i}", metric, x) for i, x in enumerate(numbers)]
    return pd.DataFrame(rows, columns=VALUES)


@pytest.mark.usefixtures("few_objects")
def test_means_and_intervals():
    """Missing values are counted; a kind has rows of its own after those of all."""
    (row,) = means("latent", values_of([1.0, 2.0, np.nan, 6.0])).itertuples()
    assert (row.kind, row.value, row.n_ok, row.n) == (ALL, 3, 3, 4)
    assert (row.ci_low, row.ci_high) == mean_interval(np.array([1.0, 2.0, 6.0]))
    kinds = [values_of([1.0, 3.0], kind="arms"), values_of([8.0], kind="slats")]
    rows = means("latent", pd.concat(kinds)).itertuples()
    expected = [(ALL, 4, 3), ("arms", 2, 2), ("slats", 8, 1)]
    assert [(row.kind, row.value, row.n) for row in rows] == expected
