from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from bench.draw.files import in_one_palette, write_images
from data_prep.failures import BadInput, CannotWrite
from data_prep.randomness import generator


def frames_of(path):
    """All frames in RGB, and how long each stays."""
    with Image.open(path) as film:
        frames, durations = [], []
        for i in range(getattr(film, "n_frames", 1)):
            film.seek(i)
            frames.append(np.asarray(film.convert("RGB")))
            durations.append(film.info.get("duration"))
        return np.stack(frames), durations, film.info.get("loop")


def noise(count, colours):
    """Frames on white, each other than the one before, in so many colours at most."""
    rng = generator("test")
    palette = rng.integers(0, 255, (colours, 3), dtype=np.uint8)
    frames = np.full((count, 40, 50, 3), 255, np.uint8)
    frames[:, 10:30, 10:30] = palette[rng.integers(0, colours, (count, 20, 20))]
    return frames


def test_one_image(tmp_path):
    image = noise(1, 5000)[0]
    write_images(image, tmp_path / "new" / "OUT.PNG")
    with Image.open(tmp_path / "new" / "OUT.PNG") as written:
        assert (written.format, written.mode) == ("PNG", "RGB")
        assert not getattr(written, "is_animated", False)
        assert np.array_equal(np.asarray(written), image)


@pytest.mark.parametrize(("suffix", "colours"), [("gif", 255), ("webp", 5000)])
def test_films_loop_and_show_what_they_were_given(tmp_path, suffix, colours):
    """A GIF in as many colours as there may be: white and 255 others."""
    given = noise(12, colours)
    write_images(given, tmp_path / f"turn.{suffix}")
    frames, durations, loop = frames_of(tmp_path / f"turn.{suffix}")
    assert np.array_equal(frames, given)
    assert loop == 0  # for ever
    assert durations == [300] * 12


def test_greys_keep_their_shades_beside_many_colours():
    """50 greys of 400 pixels each, 5,000 colours of one: by pixels the greys are four fifths.

    Were all colours alike, the greys would get 1 in 100 places of the palette, two or three, and
    lie 20 levels off on average; weighted by roots they have 20 times as much of it.
    """
    frame = generator("test").integers(0, 255, (1, 100, 250, 3), dtype=np.uint8)
    greys = np.repeat(np.arange(5, 255, 5), 400).astype(np.uint8)
    frame.reshape(-1, 3)[:20_000] = greys[:, None]
    (image,) = in_one_palette(frame)
    shown = np.asarray(image.convert("RGB")).reshape(-1, 3)[:20_000].astype(int)
    assert np.abs(shown - greys[:, None]).mean() < 5  # the step between two of them


def test_still_pixels_do_not_flicker():
    """One colour, while all others change from frame to frame: it has one index."""
    frames = generator("test").integers(0, 255, (5, 30, 30, 3), dtype=np.uint8)
    frames[:, :3, :3] = (200, 30, 100)
    images = in_one_palette(frames)
    assert len({bytes(image.getpalette()) for image in images}) == 1
    assert len({index for image in images for index in np.asarray(image)[:3, :3].ravel()}) == 1


def test_an_opacity_is_kept_where_the_format_has_one(tmp_path):
    given = np.concatenate([noise(3, 500), noise(3, 200)[..., :1]], axis=3)
    given[..., 3] |= 1  # colours of what cannot be seen need not be kept
    for name in ("a.png", "a.webp"):
        write_images(given, tmp_path / name)
        with Image.open(tmp_path / name) as image:
            assert np.array_equal(np.asarray(image.convert("RGBA")), given[0])
    with pytest.raises(BadInput, match=r"a\.gif: a GIF cannot have transparent pixels"):
        write_images(given, tmp_path / "a.gif")


def test_what_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / "folder.gif").mkdir()
    with pytest.raises(CannotWrite, match="make room, or give another -o"):
        write_images(noise(3, 9), tmp_path / "folder.gif")
    assert [path.name for path in tmp_path.iterdir()] == ["folder.gif"]
