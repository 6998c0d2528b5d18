"""Merging. The shards take over what the whole run has drawn, for their keys are the same."""

from __future__ import annotations

import re
import shutil
import sqlite3
from contextlib import closing

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.analysis.scored_run import read_run
from bench.commands.publish import merge_shards, run_suite
from bench.records.frames import read_jobs
from bench.records.run_folder import (
    open_folder,
    open_store,
    read_manifest,
    write_manifest,
)
from bench.records.store import STORE
from bench.running.merge import interleave
from bench.running.options import Shard, read_shard
from bench.running.protocol import objects_to_search
from bench.tables.build import tables
from data_prep.datasets.protocol_version import PROTOCOL_VERSION
from data_prep.failures import BadInput

from ..builders import (
    as_failed,
    assert_equal_runs,
    file_bytes,
    finished_options,
    make_manifest,
    rows_of,
)

COUNT = 2


def as_shard(finished, tiny_weights, out, number, count=COUNT):
    """A shard of the finished run, by `run`: nothing is left to draw."""
    out.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(finished[0] / STORE, out / STORE)
    manifest = read_manifest(finished[0])
    objects = list(Shard(number, count).select(manifest["objects"]))
    write_manifest(out, manifest | {"shard": f"{number}/{count}", "objects": objects})
    done = run_suite(finished_options(tiny_weights, out, shard=Shard(number, count)))
    assert done.done == 0
    return out


def edit_store(directory, statement, *values):
    with closing(sqlite3.connect(directory / STORE)) as database, database:
        database.execute(statement, values)


@pytest.fixture(scope="module")
def made(finished, same_machine, tiny_weights, tmp_path_factory):
    """Both shards of the finished run."""
    folder = tmp_path_factory.mktemp("shards")
    return [as_shard(finished, tiny_weights, folder / str(k), k) for k in (1, 2)]


@pytest.fixture
def shards(made, tmp_path):
    """Copies, to be altered."""
    return [shutil.copytree(d, tmp_path / f"shard-{k}") for k, d in enumerate(made, 1)]


def test_a_shard_has_its_objects_and_tables_of_them(made):
    first, second = (read_manifest(directory)["objects"] for directory in made)
    assert first == ["chair/test-0000", "chair/test-0002"]
    assert second == ["chair/test-0001"]
    assert set(pd.read_parquet(made[1] / "records.parquet")["object"]) == {"test-0001"}
    assert all(row.n == 4 for row in rows_of(tables(read_run(made[0]))[0]))
    assert (made[1] / "report.html").is_file()
    assert read_manifest(made[0])["shard"] == "1/2"


def test_merged_shards_are_the_run_in_one_piece(finished, made, tmp_path, command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")  # pytest-xdist sets 80
    whole = tmp_path / "whole"
    status, out, err = command("merge", *made[::-1], "--out", whole)
    assert status == 0
    assert out.startswith(
        "ssim-object and lpips: 3 of 3 objects; against the true mesh in its colours; "
        f"protocol {PROTOCOL_VERSION}\n"
    )
    assert "21 jobs of 2 shards, 21 copied now" in err  # as the run counts them
    assert_equal_runs(whole, finished[0])
    assert file_bytes(whole / "figures") == file_bytes(finished[0] / "figures")
    assert read_jobs(whole) == read_jobs(finished[0])
    with open_store(whole) as merged, open_store(finished[0]) as in_one_piece:
        for job in read_jobs(whole):
            assert merged.result(job.key) == in_one_piece.result(job.key)
            assert merged.arrays(job.key) == in_one_piece.arrays(job.key)
    manifest, one_piece = read_manifest(whole), read_manifest(finished[0])
    for name in ("objects", "methods", "conditions", "suite", "identities", "shard"):
        assert manifest[name] == one_piece[name]
    assert [part["shard"] for part in manifest["merged"]] == ["1/2", "2/2"]
    assert (whole / "report.html").is_file()


@pytest.mark.slow
def test_a_merge_that_was_stopped_goes_on_and_the_run_too(made, tmp_path, tiny_weights):
    whole = tmp_path / "whole"
    merge_shards(made, whole)
    expected = file_bytes(whole / "tables")
    lost = sorted({job.key for job in read_jobs(whole)})[:3]
    edit_store(whole, "DELETE FROM job WHERE key IN (?, ?, ?)", *lost)
    write_manifest(whole, read_manifest(whole) | {"finished": None})
    assert merge_shards(made, whole).copied == 3
    assert file_bytes(whole / "tables") == expected
    assert merge_shards(made, whole).copied == 0
    again = run_suite(finished_options(tiny_weights, whole))
    assert (again.done, again.reused, again.failed) == (0, 21, 0)


def test_a_missing_shard_and_one_that_is_there_twice_are_named(shards, tmp_path, command):
    whole = tmp_path / "whole"
    status, _, err = command("merge", *shards[1:], "--out", whole)
    assert status == 2
    assert err == "bench: missing: shard 1/2; make it with --shard, and give it too\n"
    twice = shutil.copytree(shards[1], tmp_path / "again")
    with pytest.raises(BadInput, match=r"shard 2/2: is there twice, in .*shard-2 and .*again"):
        merge_shards([*shards, twice], whole)
    assert not whole.exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"shard": None}, "shard-2: is a whole run, no shard"),
        ({"shard": "2/3"}, "shard-2: is shard 2/3, .*shard-1 1/2"),
        ({"finished": None}, "shard-2: the run is not finished"),
        ({"planned": 5}, "shard-2: 1 of its 5 objects are complete; run the shard again"),
        ({"versions": "1.0"}, r"its versions is \{'torch': '1.0'\}, there \{'torch': '2"),
        ({"objects": ["chair/test-0000"]}, "chair/test-0000: is in several shards"),
        ({"objects": ["chair/a", "chair/b", "chair/c"]}, "objects: 1/2 has 2, 2/2 has 3"),
    ],
)
def test_what_does_not_belong_together_is_refused(shards, tmp_path, changes, message):
    manifest = read_manifest(shards[1])
    if "versions" in changes:  # of one package
        changes = {"versions": manifest["versions"] | {"torch": changes["versions"]}}
    write_manifest(shards[1], manifest | changes)
    with pytest.raises(BadInput, match=message):
        merge_shards(shards, tmp_path / "whole")
    assert not (tmp_path / "whole").exists()


OF_SHARD = {  # by entry: the value of a shard with this number
    **dict.fromkeys(("suite", "dataset", "device", "truth"), "made by {}".format),
    **dict.fromkeys(("views", "seed"), int),
    **dict.fromkeys(("methods", "conditions"), lambda number: [f"made by {number}"]),
    **dict.fromkeys(
        ("condition_identities", "skipped_metrics", "feature_identity", "environment", "versions"),
        lambda number: {"of": f"made by {number}", "same": "in both"},
    ),
    "identities": lambda number: {"splat": [number, "", "cpu"]},
}


@pytest.mark.parametrize("name", OF_SHARD)
def test_shards_that_were_not_made_alike_are_refused(tmp_path, name):
    """Other weights of a method or a metric, other packages, another machine: each by its name."""
    for number in (1, 2):
        (tmp_path / str(number)).mkdir()
        of_shard = {"shard": f"{number}/2", name: OF_SHARD[name](number)}
        write_manifest(tmp_path / str(number), make_manifest(**of_shard))
    other = OF_SHARD[name](2)
    shown = {"of": "made by 2"} if isinstance(other, dict) and "of" in other else other
    message = f"not of one run with .*1: its {name} is {re.escape(repr(shown))}, there "
    with pytest.raises(BadInput, match=message):
        merge_shards([tmp_path / "1", tmp_path / "2"], tmp_path / "whole")
    assert not (tmp_path / "whole").exists()


@pytest.mark.parametrize("harm", ["gone", "altered", "unlisted", "unfinished"])
def test_harmed_shards_are_refused_and_nothing_counts_as_finished(shards, tmp_path, harm):
    job = read_jobs(shards[0])[4]
    path = shards[0] / STORE
    message = f"{path}: the images of job {job.key} are missing or altered; start the run again"
    of_job = "WHERE name = 'images' AND job = (SELECT id FROM job WHERE key = ?)"
    if harm == "gone":
        edit_store(shards[0], f"DELETE FROM blob {of_job}", job.key)
    elif harm == "altered":
        edit_store(shards[0], f"UPDATE blob SET data = x'00' {of_job}", job.key)
    else:
        table = "job" if harm == "unfinished" else "listed"
        edit_store(shards[0], f"DELETE FROM {table} WHERE key = ?", job.key)
        message = f"{path}: has not all jobs of {'/'.join(job.name.object)} any more; run the shard"
    with pytest.raises(BadInput, match=message):
        merge_shards(shards, tmp_path / "whole")
    assert read_manifest(tmp_path / "whole")["finished"] is None


@pytest.mark.slow
def test_failed_jobs_and_their_reasons_come_along(shards, tmp_path):
    """A shard in which one job failed: without images, its records say why."""
    jobs = read_jobs(shards[1])
    chosen = jobs[2]  # of a network: it depends on the condition
    with open_folder(shards[1]) as store:
        store.append(as_failed(store.result(chosen.key), "apss: no faces"))
    merge_shards(shards, tmp_path / "whole")
    frame = pd.read_parquet(tmp_path / "whole" / "records.parquet")
    reasons = frame[frame["outcome"] == "failed"][["method", "reason"]].to_numpy().tolist()
    assert reasons == [[chosen.name.method, "apss: no faces"]] * 2


def test_a_folder_with_another_run_is_left_alone(copied, shards):
    manifest = read_manifest(copied)
    write_manifest(copied, manifest | {"seed": 5})
    with pytest.raises(BadInput, match="holds a run of seed 5, not 0"):
        merge_shards(shards, copied)


def test_more_shards_than_objects(finished, same_machine, tiny_weights, tmp_path):
    with pytest.raises(BadInput, match=r"--shard 4/4: there are only 3 objects; make fewer shards"):
        as_shard(finished, tiny_weights, tmp_path / "out", 4, 4)


@given(st.lists(st.integers(), max_size=40), st.integers(1, 12))
def test_what_was_interleaved_comes_back_in_its_order(things, count):
    assert interleave([Shard(k, count).select(things) for k in range(1, count + 1)]) == things


@pytest.mark.parametrize("shards", [["ab", "cde"], ["abc", "d"], ["ab", "c", "de"], ["", "a"]])
def test_what_cannot_have_been_interleaved(shards):
    with pytest.raises(ValueError, match="not interleaved"):
        interleave(shards)


@pytest.mark.parametrize(
    "text", ["", "1", "0/4", "5/4", "1/0", "-1/4", "1/4/4", "a/b", "1 /4", "१/४"]
)
def test_what_is_no_shard(text):
    assert read_shard("16/16") == Shard(16, 16)
    assert str(read_shard("2/16")) == "2/16"
    with pytest.raises(BadInput, match=r"--shard .*: give k/N, the kth of N parts"):
        read_shard(text)


def test_how_far_into_its_dataset_a_shard_reaches():
    """Of 11 objects shard 3 of 4 has numbers 3, 7 and 11."""
    three = {"objects": ["c/a"] * 3, "planned": 3}
    assert objects_to_search({**three, "shard": "3/4"}) == 12
    assert objects_to_search({**three, "shard": None}) == 3
