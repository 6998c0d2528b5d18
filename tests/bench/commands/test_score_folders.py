"""`bench score IMAGES TRUTH`: images of two folders, without a run."""

from __future__ import annotations

import re
import struct
import zlib

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from bench.metrics.lpips_network import lpips

NAMES = {"a": (40, 64), "deep/b": (64, 48), "deep/c": (33, 35)}  # heights and widths in pixels


def write(path, pixels, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)


@pytest.fixture
def folders(tmp_path):
    """Return two folders of images, of several kinds of files, and their pixels by name."""
    random, pixels = np.random.default_rng(3), {}
    for name, size in NAMES.items():
        true = random.integers(0, 256, (*size, 3), np.uint8)
        true[:] = true[..., :1] if name == "a" else true
        drawn = np.clip(true + random.integers(-40, 40, true.shape), 0, 255).astype(np.uint8)
        write(tmp_path / f"drawn/{name}.webp", drawn, lossless=True)
        write(tmp_path / f"true/{name}.PNG", true[..., 0] if name == "a" else true)
        pixels[name] = true, drawn
    return tmp_path / "drawn", tmp_path / "true", pixels


def test_scores_are_those_of_other_implementations(folders, command, tmp_path):
    drawn, true, pixels = folders
    status, out, _ = command("score", drawn, true, "--out", tmp_path / "scores.csv")
    assert status == 0
    rows = pd.read_csv(tmp_path / "scores.csv", index_col="image")
    assert rows.index.tolist() == sorted(NAMES)
    for name, pair in pixels.items():
        _, windows = structural_similarity(
            *pair, channel_axis=2, gaussian_weights=True, use_sample_covariance=False, full=True
        )
        inner = windows[5:-5, 5:-5].mean()  # whole windows of 11 pixels
        expected = (peak_signal_noise_ratio(*pair), inner, lpips(*pair))
        assert rows.loc[name].to_numpy() == pytest.approx(expected, abs=2e-5)
    worst = rows["psnr"].idxmin()
    mean, least = rows["psnr"].mean(), rows["psnr"].min()
    assert f"| psnr | higher | {mean:.2f} | {least:.2f} | {worst} | 3 |" in out
    assert "| lpips | lower |" in out
    assert "* fid: not measured, no weights; add --inception-weights download" in out


def test_what_is_transparent_is_laid_on_white(tmp_path, command):
    half = np.zeros((40, 40, 4), np.uint8)
    half[:, :20, 3] = 255  # black on the left
    write(tmp_path / "drawn/a.png", half)
    write(tmp_path / "true/a.png", np.repeat(np.uint8([0, 255]), 20)[None].repeat(40, axis=0))
    status, out, _ = command("score", tmp_path / "drawn", tmp_path / "true")
    assert (status, "| ssim | higher | 1.000 | 1.000 | a | 1 |" in out) == (0, True)
    assert "* images with transparent pixels, which are laid on white: 1" in out


def others(folder):
    for number in range(4):
        write(folder / f"x{number}.png", np.zeros((40, 40), np.uint8))


def deep_png(width, height):
    """Return a black PNG of 16 bits a channel in RGB, which Pillow cannot write."""
    head = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    parts = [
        (b"IHDR", head),
        (b"IDAT", zlib.compress(bytes(height * (1 + 6 * width)))),
        (b"IEND", b""),
    ]
    sums = [struct.pack(">I", zlib.crc32(name + data)) for name, data in parts]
    chunks = [struct.pack(">I", len(d)) + n + d + s for (n, d), s in zip(parts, sums, strict=True)]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def two_frames(folder):
    frames = [Image.new("RGB", (64, 40), (grey,) * 3) for grey in (0, 200)]
    frames[0].save(folder / "a.webp", save_all=True, append_images=frames[1:], lossless=True)


REFUSED = {  # what is done to the folder of images, and what is said
    "a.webp: an animation of 2 images; write each to its own file": two_frames,
    "a.webp: has pixels of mode RGB with 16 bits a channel; write it as 8-bit": lambda folder: (
        folder / "a.webp"
    ).write_bytes(deep_png(64, 40)),
    "x0, x1, x2": others,
    "4 of 7 only in": others,
    "deep/b.webp: 31 x 64 pixels, and .*deep/b.PNG has 48 x 64; scale one": lambda folder: write(
        folder / "deep/b.webp", np.zeros((64, 31), np.uint8)
    ),
    "a.png.*a.webp.* has the same name|a.webp: a.png has the same": lambda folder: write(
        folder / "a.png", np.zeros((40, 64), np.uint8)
    ),
    "drawn: is the folder of a run; 'bench score .*drawn' alone": lambda folder: (
        folder / "manifest.json"
    ).write_text("{}"),
    "a.webp: not a readable PNG or JPEG or WEBP": lambda folder: (folder / "a.webp").write_text(
        "x"
    ),
    "a.webp: has pixels of mode I;16; write it as 8-bit": lambda folder: write(
        folder / "a.webp", np.zeros((40, 64), np.uint16), format="png"
    ),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_compared_is_refused(folders, refused, message):
    drawn, true, _ = folders
    REFUSED[message](drawn)
    line = refused("score", drawn, true)
    assert re.search(message, line), line


def test_small_images_missing_folders_and_options_without_truth_are_refused(tmp_path, refused):
    for name in ("drawn", "true"):
        write(tmp_path / name / "a.png", np.zeros((30, 64), np.uint8))
    pair = tmp_path / "drawn", tmp_path / "true"
    assert "a.png: 64 x 30 pixels, and lpips needs 31" in refused("score", *pair)
    (tmp_path / "empty").mkdir()
    assert "empty: no images in it (.png" in refused("score", pair[0], tmp_path / "empty")
    assert "--out: is for two folders" in refused("score", pair[0], "--out", "x.csv")
