from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from data_prep.files.atomic_write import atomic_write, sync_folder, whole_folder, write_whole


def there(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_until_the_block_ends_the_old_file_is_there(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "a.bin"
    write_whole(path, b"old")
    with atomic_write(path) as new:
        assert new.read_bytes() == b""
        new.write_bytes(b"new")
        assert path.read_bytes() == b"old"
        assert new.parent == path.parent  # elsewhere may be another disk
        assert (new.name[0], new.suffix != path.suffix) == (".", True)  # no loader takes it
    assert there(path.parent) == {"a.bin": b"new"}


@pytest.mark.parametrize("old", [{}, {"a.bin": b"old"}])
@pytest.mark.parametrize("end", [ValueError("why"), KeyboardInterrupt("why")])
@pytest.mark.parametrize("gone", [False, True])
def test_interrupted(tmp_path: Path, old: dict[str, bytes], end: BaseException, gone: bool) -> None:
    """The reason is raised also where there is nothing left to remove."""
    for name, data in old.items():
        (tmp_path / name).write_bytes(data)

    def interrupted() -> None:
        with atomic_write(tmp_path / "a.bin") as new:
            new.write_bytes(b"half")
            if gone:
                new.unlink()
            raise end

    with pytest.raises(type(end), match="why"):
        interrupted()
    assert there(tmp_path) == old


@pytest.mark.parametrize(("owner", "call"), [(os, "fsync"), (Path, "replace")])
def test_a_disk_that_refuses(tmp_path: Path, monkeypatch, owner: object, call: str) -> None:
    write_whole(tmp_path / "a.bin", b"old")
    monkeypatch.setattr(owner, call, Mock(side_effect=OSError(28, "No space left on device")))
    with pytest.raises(OSError, match="No space left"):
        write_whole(tmp_path / "a.bin", b"new")
    assert there(tmp_path) == {"a.bin": b"old"}


KILLED = """
import os, signal, sys
from pathlib import Path
from data_prep.files.atomic_write import atomic_write
with atomic_write(Path(sys.argv[1])) as new:
    new.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    write_whole(path, b"old")
    done = subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    assert done.returncode == -signal.SIGKILL
    assert path.read_bytes() == b"old"
    (left,) = set(tmp_path.iterdir()) - {path}
    assert left.read_bytes() == b"half"
    write_whole(path, b"new")  # does not stumble over it
    assert path.read_bytes() == b"new"


def test_contents_then_name_then_folder_reach_the_disk(tmp_path: Path, monkeypatch) -> None:
    path, calls = tmp_path / "a.bin", []
    replace = Path.replace

    def synced(handle: int) -> None:
        found = os.fstat(handle)
        size = found.st_size if stat.S_ISREG(found.st_mode) else None
        calls.append(("fsync", found.st_ino, size))

    def renamed(new: Path, target: Path) -> Path:
        calls.append(("replace", new.stat().st_ino, target))
        return replace(new, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(Path, "replace", renamed)
    write_whole(path, b"new")
    file, folder = path.stat().st_ino, tmp_path.stat().st_ino
    assert calls == [("fsync", file, 3), ("replace", file, path), ("fsync", folder, None)]
    calls.clear()
    sync_folder(tmp_path)
    assert calls == [("fsync", folder, None)]
    calls.clear()
    write_whole(path, b"newer", synced=False)
    assert calls == [("replace", path.stat().st_ino, path)]


@pytest.mark.parametrize(("mask", "rights"), [(0o022, 0o644), (0o077, 0o600), (0o002, 0o664)])
def test_the_rights_of_a_new_file(tmp_path: Path, mask: int, rights: int) -> None:
    path = tmp_path / "a.bin"
    path.touch(0o640)  # the old file's do not count
    before = os.umask(mask)
    try:
        write_whole(path, b"")
        assert stat.S_IMODE(path.stat().st_mode) == rights
        with atomic_write(path) as new:
            new.unlink()
            new.touch(0o400)  # as libraries do that write by way of a file of their own
        assert stat.S_IMODE(path.stat().st_mode) == rights
    finally:
        os.umask(before)


def test_those_who_write_at_once_do_not_meet_and_folders_are_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    with atomic_write(path) as one:
        one.write_bytes(b"first, ")
        write_whole(path, b"second")
        with one.open("ab") as file:
            file.write(b"and last")
        assert path.read_bytes() == b"second"
    assert there(tmp_path) == {"a.bin": b"first, and last"}
    (tmp_path / "folder").mkdir()
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path / "folder", b"new")
    assert {path.name for path in tmp_path.iterdir()} == {"a.bin", "folder"}


def test_a_folder_is_there_whole_or_not_at_all(tmp_path):
    with whole_folder(tmp_path / "a" / "b") as new:
        (new / "x").write_text("1")
        assert not (tmp_path / "a" / "b").exists()
    assert (tmp_path / "a" / "b" / "x").read_text() == "1"
    for path in (tmp_path / "c", tmp_path / "a" / "b"):
        with pytest.raises(FileExistsError), whole_folder(path) as new:
            write_whole(Path(__file__) / new.name, b"")
    with pytest.raises(OSError), whole_folder(tmp_path / "a" / "b"):  # there already, and kept
        tmp_path.touch()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"]
