from __future__ import annotations

import io
import os
import re
import signal
import sqlite3
import tracemalloc
import zlib
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from bench.records.folder import open_folder, open_store
from bench.records.frames import Artifact, read_jobs, stored_artifacts
from bench.records.job import MOST_TEXT, OF_VIEWS, failed, pack, pack_views, unpack
from bench.records.store import MOST_VIEWS, STORE, DamagedJob, row_checksum
from data_prep.failures import BadInput, CannotWrite
from data_prep.scene import View
from tests.robustness.failing_writes import cut_everywhere

from ..builders import make_job, make_record, make_result, refusal, store_images


def finish(job, seed=0):
    """The result of a job with a score that has no short decimal fraction, and small images."""
    images = np.random.default_rng(seed).integers(0, 256, (2, 16, 16, 3), np.uint8)
    records = [
        make_record(ssim=1 / 3, lpips=None, notes="ä\n"),
        make_record(view=1, notes="ä\n"),
    ]
    return make_result(job, records, images=images, judge=np.full((2, 3), 0.1, np.float32))


def fill(directory, *methods, seed=0):
    """Store that a job of each method is finished, and return the jobs."""
    jobs = [make_job(method=method) for method in methods]
    with open_folder(directory) as store:
        for job in jobs:
            store.append(finish(job, seed))
        store.list_jobs((job.key, job.name) for job in jobs)
    return jobs


def test_a_stored_result_is_read_back_whole(tmp_path):
    job, broken = make_job(), make_job(method="blank")
    done, lost = finish(job), failed(broken, 'crash: "ä" \u2028 died')
    with open_folder(tmp_path) as store:
        assert store.is_empty
        assert store.find([job.key]) == {}
        store.environment = {"torch": "2"}
        store.append(done)
        store.append(lost)
        assert store.appended == 2
    for opened in (open_folder, open_store):
        with opened(tmp_path) as store:
            assert not store.is_empty
            found = store.find([job.key, "unknown", broken.key])
            assert {key: result.reason for key, result in found.items()} == {
                job.key: "",
                broken.key: lost.reason,
            }
            stored = {"environment": '{"torch": "2"}'}
            whole = replace(done, arrays={}, **stored)
            assert store.result(job.key) == whole  # 1/3 to the last bit
            assert store.result(job.key).of_views["ssim"].tolist() == [1 / 3, 0.5]
            assert np.isnan(store.result(job.key).of_views["lpips"]).tolist() == [True, False]
            assert store.result(broken.key) == replace(lost, **stored)
            assert store.arrays(job.key) == done.arrays
            assert unpack(store.array(job.key, "judge")).tolist() == [[np.float32(0.1)] * 3] * 2
            for absent in (store.array, store.arrays, store.result):
                with pytest.raises(KeyError):
                    absent("unknown")
            for key, name in ((broken.key, "images"), (job.key, "fid")):
                with pytest.raises(KeyError):
                    store.array(key, name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lock", STORE]


def test_a_store_that_is_written_syncs_at_commit(tmp_path, monkeypatch):
    """NORMAL, which many set beside WAL, would let a power cut take back what was stored."""
    opened, connect = [], sqlite3.connect

    def noted(*args, **options):
        opened.append(connect(*args, **options))
        return opened[-1]

    monkeypatch.setattr(sqlite3, "connect", noted)
    fill(tmp_path, "splat")  # also where the file is there already
    with open_folder(tmp_path) as store:
        store.append(finish(make_job(method="blank")))
        settings = [opened[-1].execute(f"PRAGMA {n}") for n in ("journal_mode", "synchronous")]
        assert [rows.fetchone()[0] for rows in settings] == ["wal", 2]  # FULL


def test_a_later_result_replaces_an_earlier_one(tmp_path):
    job = make_job()
    with open_folder(tmp_path) as store:
        store.append(finish(job))
        store.append(finish(job, 1))
        assert store.arrays(job.key) == finish(job, 1).arrays
        store.append(failed(job, "crash: gone"))
        assert not store.find([job.key])[job.key].has_images
    database = sqlite3.connect(tmp_path / STORE)
    assert database.execute("SELECT count(*) FROM blob").fetchone() == (0,)
    database.close()


def test_jobs_of_a_complete_run_keep_the_order_of_its_plan(tmp_path):
    jobs = fill(tmp_path, "splat", "blank")
    lost = make_job(method="constant")
    with open_folder(tmp_path) as store:
        store.append(failed(lost, "crash: gone"))
        # One job stands for two conditions.
        named = [(job.key, job.name) for job in (lost, *jobs)]
        named.append((jobs[1].key, jobs[1].name._replace(condition="512")))
        store.list_jobs(named)
        assert [(row.key, row.name) for row in store.listed()] == named
        assert [row.key for row in store.listed("chair", lost.object.object_id)] == [
            key for key, _ in named
        ]
        results = dict(store.results())
        assert [*results] == sorted(name for _, name in named)
        assert results[jobs[0].name] == store.result(jobs[0].key)
        only = {"method": "blank", "condition": "512"}
        assert [name for name, _ in store.results(**only)] == [named[-1][1]]
        with pytest.raises(KeyboardInterrupt):
            store.list_jobs(_interrupted())
        assert [row.key for row in store.listed()] == [key for key, _ in named]
    assert [row.key for row in read_jobs(tmp_path)] == [key for key, _ in named]
    artifacts = stored_artifacts(tmp_path)
    assert list(artifacts) == [name for key, name in named if key != lost.key]
    assert len(artifacts) == 3
    assert lost.name not in artifacts
    assert artifacts[named[-1][1]] == artifacts[jobs[1].name] == Artifact(tmp_path, jobs[1].key)
    assert np.array_equal(artifacts[jobs[0].name].read(), unpack(finish(jobs[0]).arrays["images"]))


def _interrupted():
    yield "a key", make_job().name
    raise KeyboardInterrupt


def test_a_folder_without_a_store_has_no_jobs(tmp_path):
    with open_store(tmp_path) as store:
        assert store.is_empty
    assert (read_jobs(tmp_path), dict(stored_artifacts(tmp_path))) == ([], {})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["images", "judge"])
@pytest.mark.parametrize("harm", ["missing", "altered", "cut"])
def test_an_array_that_has_changed_is_refused_and_its_job_forgotten(tmp_path, harm, name):
    job, other = fill(tmp_path, "splat", "blank")
    harm_array(tmp_path, job.key, harm, name)
    artifact = stored_artifacts(tmp_path)[job.name]
    assert (artifact.read_images() is None) == (name == "images")
    what = name if name == "images" else "features (judge)"
    assert refusal(artifact.read, name).startswith(
        f"{tmp_path / STORE}: the {what} of job {job.key} are missing or altered; start the run"
    )
    with open_folder(tmp_path) as store:
        with pytest.raises(DamagedJob):
            store.arrays(job.key)
        assert store.forget_damaged() == 1
        assert store.find([job.key, other.key]).keys() == {other.key}


def sealed(**changes):
    """Return what writes other values into the row of a job, with a checksum that fits them."""

    def harm(database, key):
        names = "key, suite, reason, notes, prepare_s, draw_s, views, blobs, environment"
        (row,) = database.execute(f"SELECT {names} FROM job WHERE key = ?", [key])
        row = (*(changes.get(n, v) for n, v in zip(names.split(", "), row, strict=True)),)
        database.execute("DELETE FROM job WHERE key = ?", [key])
        marks = ", ".join("?" * 10)
        query = f"INSERT INTO job ({names}, sha256) VALUES ({marks})"
        database.execute(query, (*row, row_checksum(row)))

    return harm


@pytest.mark.parametrize(
    "harm",
    [
        "views = x'00'",
        "views = substr(views, 1, length(views) - 8)",
        "views = 'text'",
        "views = zeroblob(96)",
        "reason = 'draw: lost'",
        "reason = CAST(x'eda080' AS TEXT)",  # a lone surrogate
        "notes = 7.5",
        "prepare_s = 0.5",
        "draw_s = 'soon'",
        "suite = x'00'",
        "blobs = '{}'",
        "sha256 = ''",
        sealed(views=np.full(len(OF_VIEWS), 1e301).tobytes()),
        sealed(views=np.full(len(OF_VIEWS), -np.inf).tobytes()),
        sealed(views=bytes(8 * len(OF_VIEWS) * (MOST_VIEWS + 1))),
        sealed(prepare_s=1e308),
        sealed(blobs="[" * 100_000),
        sealed(blobs="[]"),
        sealed(blobs='{"images": 7}'),
    ],
    ids=range(19),
)
def test_records_that_have_changed_are_refused_and_their_job_forgotten(tmp_path, harm):
    job, other = fill(tmp_path, "splat", "blank")
    with closing(sqlite3.connect(tmp_path / STORE)) as database, database:
        if isinstance(harm, str):
            database.execute(f"UPDATE job SET {harm} WHERE key = ?", [job.key])
        else:
            harm(database, job.key)
    with open_folder(tmp_path) as store:
        message = refusal(store.arrays, job.key)
        assert f" of job {job.key} are missing or altered; start" in message
        assert store.forget_damaged() == 1
        assert store.find([job.key, other.key]).keys() == {other.key}


def test_a_changed_name_is_refused_and_the_next_run_writes_the_list_anew(tmp_path):
    """A byte is changed in the table, and in its index: SQLite compares the two."""
    job, other = fill(tmp_path, "splat", "blank")
    path, told = tmp_path / STORE, "the list of its jobs is damaged; start the run again"
    data = path.read_bytes()
    places = [match.start() for match in re.finditer(b"splat2048chair", data)]
    assert len(places) == 2
    for place in places:
        path.write_bytes(data[:place] + b"t" + data[place + 1 :])
        with open_store(tmp_path) as store:
            for read in (store.listed, store.results, lambda: [store.has_features("judge")]):
                assert told in refusal(lambda read=read: [*read()])
    named = [(job.key, job.name), (other.key, other.name)]
    with open_folder(tmp_path) as store:
        store.list_jobs(named)
        assert [(row.key, row.name) for row in store.listed()] == named


def test_a_listed_job_that_is_gone_is_named(tmp_path):
    job, _ = fill(tmp_path, "splat", "blank")
    with closing(sqlite3.connect(tmp_path / STORE)) as database, database:
        database.execute("DELETE FROM job WHERE key = ?", [job.key])
    with open_store(tmp_path) as store:
        assert f"the records of job {job.key} are missing" in refusal(lambda: [*store.results()])


def test_a_journal_that_a_killed_process_has_left_is_taken_back(tmp_path):
    """Also by one that only reads: SQLite refuses to read before."""
    if os.fork() == 0:
        database = sqlite3.connect(tmp_path / STORE, isolation_level=None)
        database.execute("PRAGMA cache_size = 1")
        database.execute("CREATE TABLE job (a)")
        database.execute("BEGIN")
        for _ in range(99):  # more than its cache: some pages are in the file
            database.execute("INSERT INTO job VALUES (zeroblob(9999))")
        os._exit(0)
    os.wait()
    assert (tmp_path / f"{STORE}-journal").stat().st_size > 0
    assert "a database, but not the store of a run" in refusal(read_jobs, tmp_path)
    assert not (tmp_path / f"{STORE}-journal").exists()


def packed(shape, data, kind="|u1", version=(1, 0)):
    """An array that says that it has another shape or type than its bytes."""
    header = io.BytesIO()
    about = {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(header, about)
    start = np.lib.format.magic(*version) + header.getvalue()[8:]
    return zlib.compress(start + data)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (packed((1, 128, 128, 3), bytes(600 * 2**20)), "of more than 512 MiB"),
        (packed((2**34, 128, 128, 3), bytes(49_152)), "cannot reshape"),
        (packed((1, 128, 128, 3), bytes(49_151)), "cannot reshape"),
        (packed((1,), bytes(8), "|O"), "OBJECT"),
        (packed((1,), bytes(1), version=(3, 0)), "of another format"),
        (pack(np.arange(3))[:-1], "cut short"),
        (zlib.compress(b"PK"), ""),
        (b"PK", "incorrect header check"),
        (b"", "cut short"),
    ],
    ids=range(9),
)
def test_what_is_no_array_is_refused_and_takes_no_more_memory_than_images_do(data, why):
    message = refusal(unpack, data)
    assert message.startswith("no packed array (")
    assert why in message


def test_arrays_keep_their_values_and_types():
    for array in (np.arange(12, dtype=np.uint8).reshape(2, 2, 3), np.float32([[0.1]]), np.ones(0)):
        same = unpack(pack(array))
        assert (same.dtype, same.tolist()) == (array.dtype, array.tolist())


def test_a_reason_is_short_and_every_file_takes_it(tmp_path):
    job = make_job()
    with open_folder(tmp_path) as store:
        store.append(failed(job, "\ud800" + 3_000_000 * "long "))
        assert store.find([job.key])[job.key].reason.startswith("\\ud800long ")
        assert len(store.result(job.key).reason) == MOST_TEXT
        store.append(replace(finish(job), notes="\udfff\0b", prepare_s=1, draw_s=float("nan")))
        kept = store.result(job.key)
        assert (kept.notes, kept.prepare_s, kept.draw_s) == ("\\udfff\0b", 1.0, None)


def endless(database):
    database.execute("ALTER TABLE job RENAME TO others")
    database.execute(
        "CREATE VIEW job AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) "
        "SELECT x AS id, 'k' || x AS key, '' AS reason FROM n"
    )


@pytest.mark.parametrize("harm", ["pipe", "link", "wal", "view", "trigger", "virtual"])
def test_a_store_that_is_more_than_a_file_with_tables_is_refused(tmp_path, harm):
    run = tmp_path / "run"
    fill(run, "splat")
    path = run / STORE
    if harm in ("pipe", "link"):
        path.rename(tmp_path / "elsewhere")
    with closing(sqlite3.connect(path if path.exists() else ":memory:")) as database, database:
        match harm:
            case "pipe":
                os.mkfifo(path)
            case "link":
                path.symlink_to(tmp_path / "elsewhere")
            case "wal":
                os.mkfifo(run / f"{STORE}-wal")
            case "view":
                endless(database)
            case "trigger":
                database.execute("CREATE TRIGGER t AFTER INSERT ON job BEGIN SELECT 1; END")
            case "virtual":
                database.execute("CREATE VIRTUAL TABLE v USING fts5(a)")
    for read in (read_jobs, lambda folder: open_folder(folder).__enter__()):
        assert "move it away" in refusal(read, run)


def test_damage_in_a_run_that_is_not_complete_is_forgotten_too(tmp_path):
    """Nothing is listed before the tables of a run are made; its true images are read before."""
    job = make_job()
    with open_folder(tmp_path) as store:
        store.append(finish(job))
    harm_array(tmp_path, job.key, "altered")
    with open_folder(tmp_path) as store:
        assert store.forget_damaged() == 1
        assert store.is_empty


def harm_array(directory, key, harm, name="images"):
    """Remove, alter or cut an array of a job in the store of a folder."""
    where = "WHERE name = ? AND job = (SELECT id FROM job WHERE key = ?)"
    with closing(sqlite3.connect(directory / STORE)) as database, database:
        ((data,),) = database.execute(f"SELECT data FROM blob {where}", (name, key))
        if harm == "missing":
            database.execute(f"DELETE FROM blob {where}", (name, key))
        else:
            changed = data[:-1] if harm == "cut" else data[:50] + bytes([data[50] ^ 1]) + data[51:]
            database.execute(f"UPDATE blob SET data = ? {where}", (changed, name, key))


def test_records_and_images_are_read_back_and_not_kept(tmp_path):
    """What a process holds of a store does not grow with its jobs."""
    job = make_job()
    views = pack_views([View(float(number), 0.0) for number in range(400)])
    result = replace(finish(job), views=views, notes="n" * 500)
    with open_folder(tmp_path) as store:
        store.append(result)
        tracemalloc.start()
        try:
            for number in range(30):
                store.append(replace(result, key=f"{number}"))
            held, _ = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert store.result("3").views == views
    assert held < 30_000


# --- kills, full disks, and files of others -------------------------------------------------------


def leave_wal(directory, jobs):
    """Store results in a process that then dies, so that they are in the second file only."""
    if os.fork() == 0:
        with open_folder(directory) as store:
            for job in jobs:
                store.append(finish(job))
            os._exit(0)
    os.wait()
    return directory / f"{STORE}-wal"


def test_cut_after_any_byte_the_last_transactions_have_whole_results_and_no_others(tmp_path):
    jobs = [make_job(method=method) for method in ("splat", "blank", "constant")]
    wal, keys = leave_wal(tmp_path, jobs), [job.key for job in jobs]
    assert wal.stat().st_size > 30_000
    assert list(cut_everywhere(tmp_path, keys, step=999)) == []
    other = [*keys[1:], keys[0]]
    assert any("count" in fault for fault in cut_everywhere(tmp_path, other, step=4999))


def test_a_full_disk_takes_nothing_that_was_stored(tmp_path):
    """A limit on the size of files acts like a disk that is full after so many bytes."""
    job, other = make_job(), make_job(method="blank")
    if (child := os.fork()) == 0:
        import resource

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        ended = 1
        try:
            with open_folder(tmp_path) as store:
                store.append(finish(job))
                resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))
                store.append(replace(finish(other), arrays={"images": b"x" * 200_000}))
        except CannotWrite as error:
            ended = 0 if str(error).endswith("make room and run again") else 2
        os._exit(ended)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    with open_folder(tmp_path) as store:
        assert store.find([job.key, other.key]).keys() == {job.key}
        assert store.arrays(job.key) == finish(job).arrays


def write_database(path, **pragmas):
    database = sqlite3.connect(path)
    database.execute("CREATE TABLE mine (a)")
    for name, value in pragmas.items():
        database.execute(f"PRAGMA {name} = {value}")
    database.commit()
    database.close()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("my notes" * 1000), "not a store of a run"),
        (write_database, "a database, but not the store of a run; move it away"),
        (
            lambda path: write_database(path, application_id=0x70633270, user_version=5),
            "store version 5 is newer than 4; update pc2pix-bench",
        ),
        (
            lambda path: write_database(path, application_id=0x70633270, user_version=3),
            "a store of version 2.0.0 or earlier, which this one does not read; start the run",
        ),
    ],
)
def test_files_of_others_and_of_later_versions_are_refused_unread(tmp_path, make, message):
    path = tmp_path / STORE
    make(path)
    before = path.read_bytes()
    for opened in (open_folder, open_store):
        assert refusal(opened(tmp_path).__enter__).startswith(f"{path}: {message}")
    assert path.read_bytes() == before
    assert {file.name for file in tmp_path.iterdir()} == {STORE, "lock"}


def test_a_damaged_page_is_named_with_the_remedy(tmp_path):
    (job,) = fill(tmp_path, "splat")
    path = tmp_path / STORE
    data = bytearray(path.read_bytes())
    data[4096 : 3 * 4096] = b"\xff" * 2 * 4096  # the tables of jobs
    path.write_bytes(data)
    message = r"run\.sqlite: damaged \(.*\); bring back a copy, or start"
    with pytest.raises(BadInput, match=message), open_store(tmp_path) as store:
        store.find([job.key])


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_read(tmp_path):
    (job,) = fill(tmp_path, "splat")
    tmp_path.chmod(0o500)
    try:
        with open_store(tmp_path) as store:
            assert store.result(job.key).views == finish(job).views
        assert "cannot be written" in refusal(open_folder(tmp_path).__enter__)
    finally:
        tmp_path.chmod(0o700)


def test_a_reader_sees_what_is_stored_while_a_run_goes_on(tmp_path):
    job = make_job()
    with open_folder(tmp_path) as store:
        store.append(finish(job))
        with open_store(tmp_path) as reader:
            assert reader.find([job.key]).keys() == {job.key}
        store.append(failed(make_job(method="blank"), "crash: gone"))


def test_images_are_there_by_a_handle(tmp_path):
    job = make_job()
    artifact = store_images(tmp_path, job, images=np.zeros((2, 4, 4, 3), np.uint8), x=np.ones(3))
    assert artifact.read("x").tolist() == [1.0] * 3
    images = artifact.read_images()
    assert images is not None
    assert images.shape == (2, 4, 4, 3)
    with pytest.raises(KeyError):
        artifact.read("y")
    assert Artifact(tmp_path, "unknown").read_images() is None
