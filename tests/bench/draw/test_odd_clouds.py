"""Clouds and meshes as users have them: drawn right, or with a note that says what is odd."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.draw.cloud_file import CloudFile
from data_prep.clouds.normalise import normalise_points
from data_prep.files.clouds import save_ply

POINTS = np.random.default_rng(0).uniform(-1, 1, (345, 3)).astype(np.float32)
BOX = "0 0 0\n0 0 2\n0 2 0\n0 2 2\n1 0 0\n1 0 2\n1 2 0\n1 2 2\n"
SIDES = "4 0 1 3 2\n4 4 6 7 5\n3 0 4 5\n3 0 5 1\n4 2 3 7 6\n4 0 2 6 4\n4 1 5 7 3\n"
RGB = "property uchar red\nproperty uchar green\nproperty uchar blue\n"


def box(sides: str = SIDES, more: str = "", properties: str = "", element: str = "face") -> str:
    return (
        f"ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
        f"property float z\nelement {element} {len(sides.splitlines())}\n"
        f"property list uchar int vertex_indices\n{properties}end_header\n{BOX}{sides}{more}"
    )


@pytest.mark.parametrize(
    ("far", "share"),
    [([[40, 3, 2]], "7.7"), (np.full((60, 3), -9999), "0.018"), ([[0, 0, 9]] * 3, "31")],
)
def test_far_points_are_named_and_left_out_if_asked_for(
    command, tmp_path: Path, far: np.ndarray, share: str
) -> None:
    clean, odd = tmp_path / "clean.ply", tmp_path / "odd.ply"
    save_ply(POINTS, clean)
    save_ply(np.vstack([POINTS, far]).astype(np.float32), odd)
    render = ("render", odd, "--up", "y", "--method", "splat", "-o", tmp_path / "odd.png")
    status, _, err = command(*render)
    count = f"{len(far)} of {345 + len(far)} points"
    assert status == 0
    assert err.startswith(f"note: {odd}: {count} lie up to ")
    assert f"which takes {share} % of the image's width; --drop-far leaves them out\n" in err
    status, _, err = command(*render, "--drop-far")
    assert (status, err) == (0, f"note: {odd}: {count} are left out, they lie far from the rest\n")
    command("render", clean, "--method", "splat", "-o", tmp_path / "clean.png")
    assert (tmp_path / "odd.png").read_bytes() == (tmp_path / "clean.png").read_bytes()


def test_rounded_coordinates_are_named_and_those_of_the_object_alone_count(tmp_path: Path) -> None:
    place = np.array([448262, 5411933, 120])
    rounded = (POINTS.astype(float) + place).astype(np.float32)
    path = tmp_path / "utm.npy"
    np.save(path, np.vstack([rounded, [[0, 0, 0]]]).astype(np.float32))
    _, (far, steps) = CloudFile(path, as_is=False).load_with_notes()
    assert "1 of 346 points lie" in far
    assert "coordinates are in steps of 0.5 where the object is 2 across (float32 at" in steps
    assert len(CloudFile(path, as_is=True, drop_far=True).load()) == 345


def test_decimal_commas_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("0,5 1,5 2,5\n1 3,25 7\n")
    _, notes = CloudFile(tmp_path / "a.xyz", as_is=False).load_with_notes()
    assert [note for note in notes if "commas are taken for decimal marks" in note]


def test_a_mesh_is_drawn_from_its_surface(tmp_path: Path) -> None:
    path = tmp_path / "box.ply"
    face_colors = "".join(f"{side} 9 {i} 7\n" for i, side in enumerate(SIDES.splitlines()))
    strip = "10 0 1 2 3 -1 4 5 6 7 -1\n4 0 1 4 5\n4 2 3 6 7\n4 0 2 4 6\n4 1 3 5 7\n"
    for text, count in (
        (box(), 12),
        (box(face_colors, properties=RGB), 12),
        (box(strip.replace("10 ", "10 ", 1), element="tristrips"), 12),
        (box(SIDES + "3 0 0 0\n"), 13),
        (box().replace("vertex_indices", "indices"), 12),
    ):
        path.write_text(text)
        file = CloudFile(path, as_is=True)
        loaded = file.load_all()
        points = loaded.cloud.points
        assert len(points) == 2048
        on_a_side = np.isclose(points, [0, 0, 0]) | np.isclose(points, [1, 2, 2])
        assert on_a_side.any(axis=1).all()
        assert [np.isclose(points[:, axis], 0).mean() for axis in range(3)] == pytest.approx(
            [0.25, 0.125, 0.125], abs=0.03
        )
        assert loaded.notes == (
            f"{path}: a mesh of {count} triangles: 2048 points of its surface are drawn, not its 8 "
            "vertices; --points takes another number",
        )
        colors = loaded.cloud.colors
        assert (colors is not None) == ("red" in text)
        if colors is not None:
            assert colors[np.isclose(points[:, 0], 0)].tolist() == [[9, 0, 7]] * sum(
                np.isclose(points[:, 0], 0)
            )
    assert len(CloudFile(path, as_is=True, most=5000).load()) == 5000
    again = CloudFile(path, as_is=True).load().points
    assert np.array_equal(again, points)


def test_faces_that_make_no_surface_leave_the_points(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    for sides in ("3 0 1 2\n", "3 0 0 1\n3 2 2 3\n3 4 4 5\n3 6 6 7\n", "2 0 1\n"):
        path.write_text(box(sides))
        cloud, (note,) = CloudFile(path, as_is=False).load_with_notes()
        corners = np.array([[float(v) for v in line.split()] for line in BOX.splitlines()])
        assert np.array_equal(cloud.points, normalise_points(corners).points)
        assert note == (
            f"{path}: its {len(sides.splitlines())} faces are not used; only the coordinates of "
            "its points are; they make no surface of most of these"
        )
