from __future__ import annotations

import os
import tracemalloc
from pathlib import Path
from unittest.mock import Mock

import pytest

from data_prep.failures import BadInput
from data_prep.files.safe_read import MIB, is_regular_file, open_file, read_file, shown


def test_bytes_as_they_are(tmp_path: Path) -> None:
    content = bytes(range(256)) * 10
    (tmp_path / "a").write_bytes(content)
    (tmp_path / "link").symlink_to("a")
    assert read_file(tmp_path / "link", 10**6) == content
    with open_file(tmp_path / "a", 2560) as file:
        assert file.read(3) == b"\0\1\2"
    assert file.closed
    (tmp_path / "a").write_bytes(b"")
    assert read_file(tmp_path / "a", 0) == b""


def test_one_byte_too_many_and_memory_for_what_is_there(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    assert read_file(tmp_path / "a", 5) == b"12345"
    problem = r"/a: 5 bytes, and at most 4 are read; give a smaller file$"
    with pytest.raises(BadInput, match=problem):
        read_file(tmp_path / "a", 4)
    tracemalloc.start()
    try:
        read_file(tmp_path / "a", 2**40)
        assert tracemalloc.get_traced_memory()[1] < MIB
    finally:
        tracemalloc.stop()


def test_what_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "dangling").symlink_to("gone")
    (tmp_path / "zero").symlink_to("/dev/zero")
    before = len(list(Path("/proc/self/fd").iterdir()))
    for name, problem in (
        ("pipe", "no regular file but a pipe or device; give a file"),
        ("zero", "no regular file but a pipe or device; give a file"),
        ("folder", "a folder; give a file"),
        ("loop", r"cannot be read \(Too many levels"),
        ("dangling", "no such file"),
        ("gone", "no such file"),
        ("a/b\0c", r"cannot be read \(embedded null"),
        ("n" * 300, r"cannot be read \(File name too long\)"),
    ):
        path = tmp_path / name
        assert not is_regular_file(path)
        for read in (read_file, lambda p, most: open_file(p, most).__enter__()):
            with pytest.raises(BadInput, match=problem) as failure:
                read(path, 10**9)
            assert str(failure.value).startswith(f"{path}: ")
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_size_that_is_a_lie() -> None:
    # Files of the kernel say that they have 0 bytes.
    with pytest.raises(BadInput, match="more than its 0 bytes"):
        read_file(Path("/proc/self/environ"), 10**6)


def test_a_folder_that_may_not_be_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    refuse = Mock(side_effect=PermissionError(13, "Permission denied"))
    monkeypatch.setattr(os, "stat", refuse)  # who runs tests as root may search everything
    monkeypatch.setattr(Path, "stat", refuse)
    assert not is_regular_file(Path("a/b"))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (b"\xff\0", r"'\xff\x00'"),
        ("a\nb\x1b\u202e", r"'a\nb\x1b\u202e'"),
        ("x" * 40, f"'{'x' * 40}'"),
        (b"x" * 41, f"'{'x' * 40}'..."),
    ],
)
def test_quoted_values(value: str | bytes, expected: str) -> None:
    assert shown(value) == expected
