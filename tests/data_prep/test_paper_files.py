from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from data_prep.datasets.paper import PaperClass, read_split, read_views
from data_prep.failures import BadInput
from data_prep.scene import View


def views(tmp_path: Path, content: str | bytes) -> tuple[View, ...]:
    path = tmp_path / "view.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_views(path)


def is_a_line_about(name: str, folder: Path, message: str) -> None:
    assert message.startswith(f"{folder / name}: ")
    assert message.isprintable()
    assert len(message) < len(str(folder)) + 200


@pytest.mark.parametrize(
    "content",
    [
        "-180 40\n12.5 -39.75",
        "-180.0 4e1 0 2\n12.5 -39.75 0.5 2\n",  # further numbers, as `[:, 0:2]` of the original
        "  -180\t40  \r\n+12.5   -39.75\r\n\r\n\n",
        b"\xef\xbb\xbf-180 40\n12.5 -39.75\n",
    ],
)
def test_a_line_is_a_view(tmp_path: Path, content: str | bytes) -> None:
    assert views(tmp_path, content) == (View(-180.0, 40.0), View(12.5, -39.75))


CHAIR = {"name": "chair", "train": ["1a6f", "2b"], "test": ["c-3.x"]}


def split(tmp_path: Path, content: object) -> dict[str, PaperClass]:
    path = tmp_path / "chair_exp.json"
    if not isinstance(content, bytes):
        content = (content if isinstance(content, str) else json.dumps(content)).encode()
    path.write_bytes(content)
    return read_split(path)


def test_classes_of_a_split(tmp_path: Path) -> None:
    lamp = {"test": [], "train": ["1a6f"], "name": "lamp, floor lamp", "note": 1}
    assert split(tmp_path, {"03001627": CHAIR, "03636649": lamp}) == {
        "03001627": PaperClass("chair", {"train": ("1a6f", "2b"), "test": ("c-3.x",)}),
        "03636649": PaperClass("lamp, floor lamp", {"train": ("1a6f",), "test": ()}),
    }


LEADING_OUT = ["..", ".", "", "../x", "/etc/passwd", "a\\b", "a\0b", "a\nb", "\x1b["]
LEADING_OUT += ["\u202ex", "\ud800", "x" * 201]


@pytest.mark.parametrize("bad", LEADING_OUT)
def test_an_id_leads_nowhere(tmp_path: Path, bad: str) -> None:
    for content in (
        {bad: CHAIR},
        *({"03001627": CHAIR | {where: ["fine", bad]}} for where in ("train", "test")),
    ):
        with pytest.raises(BadInput, match=r"expected {synset: {name, train: \[ids\]") as failure:
            split(tmp_path, content)
        is_a_line_about("chair_exp.json", tmp_path, str(failure.value))


@pytest.mark.parametrize(
    ("read", "content", "problem"),
    [
        (views, "", "no views"),
        (views, "1 2\n\n3 4\n", "line 2 has 0 numbers"),
        (views, "1 " * 17, "line 1 has 17 numbers"),
        (views, "1 2\n3\n", "line 2 has 1 numbers"),
        (views, "1 2\n3 4 x\n", "line 2: 'x' is not a number"),
        (views, "1_0 2\n", "'1_0' is not a number"),
        (views, "１ 2\n", "is not a number"),
        (views, "1e999 2\n", "azimuth_deg must be finite, got inf"),
        (views, "1 91\n", r"line 1: elevation_deg must lie in -90\.\.90, got 91"),
        (views, "1 nan\n", "elevation_deg must lie"),
        (views, b"1 2\n\xff\xfe\n", "not UTF-8 at byte 4"),
        (views, "1 2\n" * 20000, "80000 bytes, and at most 65536 are read"),
        (split, "{", "not JSON that can be read"),
        (split, b"\xff{}", "not UTF-8 at byte 0"),
        (split, "[" * 100_000, "not JSON that can be read .maximum recursion"),
        (split, [], "no classes"),
        (split, {}, "no classes"),
        (split, "3", "no classes"),
        (split, {"1": []}, "class '1' has no name"),
        (split, {"1": CHAIR | {"name": 3}}, "class '1' has no name"),
        (split, {"1": CHAIR | {"train": "abc"}}, "class '1' has no list 'train'"),
        (split, {"1": CHAIR | {"test": [True]}}, "'True' is not a text"),
        (split, {"1": CHAIR | {"name": "a\nb"}}, "characters that cannot be seen"),
        (split, {"1": {"name": "chair", "train": []}}, "class '1' has no list 'test'"),
        (split, {"1": CHAIR | {"train": ["a"], "test": ["a"]}}, "class '1' lists 'a' twice"),
        (split, '{"1": 0, "1": 0}', "'1' is there twice"),
    ],
)
def test_files_that_cannot_be_used(tmp_path: Path, read, content: object, problem: str) -> None:
    with pytest.raises(BadInput, match=problem) as failure:
        read(tmp_path, content)
    name = "view.txt" if read is views else "chair_exp.json"
    is_a_line_about(name, tmp_path, str(failure.value))


def test_many_ids_take_no_long(tmp_path: Path) -> None:
    # 200,000 of them with the double at the end: under a second, where a search for each would take
    # 2 * 10^10 steps.
    ids = [f"{i:x}" for i in range(200_000)]
    last = ids[-1]
    start = time.monotonic()
    with pytest.raises(BadInput, match=f"'{last}' twice"):
        split(tmp_path, {"1": {"name": "chair", "train": ids, "test": [last]}})
    with pytest.raises(BadInput, match=f"'{last}' is there twice"):
        split(tmp_path, "{" + ",".join(f'"{i}":0' for i in [*ids, last]) + "}")
    assert time.monotonic() - start < 10


def test_size_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "chair_exp.json"
    path.write_text(json.dumps({"1": CHAIR}))
    with pytest.raises(BadInput, match="at most 10 are read"):
        read_split(path, most_bytes=10)
