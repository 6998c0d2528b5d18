from __future__ import annotations

import errno
import fcntl
import json
import os
import subprocess
import sys

import pytest

from bench.records.folder import (
    MANIFEST,
    check_directory,
    open_folder,
    read_finished,
    read_manifest,
    set_aside,
    write_manifest,
)

from ..builders import make_manifest, refusal


def names(paths):
    return [path.name for path in paths]


HOLD = """
import sys
from pathlib import Path
from bench.records.folder import open_folder
with open_folder(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_refused(tmp_path):
    write_manifest(tmp_path, make_manifest())
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    pipe = subprocess.PIPE
    holder = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    with holder:
        assert holder.stdout
        assert holder.stdout.readline() == "held\n"
        for refused in (open_folder(tmp_path).__enter__, lambda: set_aside(tmp_path)):
            assert refusal(refused).startswith(f"{tmp_path}: another run is writing here; wait")
        holder.kill()
    with open_folder(tmp_path):  # the lock has died with its process
        pass


def test_a_file_system_without_locks_is_refused_before_anything_is_written(tmp_path, monkeypatch):
    def refuse(file, operation):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(fcntl, "flock", refuse)
    message = refusal(open_folder(tmp_path).__enter__)
    assert message.startswith(
        f"{tmp_path}: its file system has no locks (No locks available); give"
    )
    assert names(tmp_path.iterdir()) == ["lock"]


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    message = refusal(open_folder(tmp_path / "file" / "run").__enter__)
    assert "file/run: cannot be written (Not a directory); give --out" in message


FIXED = ["suite", "dataset", "views", "seed", "device"]


def test_what_a_killed_start_leaves_of_its_manifest_is_no_obstacle(tmp_path):
    with open_folder(tmp_path):
        pass
    (tmp_path / f".{MANIFEST}.0123abcd").write_text("{")
    check_directory(tmp_path, make_manifest())
    for other in ("lockers", "run.sqlite.bak"):
        (tmp_path / other).touch()
        assert "not empty and not a run" in refusal(check_directory, tmp_path, make_manifest())
        (tmp_path / other).unlink()
    for hidden in (".hidden", "Thumbs.db"):
        (tmp_path / hidden).touch()
    check_directory(tmp_path, make_manifest())


def test_new_and_empty_directories_a_lock_alone_and_the_same_run_are_welcome(tmp_path):
    for place in (tmp_path / "new", tmp_path):
        check_directory(place, make_manifest())
        assert set_aside(place) is None
    with open_folder(tmp_path):
        check_directory(tmp_path, make_manifest())
    write_manifest(tmp_path, make_manifest())
    grown = make_manifest(methods=["splat"], conditions=["noise-0.05"], objects=["chair/z"])
    check_directory(tmp_path, grown)


@pytest.mark.parametrize("name", FIXED)
def test_another_run_is_refused(tmp_path, name):
    write_manifest(tmp_path, make_manifest())
    assert refusal(check_directory, tmp_path, make_manifest(**{name: "another"})) == (
        f"{tmp_path}: holds a run of {name} {make_manifest().get(name)!r}, not 'another'; "
        "give another --out, or --fresh to start over"
    )


def test_a_run_of_another_truth_is_refused_by_name(tmp_path):
    for folder, entry, truth, wanted in (
        ("a", {}, "coloured", {"truth": "grey"}),
        ("b", {"truth": "grey"}, "grey", {}),
    ):
        write_manifest(tmp_path / folder, make_manifest(**entry))
        assert refusal(check_directory, tmp_path / folder, make_manifest(**wanted)) == (
            f"{tmp_path / folder}: holds a run of truth {truth!r}, not "
            f"{wanted.get('truth', 'coloured')!r}; give another --out, or --fresh to start over"
        )


def without(name):
    return json.dumps({key: value for key, value in make_manifest().items() if key != name})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *((text, "") for text in ("", "{", "[]", "{}", "\xff", "[" * 10_000)),
        *((f'{{"schema_version": {version}}}', "") for version in ('"new"', "1e999")),
        *((without(name), f"no {name}); move it away") for name in FIXED),
        (json.dumps(make_manifest(objects=["chair/a"] * 2)), "objects has 'chair/a' twice"),
        (json.dumps(make_manifest(views=0)), "views is 0, not 1 to "),
    ],
    ids=range(15),
)
def test_a_damaged_manifest(tmp_path, text, message):
    path = tmp_path / "manifest.json"
    path.write_text(text, encoding="latin-1")
    assert refusal(read_manifest, tmp_path).startswith(f"{path}: not a manifest ({message}")


@pytest.mark.parametrize("name", ["tables", "run.sqlite", "records.parquet", "manifest.json"])
def test_links_that_lead_out_and_pipes_are_refused(tmp_path, name):
    """Tables would be written where a link leads, and a pipe would be waited for."""
    run, outside = tmp_path / "run", tmp_path / "outside"
    outside.mkdir()
    run.mkdir()
    write_manifest(run, make_manifest())
    (tmp_path / "link").symlink_to("run")  # the folder of the run itself may be one
    (run / "inside").symlink_to("manifest.json")
    (run / "loop").symlink_to("loop")
    assert read_manifest(tmp_path / "link")
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to("../outside")
    assert f"{name}: a link that leads out of the run's folder" in refusal(read_manifest, run)
    (run / name).unlink()
    os.mkfifo(run / name)
    assert f"{name}: no regular file but a pipe or device" in refusal(read_manifest, run)


def test_manifests_are_kept_to_the_letter(tmp_path):
    manifest = make_manifest(note="Fréchet", seed=2**40)
    write_manifest(tmp_path, manifest)
    assert read_manifest(tmp_path) == read_finished(tmp_path) == manifest
    assert names(tmp_path.iterdir()) == ["manifest.json"]  # nothing temporary


def test_old_runs_are_renamed_not_deleted(tmp_path):
    run = tmp_path / "run"
    for number in (1, 2):
        run.mkdir()
        write_manifest(run, make_manifest(seed=number))
        assert set_aside(run) == tmp_path / f"run.old-{number}"
        assert not run.exists()
    assert [read_manifest(tmp_path / f"run.old-{n}")["seed"] for n in (1, 2)] == [1, 2]


def test_killed_writers_leave_the_old_file_whole(tmp_path, monkeypatch):
    write_manifest(tmp_path, make_manifest(seed=1))

    def killed(handle):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", killed)
    with pytest.raises(KeyboardInterrupt):
        write_manifest(tmp_path, make_manifest(seed=2))
    assert read_manifest(tmp_path)["seed"] == 1
