"""Texts of numbers that no line names: clouds, and what is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data_prep.failures import BadInput
from data_prep.files.clouds import load_points, read_cloud


def text_of(table: np.ndarray, separator: bytes = b" ") -> bytes:
    return b"".join(separator.join(b"%.17g" % v for v in row) + b"\n" for row in table.tolist())


def trajectory(
    start: float, step: float = 0.04, quaternion: bool = False, separator: bytes = b" "
) -> bytes:
    """Return uneven times with a path of 40 positions, and a rotation if wanted."""
    steps = np.arange(1, 41) + np.sin(np.arange(40)) / 9
    angles = np.arange(40) / 40
    table = [start + step * steps, np.sin(angles), np.cos(angles), angles]
    if quaternion:
        table += [0 * angles, 0 * angles, np.sin(angles), np.cos(angles)]
    return b"".join(
        separator.join(b"%.10g" % v for v in row) + b"\n" for row in np.stack(table, 1).tolist()
    )


def poses() -> np.ndarray:
    """Return 5 matrices [5, 4, 4] of rotations about z, and translations."""
    matrices = np.tile(np.eye(4), (5, 1, 1))
    angles = np.arange(5) / 3
    cosines, sines = np.cos(angles), np.sin(angles)
    matrices[:, 0, 0], matrices[:, 0, 1] = cosines, -sines
    matrices[:, 1, 0], matrices[:, 1, 1] = sines, cosines
    matrices[:, :3, 3] = np.arange(15).reshape(5, 3)
    return matrices


POSES = poses()

REFUSED = {
    "stamps.csv": (trajectory(1305031098.6, separator=b","), "'1305031099' and so on, only grows"),
    "milliseconds.txt": (trajectory(0, 33), "its first column, '33' and so on, only grows, as"),
    "tum.txt": (
        trajectory(0, 0.03, quaternion=True),
        "its rows are poses, a rotation with a posit",
    ),
    "kitti.txt": (text_of(POSES[:, :3].reshape(-1, 12)), "its rows are poses, a rotation with a p"),
    "poses.csv": (
        text_of(POSES.reshape(-1, 16), b","),
        "its rows are poses, a rotation with a pos",
    ),
    "columns.txt": (text_of(POSES.transpose(0, 2, 1).reshape(-1, 16)), "its rows are poses, a rot"),
    "pose.txt": (
        text_of(POSES[0]),
        "its rows are poses, a rotation with a position and perhaps a time; give",
    ),
    "matrix.csv": (
        text_of(np.arange(64 * 21).reshape(-1, 21) % 97, b","),
        "21 columns without names, as a matrix or an image has them; name x, y and z in a first",
    ),
    "pandas-matrix.csv": (
        text_of(np.arange(8 * 65).reshape(-1, 65) % 97, b","),
        "65 columns without names",
    ),
    "r-matrix.csv": (
        ",".join(f"V{i}" for i in range(1, 31)).encode() + b"\n" + text_of(np.ones((2, 30)), b","),
        "30 columns without names",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_likely_no_cloud_is_refused_with_a_remedy(tmp_path: Path, name: str) -> None:
    content, problem = REFUSED[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BadInput, match=problem) as failure:
        load_points(tmp_path / name)
    assert str(failure.value).startswith(f"{tmp_path / name}: ")
    assert "\n" not in str(failure.value)


@pytest.mark.parametrize("name", ["stamps.csv", "tum.txt", "poses.csv", "matrix.csv"])
def test_names_of_the_columns_are_believed(tmp_path: Path, name: str) -> None:
    content, _ = REFUSED[name]
    count = content.splitlines()[0].replace(b",", b" ").count(b" ") + 1
    names = ["t", "x", "y", "z", *(f"other{i}" for i in range(count - 4))]
    separator = "," if name.endswith("csv") else " "
    (tmp_path / name).write_bytes(separator.join(names).encode() + b"\n" + content)
    assert load_points(tmp_path / name).shape == (len(content.splitlines()), 3)


SORTED = np.unique(np.random.default_rng(0).normal(size=(50, 3)), axis=0)
NORMALS = np.tile([0.6, 0.8, 0.0], (50, 1))


@pytest.mark.parametrize(
    "table",
    [
        np.hstack([SORTED + np.array([50, 0, 0]), NORMALS[:, :1]]),
        np.hstack([SORTED + np.array([3e5, 4e6, 50]), NORMALS[:, :1]]),
        np.hstack([SORTED, np.arange(50)[:, None], NORMALS, np.zeros((50, 1))])[::-1],
        np.hstack([SORTED, NORMALS, NORMALS]),
        np.hstack([SORTED, NORMALS, 0 * SORTED]),
        np.hstack([SORTED, NORMALS, np.full((50, 3), 256)]),
        np.hstack([SORTED, *[NORMALS] * 5, 0 * NORMALS[:, :2]]),
    ],
    ids=["sorted", "sorted-map", "curvature", "twice", "black", "too-large", "20-columns"],
)
def test_other_columns_without_names_are_no_times_poses_or_colours(
    tmp_path: Path, table: np.ndarray
) -> None:
    (tmp_path / "a.xyz").write_bytes(text_of(table))
    contents = read_cloud(tmp_path / "a.xyz", with_colors=True)
    assert np.array_equal(contents.points, table[:, :3])
    assert not contents.has_colors


@pytest.mark.parametrize(
    "row",
    [
        b"1 2 3 255 0 128 0 0 1\n4 5 6 1 1 0 .71 -.71 0\n",
        b"1 2 3 0 0 -1 255 0 128\n4 5 6 .71 0 .71 1 1 0\n",
    ],
    ids=["colours-first", "normals-first"],
)
def test_colours_beside_normals(tmp_path: Path, row: bytes) -> None:
    (tmp_path / "a.xyz").write_bytes(row)
    contents = read_cloud(tmp_path / "a.xyz", with_colors=True)
    assert contents.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert contents.colors is not None
    assert contents.colors.tolist() == [[255, 0, 128], [1, 1, 0]]
