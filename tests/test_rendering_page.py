"""The commands of docs/rendering.md, as they stand there."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.test_shown_commands import BLOCK, shown

pytestmark = pytest.mark.slow

PAGE = Path(__file__).parents[1] / "docs" / "rendering.md"
BENCH = (sys.executable, "-c", "from bench.cli import main; main()")
FRAMES = {
    **dict.fromkeys(("chair.png", "pc2pix.png", "splat.png", "sheet.png", "lying.png"), 1),
    **dict.fromkeys(("coloured.png", "budget.png", "images/chair.png", "large.png"), 1),
    "turntable.gif": 36,
}
TILES = {"sheet.png": (3, 2), "turntable.gif": (4, 1)}  # columns, rows; of all others one image
WIDTH, HEIGHT = 256 + 6, 256 + 18 + 6  # of a tile: the image, its margin, its label


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where all of them have been run, in their order."""
    place = tmp_path_factory.mktemp("rendering")
    (script,) = (text for kind, text in BLOCK.findall(PAGE.read_text()) if kind == "python")
    subprocess.run([sys.executable, "-c", script], cwd=place, check=True)
    for command in shown(PAGE):
        subprocess.run([*BENCH, *shlex.split(command)], cwd=place, check=True)
    return place


def test_they_make_what_the_page_shows(folder):
    made = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert made == {"chair.ply", *FRAMES}
    for name, frames in FRAMES.items():
        with Image.open(folder / name) as image:
            assert getattr(image, "n_frames", 1) == frames
            tiles = TILES.get(name)
            size = (512, 512) if name == "large.png" else (128, 128)
            if tiles is not None:
                size = tiles[0] * WIDTH + 6, tiles[1] * HEIGHT + 6
            assert image.size == size


def test_the_images_of_the_page_are_of_these_commands(folder):
    """Sheet of the page: dots and splats, which depend on no driver and no rounding."""
    with (
        Image.open(PAGE.parent / "render-sheet.png") as shown,
        Image.open(folder / "sheet.png") as made,
    ):
        theirs, ours = (np.asarray(image.convert("RGB")) for image in (shown, made))
    for column, row in ((0, 0), (2, 1)):
        left, top = 6 + column * WIDTH, 24 + row * HEIGHT
        tile = np.s_[top : top + 256, left : left + 256]
        assert np.array_equal(theirs[tile], ours[tile])
