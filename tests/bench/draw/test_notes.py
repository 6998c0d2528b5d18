"""Notes of `bench render` on stderr: what methods did to the points of a cloud."""

from __future__ import annotations

import numpy as np
import pytest

from data_prep.randomness import generator

MOST = 8192  # points that splat-net and splat-fill use


@pytest.fixture
def clouds(tmp_path):
    """Return a folder with spheres of one point more than these methods use, and of 300."""
    folder = tmp_path / "clouds"
    folder.mkdir()
    points = generator("notes").normal(size=(MOST + 1, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    for name, count in (("few", 300), ("many", MOST + 1), ("more", MOST + 1)):
        np.save(folder / f"{name}.npy", points[:count])
    return folder


def notes_of(stderr: str) -> list[str]:
    return [line for line in stderr.splitlines() if line.startswith("note: ")]


USED = f"input: {MOST} of {MOST + 1} points used"
CASES = {  # what is drawn, by which methods, into which name, and the notes on it
    "one image": ("many.npy", "splat-fill", "a.png", [f"/many.npy: splat-fill: {USED}"]),
    "of few points": ("few.npy", "splat-fill", "a.png", []),
    "turntable": ("many.npy", "splat-fill", "a.gif", [f"/many.npy: splat-fill: {USED}"]),
    "sheet": (
        *("many.npy", "splat-net@grey,splat,splat-fill", "a.png"),
        [f"/many.npy: splat-net@grey: {USED}", f"/many.npy: splat-fill: {USED}"],
    ),
    "folder": ("", "splat-fill", "images", [f"/many.npy and 1 more: splat-fill: {USED}"]),
}


@pytest.mark.parametrize("case", CASES)
def test_a_note_of_a_method_is_a_line_with_its_cloud_and_name(command, clouds, tmp_path, case):
    name, methods, out, said = CASES[case]
    frames = ("--frames", "2") if out.endswith(".gif") else ()
    drawn = ("render", clouds / name, "--method", methods, *frames, "-o", tmp_path / out)
    status, _, err = command(*drawn)
    assert (status, notes_of(err)) == (0, [f"note: {clouds}{line}" for line in said])


def test_what_was_smoothed_and_what_has_no_mesh_is_said(command, tmp_path):
    fog, nine = tmp_path / "fog.npy", tmp_path / "nine.npy"
    points = generator("notes").normal(size=(1000, 3))
    np.save(fog, points)
    np.save(nine, points[:9])
    noise, smoothed = notes_of(command("render", fog, "--method", "denoised-wrap")[2])
    assert noise.startswith(f"note: {fog}: denoised-wrap: noise: 0.")
    assert smoothed.startswith(f"note: {fog}: denoised-wrap: smoothed: 2 times over ")
    assert notes_of(command("render", nine)[2])[0] == (
        f"note: {nine}: fused-net@grey: upsampled-wrap: no mesh, input: 9 points; surfaces need "
        "at least 11"
    )
