from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from hashlib import sha256

import pytest

from bench.records.job import Result, failed
from bench.records.run_folder import (
    MANIFEST,
    JournalIndex,
    check_directory,
    open_journal,
    read_finished,
    read_manifest,
    set_aside,
    write_manifest,
)
from bench.records.record import SCHEMA_VERSION
from data_prep.failures import BadInput
from tests.robustness.failing_writes import cut_everywhere

from ..builders import make_job, make_manifest, make_record, write_artifact


def refusal(function, *arguments):
    """The one line with which it refuses."""
    with pytest.raises(BadInput) as error:
        function(*arguments)
    message = str(error.value)
    assert "\n" not in message
    return message


def finish(job, seed=0):
    """The result of a job whose artifact has been written."""
    return Result(job.key, (make_record(ssim=1 / 3),), write_artifact(job, seed))


def jobs_of(directory, *methods):
    return [make_job(method=method) for method in methods]


def write_journal(directory, *jobs):
    """Write a journal file in which these jobs are finished, and return the last file."""
    with open_journal(directory) as journal:
        for job in jobs:
            journal.append(finish(job))
    return shards(directory)[-1]


def shards(directory):
    return sorted((directory / "journal").glob("*.jsonl"))


def names(paths):
    return [path.name for path in paths]


def test_what_was_appended_is_there_again(tmp_path):
    job, broken = jobs_of(tmp_path, "splat", "blank")
    done, lost = finish(job), failed(broken, 'crash: "ä" \u2028 died')
    results = [done.without_records(), lost.without_records()]
    assert results[1].reason == 'crash: "ä" \u2028 died'
    with open_journal(tmp_path) as journal:
        assert journal.usable(job) is None
        journal.append(done)
        journal.append(lost)
        assert journal.usable(job) == results[0]
        assert journal.index.read(job.key) == done
        assert journal.added == {job.key, broken.key}
    with open_journal(tmp_path) as journal:
        assert [journal.usable(job), journal.usable(broken)] == results
        assert journal.index.read(job.key) == done  # 1/3 to the last bit
        assert journal.index.read(broken.key) == lost
        assert (journal.damage, journal.added) == ([], set())


def test_lines_of_an_older_schema_are_passed_over(tmp_path):
    """A folder of an earlier version is gone on with: what it holds is done again."""
    old, new = jobs_of(tmp_path, "splat", "blank")
    shard = write_journal(tmp_path, old)
    body = json.loads(shard.read_text().split(" ", 1)[1])
    for record in body["records"]:
        del record["thin_recall"]
    text = json.dumps(body)
    shard.write_text(f"{sha256(text.encode()).hexdigest()} {text}\n")
    with open_journal(tmp_path) as journal:
        assert (journal.usable(old), journal.damage) == (None, [])
        journal.append(finish(new))
    with open_journal(tmp_path) as journal:
        assert journal.usable(new) is not None


def test_every_start_that_writes_has_a_file_and_later_results_replace_earlier_ones(tmp_path):
    job = make_job()
    for seed in (0, 1):
        done = finish(job, seed)
        with open_journal(tmp_path) as journal:
            journal.append(done)
        with open_journal(tmp_path) as journal:  # reads only
            assert journal.usable(job) == done.without_records()
            assert journal.index.read(job.key) == done
    assert names(shards(tmp_path)) == ["0001.jsonl", "0002.jsonl"]


def test_a_result_is_on_disk_before_append_returns(tmp_path, monkeypatch):
    job = make_job()
    done, synced = finish(job), []
    monkeypatch.setattr(os, "fsync", lambda handle: synced.append(os.fstat(handle)))
    with open_journal(tmp_path) as journal:
        journal.append(done)
        (shard,) = shards(tmp_path)
        # the file's name, then its contents
        expected = [shard.parent.stat().st_ino, shard.stat().st_ino]
        assert [found.st_ino for found in synced] == expected
        assert synced[1].st_size == shard.stat().st_size
        (line,) = shard.read_bytes().splitlines()
    checksum, _, body = line.partition(b" ")
    assert sha256(body).hexdigest() == checksum.decode()
    assert json.loads(body)["key"] == job.key


@pytest.mark.parametrize("length", [1, 64, 65, -2])
def test_a_torn_line_is_done_again(tmp_path, length):
    whole, torn = jobs_of(tmp_path, "splat", "blank")
    shard = write_journal(tmp_path, whole, torn)
    first, second = shard.read_bytes().splitlines(keepends=True)
    shard.write_bytes(first + second[:length])
    with open_journal(tmp_path) as journal:
        assert journal.usable(whole) is not None
        assert journal.usable(torn) is None
        aside = shard.parent / "set-aside" / shard.name
        assert journal.damage == [
            f"{shard}: line 2 was cut short by the end of its run; its job is done again",
            f"{shard}: kept for you to look at as {aside}",
        ]
        journal.append(finish(torn))
    with open_journal(tmp_path) as journal:
        assert journal.usable(torn) is not None
        (last,) = (path for path in shards(tmp_path) if path.name == "0003.jsonl")
    last.write_bytes(last.read_bytes().rstrip(b"\n"))  # a whole line counts without its newline
    with open_journal(tmp_path) as journal:
        assert journal.usable(torn) is not None
        assert journal.damage == []


@pytest.fixture
def four_lines(tmp_path):
    return write_journal(tmp_path, *jobs_of(tmp_path, "splat", "blank", "constant", "true-mesh"))


def test_cut_after_any_of_its_bytes_it_has_its_whole_lines_and_no_other(four_lines):
    assert list(cut_everywhere(four_lines, step=9)) == []


class Forgetful(JournalIndex):
    """An index without a last line that lacks its line feed."""

    def add_file(self, file):
        whole = file.read_bytes().rpartition(b"\n")[0]
        file.write_bytes(whole + b"\n" * bool(whole))
        return super().add_file(file)


def test_a_whole_line_that_did_not_count_would_be_found(four_lines):
    faults = list(cut_everywhere(four_lines, step=9, index_type=Forgetful))
    assert sum("lines count" in fault for fault in faults) == 4  # the lines without a line feed


@pytest.mark.parametrize("change", [(b'"ssim": 0.33', b'"ssim": 0.34'), (b" ", b""), (b"{", b"\n")])
def test_a_damaged_line_is_done_again_and_the_others_stay(tmp_path, change):
    jobs = jobs_of(tmp_path, "splat", "blank", "true-mesh")
    shard = write_journal(tmp_path, *jobs)
    lines = shard.read_bytes().splitlines(keepends=True)
    lines[1] = lines[1].replace(*change, 1)
    shard.write_bytes(b"".join(lines))
    with open_journal(tmp_path) as journal:
        assert [journal.usable(job) is not None for job in jobs] == [True, False, True]
        for job in (jobs[0], jobs[2]):  # from the file that took the place of the damaged one
            assert journal.index.read(job.key) == finish(job)
        assert journal.damage[0].startswith(f"{shard}: line 2 is damaged")
        journal.append(finish(jobs[1]))
    assert (shard.parent / "set-aside" / shard.name).read_bytes() == b"".join(lines)
    found = shards(tmp_path)
    assert names(found) == ["0002.jsonl", "0003.jsonl"]
    assert found[0].read_bytes() == lines[0] + lines[2]
    with open_journal(tmp_path) as journal:
        assert [journal.usable(job) is not None for job in jobs] == [True] * 3
        assert journal.damage == []  # said once


@pytest.mark.parametrize(
    "contents",
    [b"\0" * 4096, b"\xff\xfe\n\n", b"[" * 10_000, b" {}\n"],
    ids=["zeros", "not UTF-8", "deep", "no checksum"],
)
def test_a_journal_file_of_rubbish_is_set_aside(tmp_path, contents):
    job = make_job()
    write_journal(tmp_path, job)
    rubbish, mine = (tmp_path / "journal" / name for name in ("0002.jsonl", "0001-copy.jsonl"))
    rubbish.write_bytes(contents)
    mine.write_text("mine")  # no name of ours: left alone
    with open_journal(tmp_path) as journal:
        assert journal.usable(job) is not None
        assert journal.damage[0].startswith(f"{rubbish}: line 1 ")
        assert all(line.startswith(f"{rubbish}: ") for line in journal.damage)
    assert (tmp_path / "journal" / "set-aside" / "0002.jsonl").read_bytes() == contents
    write_journal(tmp_path, job)
    assert names(shards(tmp_path)) == ["0001-copy.jsonl", "0001.jsonl", "0003.jsonl"]
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("harm", ["missing", "altered", "cut"])
def test_a_harmed_artifact_is_made_again(tmp_path, harm):
    job, other = jobs_of(tmp_path, "splat", "blank")
    write_journal(tmp_path, job, other)
    data = bytearray(job.artifact.read_bytes())
    data[100] ^= 1
    if harm == "missing":
        job.artifact.unlink()
    else:
        job.artifact.write_bytes(data if harm == "altered" else data[:-1])
    with open_journal(tmp_path) as journal:
        assert journal.usable(job) is None
        assert journal.usable(other) is not None
        assert journal.damage == [f"{job.artifact}: missing or altered; its job is done again"]


def test_records_are_read_back_from_the_file_and_not_kept(tmp_path):
    """What is kept of a job does not grow with its images."""
    job, other = jobs_of(tmp_path, "splat", "blank")
    records = tuple(make_record(view=view, notes="n" * 500) for view in range(400))
    with open_journal(tmp_path) as journal:
        journal.append(finish(other))
        journal.append(replace(finish(job), records=records))
    (shard,) = shards(tmp_path)
    tracemalloc.start()
    try:
        with open_journal(tmp_path) as journal:
            gc.collect()
            held, _ = tracemalloc.get_traced_memory()
            assert journal.index.read(job.key).records == records
    finally:
        tracemalloc.stop()
    assert shard.stat().st_size > 200_000
    assert held < 30_000


@pytest.mark.parametrize("harm", ["altered", "shorter", "gone", "another"])
def test_a_line_that_has_changed_since_is_no_result(tmp_path, harm):
    job, other = jobs_of(tmp_path, "splat", "other")
    shard = write_journal(tmp_path, job, other)
    with open_journal(tmp_path) as journal:
        first, second = shard.read_bytes().splitlines(keepends=True)
        assert len(first) == len(second)
        if harm == "gone":
            shard.unlink()
        else:
            altered = first.replace(b'"ssim": 0.33', b'"ssim": 0.34', 1)
            shard.write_bytes({"altered": altered, "shorter": b"\n", "another": second}[harm])
        shown = "cannot be read" if harm == "gone" else "the line at byte 0 has changed; run again"
        assert refusal(journal.index.read, job.key).startswith(f"{shard}: {shown}")
        with pytest.raises(KeyError):
            journal.index.read("a key without a line")


HOLD = """
import sys
from pathlib import Path
from bench.records.run_folder import open_journal
with open_journal(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_second_process_is_refused(tmp_path):
    write_manifest(tmp_path, make_manifest())
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    pipe = subprocess.PIPE
    holder = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
    with holder:
        assert holder.stdout.readline() == "held\n"
        for refused in (open_journal(tmp_path).__enter__, lambda: set_aside(tmp_path)):
            assert refusal(refused).startswith(f"{tmp_path}: another run is writing here; wait")
        holder.kill()
    with open_journal(tmp_path):  # the lock has died with its process
        pass


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").touch()
    message = refusal(open_journal(tmp_path / "file" / "run").__enter__)
    assert "file/run: cannot be written (Not a directory); give --out" in message


FIXED = ["suite", "dataset", "views", "seed", "device"]


def test_what_a_killed_start_leaves_of_its_manifest_is_no_obstacle(tmp_path):
    (tmp_path / f".{MANIFEST}.0123abcd").write_text("{")
    check_directory(tmp_path, make_manifest())
    (tmp_path / ".hidden").touch()
    assert "not empty and not a run" in refusal(check_directory, tmp_path, make_manifest())


def test_new_and_empty_directories_a_lock_alone_and_the_same_run_are_welcome(tmp_path):
    for place in (tmp_path / "new", tmp_path):
        check_directory(place, make_manifest())
        assert set_aside(place) is None
    with open_journal(tmp_path):
        check_directory(tmp_path, make_manifest())
    write_manifest(tmp_path, make_manifest())
    grown = make_manifest(methods=["splat"], conditions=["noise-0.05"], objects=["chair/z"])
    check_directory(tmp_path, grown)


@pytest.mark.parametrize("name", [*FIXED, "shard"])
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


def test_a_newer_run_is_refused_everywhere(tmp_path):
    write_manifest(tmp_path, make_manifest(schema_version=SCHEMA_VERSION + 1))
    for read in (read_manifest, read_finished, lambda path: check_directory(path, make_manifest())):
        assert refusal(read, tmp_path).startswith(
            f"{tmp_path}: written by a newer version (schema {SCHEMA_VERSION + 1}, this one reads "
            f"up to {SCHEMA_VERSION}); update"
        )


@pytest.mark.parametrize("refuse", [lambda p: check_directory(p, make_manifest()), set_aside])
def test_other_peoples_directories_are_left_alone(tmp_path, refuse):
    (tmp_path / "thesis.tex").touch()
    assert refusal(refuse, tmp_path) == f"{tmp_path}: not empty and not a run; give a new --out"
    file = tmp_path / "thesis.tex"
    assert refusal(refuse, file) == f"{file}: is a file; give a folder with --out"
    assert file.exists()


@pytest.mark.parametrize("read", [read_manifest, read_finished])
def test_no_manifest(tmp_path, read):
    (tmp_path / "file").touch()
    for place in (tmp_path, tmp_path / "file"):
        assert refusal(read, place) == (
            f"{place}: no run here (manifest.json is missing); give a run's folder"
        )
    nowhere = tmp_path / "nowhere"
    assert refusal(read, nowhere) == f"{nowhere}: no such folder; give a run's folder"


def without(name):
    return json.dumps({key: value for key, value in make_manifest().items() if key != name})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        *((text, "") for text in ("", "{", "[]", "{}", "\xff", "[" * 10_000)),
        *((f'{{"schema_version": {version}}}', "") for version in ('"new"', "1e999")),
        *((without(name), f"no {name}); move it away") for name in FIXED),
    ],
    ids=range(13),
)
def test_a_damaged_manifest(tmp_path, text, message):
    path = tmp_path / "manifest.json"
    path.write_text(text, encoding="latin-1")
    assert refusal(read_manifest, tmp_path).startswith(f"{path}: not a manifest ({message}")


def test_a_run_that_was_stopped_is_not_finished(tmp_path):
    for text in (json.dumps(make_manifest(finished=None)), without("finished")):
        (tmp_path / "manifest.json").write_text(text)
        assert refusal(read_finished, tmp_path) == (
            f"{tmp_path}: the run is not finished; start it again with its command"
        )


def test_manifests_are_kept_to_the_letter(tmp_path):
    manifest = make_manifest(note="Fréchet", seed=2**40)
    write_manifest(tmp_path, manifest)
    assert read_manifest(tmp_path) == read_finished(tmp_path) == manifest
    assert names(tmp_path.iterdir()) == ["manifest.json"]  # nothing temporary


def test_manifests_from_before_versions_of_the_protocol_are_of_the_first(tmp_path):
    manifest = make_manifest()
    del manifest["protocol"]
    write_manifest(tmp_path, manifest)
    assert read_manifest(tmp_path, older=True) == make_manifest(protocol=1)


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
