"""Verifications of a finished run, honest and altered, by its folder and without it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.analysis.scored import scored_run
from bench.receipts.folder import compare_folder, compare_manifest
from bench.receipts.receipt import (
    describe_manifest,
    find_objects,
    make_receipt,
    read_receipt,
)
from bench.receipts.verify import VerifierChoices, random_seed, verify
from bench.records.artifacts import JobName, pack, unpack
from bench.records.run_folder import read_manifest, read_store
from bench.records.store import open_store, pack_records
from bench.running.protocol import name_of
from bench.running.run import write_parquet
from bench.tables.build import write_outputs

from ..builders import refusal
from .runs import alter_manifest, execute, receipt_of, verified, write_receipt

SPLAT = JobName("splat", "2048", "chair", "test-0001")
TRUE = SPLAT.truth
OF = "splat at 2048 of chair/test-0001"


@pytest.fixture
def receipt(finished, tmp_path):
    return receipt_of(finished[0], tmp_path / "receipt.json")


@pytest.fixture
def check(finished, receipt, same_machine):
    """Return the differences of a verification of a folder, by default by checksums alone."""

    def differences(folder, path=receipt, share=0.0, **choices):
        return list(verified(path, folder, finished[0], share=share, **choices).differences)

    return differences


def tree(folder: Path) -> dict[str, tuple[int, bytes]]:
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(p): (p.stat().st_mtime_ns, sha256(p.read_bytes()).digest()) for p in files}


@pytest.mark.parametrize("seed", [0, 1])
def test_an_honest_receipt_is_verified_and_nothing_is_written(finished, check, seed):
    before = tree(finished[0])
    assert check(finished[0], share=0.3, seed=seed) == []
    assert tree(finished[0]) == before


def test_all_jobs_are_computed_again_without_the_folder_and_tables_made(finished, receipt, check):
    verdict = verified(receipt, None, finished[0], share=1.0)
    assert verdict.differences == ()
    assert verdict.remarks[1] == (
        "computed again: 18 of 18 jobs and 3 of 3 objects' true images, drawn by --seed 0"
    )
    changed = read_receipt(receipt)
    changed["tables"]["table3_ssim.csv"] = changed["records"] = "0" * 64
    other = write_receipt(receipt.with_name("other.json"), changed)
    assert check(None, other, share=1.0) == [
        "tables/table3_ssim.csv: the table of the results here is not that of the receipt",
        "records.parquet: the records here are not those of the receipt",
    ]


def test_a_part_is_computed_again_without_the_folder(finished, receipt, check):
    verdict = verified(receipt, None, finished[0], share=0.05, seed=3)
    assert verdict.differences == ()
    assert "computed again: 6 of 18 jobs and 1 of 3 objects' true images" in verdict.remarks[1]
    assert verdict.remarks[2].startswith("not known without --run: the other jobs")
    changed = read_receipt(receipt)
    changed["jobs"]["parts"] = "0" * 48
    other = write_receipt(receipt.with_name("other.json"), changed)
    (line,) = check(None, other, share=0.05)
    assert line.startswith("jobs of chair/test-000")
    assert line.endswith("the results here are not those of the receipt")


def by_checksums(folder, receipt):
    """Return the differences that are found without tables made again."""
    manifest = read_manifest(folder)
    described, objects = describe_manifest(folder, manifest), find_objects(receipt["request"])
    names = [name_of(obj) for obj in objects]
    return [
        *compare_manifest(receipt, described, manifest["objects"], names),
        *compare_folder(receipt, folder, manifest),
    ]


def in_file(name, change):
    def alter(folder):
        path = folder / name
        path.write_bytes(change(path.read_bytes()))

    return alter


def in_store(*command):
    return lambda folder: execute(folder, command)


def one_digit(data):
    """Return a table with the last digit of its last value but one changed."""
    place = max(i for i, byte in enumerate(data[:-200]) if chr(byte) in "12345678")
    return data[:place] + bytes([data[place] + 1]) + data[place + 1 :]


def other_score(folder):
    frame = pd.read_parquet(folder / "records.parquet")
    frame.loc[3, "ssim"] += 1e-9
    frame.to_parquet(folder / "records.parquet")


def other_feature(folder):
    path = folder / "features" / "fd-views.parquet"
    frame = pd.read_parquet(path)
    frame.at[5, "features"] = frame.at[5, "features"] + np.float32(1e-3)
    frame.to_parquet(path)


OF_SPLAT = "key = (SELECT key FROM listed WHERE method = 'splat' AND object = 'test-0001' LIMIT 1)"


@pytest.mark.parametrize(
    ("alter", "line"),
    [
        (in_file("tables/table3_ssim.csv", one_digit), "tables/table3_ssim.csv: not the table"),
        (lambda folder: (folder / "tables/headline.csv").unlink(), "tables: no headline.csv"),
        (other_score, "records.parquet: its records are not those of the receipt"),
        (in_store(f"UPDATE jobs SET reason = 'x' WHERE {OF_SPLAT}"), "jobs of chair/test-0001: "),
        (
            in_store("DELETE FROM listed WHERE object = 'test-0002' AND method = 'blank'"),
            "no blank at 2048 of chair/test-0002 in its store",
        ),
        (
            in_store("UPDATE listed SET condition = '512' WHERE condition = '2048'"),
            "no blank at 2048 of chair/test-0000 in its store",
        ),
        (
            in_store("UPDATE artifacts SET data = zeroblob(9) WHERE id = 1"),
            "missing or altered",
        ),
        (in_store("UPDATE jobs SET records = zeroblob(9) WHERE id = 1"), "cannot be read"),
        (lambda folder: alter_manifest(folder, seed=1), "manifest: request: seed 1, in the"),
        (lambda folder: alter_manifest(folder, code="x"), "manifest: code: sha256 x, in the"),
        (lambda folder: alter_manifest(folder, objects=["chair/a"]), "manifest: 1 objects, not"),
    ],
)
def test_an_altered_folder_is_found_by_its_checksums(copied, receipt, alter, line):
    alter(copied)
    differences = by_checksums(copied, read_receipt(receipt))
    assert any(line in difference for difference in differences), differences


def test_what_does_not_follow_from_the_jobs_is_found(copied, check):
    in_file("tables/table3_ssim.md", one_digit)(copied)
    other_feature(copied)
    alter_manifest(copied, skipped_metrics={"fid": "skipped: no"})
    assert check(copied) == [
        "features/fd-views.parquet: not the features of the jobs in the store",
        "tables/table3_ssim.md: not the table that follows from the jobs",
        "tables/table4_fid.csv: not the table that follows from the jobs",
        "tables/table4_fid.md: not the table that follows from the jobs",
    ]


@pytest.mark.parametrize("change", [lambda data: data[:5000], lambda data: b"x" * 100 + data[100:]])
def test_a_store_that_cannot_be_read_is_a_difference(copied, check, change):
    in_file("run.sqlite", change)(copied)
    differences = check(copied, share=1.0)
    assert differences[0].startswith("run.sqlite: cannot be read (")


def test_times_and_jobs_of_no_run_are_no_results(copied, check):
    with open_store(copied) as store:
        (row,) = [r for r in store.listed() if r.name == SPLAT]
        records = [replace(r, prepare_s=9.0, draw_s=9.0) for r in store.records(row.key)]
    execute(
        copied,
        ("UPDATE jobs SET records = ? WHERE key = ?", pack_records(records), row.key),
        ("INSERT INTO jobs (key, reason, records) VALUES ('x', '', '')",),
        ("UPDATE listed SET place = place + 100",),
    )
    assert check(copied) == []


def publish_again(folder: Path, path: Path) -> Path:
    """Make records, tables and the receipt of a folder anew, as a forger does."""
    manifest = read_manifest(folder)
    with read_store(folder) as store:
        write_parquet(manifest, folder, store, manifest["feature_identity"], {})
    write_outputs(scored_run(folder, manifest))
    return receipt_of(folder, path)


def forge(folder: Path, name: JobName, change) -> None:
    """Replace records and arrays of a job by what `change` makes of them, checksums included."""
    with open_store(folder) as store:
        (row,) = [r for r in store.listed() if r.name == name]
        arrays = unpack(
            store.artifact(row.key), ["images", *read_manifest(folder)["feature_identity"]]
        )
        records, arrays = change(store.records(row.key), arrays)
    artifact = pack(arrays)
    execute(
        folder,
        ("UPDATE jobs SET records = ? WHERE key = ?", pack_records(records), row.key),
        (
            "UPDATE jobs SET artifact_sha256 = ? WHERE key = ?",
            sha256(artifact).hexdigest(),
            row.key,
        ),
        (
            "UPDATE artifacts SET data = ? WHERE id = (SELECT id FROM jobs WHERE key = ?)",
            artifact,
            row.key,
        ),
    )


def better_ssim(records, arrays):
    return [records[0], replace(records[1], ssim=records[1].ssim + 0.125)], arrays


def brighter(records, arrays):
    images = arrays["images"].copy()
    images[1, 0, 0] -= 9
    return records, arrays | {"images": images}


def other_judge(records, arrays):
    return records, arrays | {"judge": arrays["judge"] + np.float32(0.5)}


@pytest.mark.parametrize(
    ("name", "change", "start", "end"),
    [
        (SPLAT, better_ssim, f"{OF}: ssim ", "by 0.125 (1 of 2 views, most view 1)"),
        (SPLAT, brighter, f"{OF}: images of 1 of 2 views ", "by up to 9 levels of 255"),
        (TRUE, other_judge, "ground-truth of chair/test-0001: features of judge ", "up to 0.5"),
    ],
)
def test_a_consistent_forgery_is_found_where_its_job_is_drawn(
    copied, check, tmp_path, name, change, start, end
):
    forge(copied, name, change)
    path = publish_again(copied, tmp_path / "forged.json")
    assert check(copied, path) == []  # by checksums alone it is the folder of its receipt
    (line,) = check(copied, path, share=1.0)
    assert line.startswith(start)
    assert line.endswith(end)


def elsewhere(folder: Path, path: Path) -> Path:
    """Return the receipt of a run that another driver has drawn."""
    environment = read_manifest(folder)["environment"] | {"gl": "another"}
    alter_manifest(folder, environment=environment)
    return receipt_of(folder, path)


def test_in_another_environment_results_may_differ_within_tolerances(copied, check, tmp_path):
    def move(by):
        return lambda records, arrays: ([replace(r, ssim=r.ssim + by) for r in records], arrays)

    path = elsewhere(copied, tmp_path / "elsewhere.json")
    assert check(copied, path, share=1.0) == []
    forge(copied, SPLAT, move(0.01))
    publish_again(copied, path)
    lines = check(copied, path, share=1.0)
    assert len(lines) == 2
    assert lines[0].endswith("by 0.01, allowed 0.0022")
    assert lines[1].endswith("ssim is not that of its images in the run, by 0.01")
    forge(copied, SPLAT, move(-0.01))
    forge(
        copied, TRUE, lambda records, arrays: (records, arrays | {"images": arrays["images"] // 2})
    )
    forge(copied, TRUE, other_judge)
    publish_again(copied, path)
    lines = check(copied, path, share=1.0)
    assert any("true images here, at least 0.988 expected" in line for line in lines)
    assert any("features of judge are not those of its images" in line for line in lines)


def test_another_environment_without_the_folder_says_what_is_needed(
    copied, receipt, same_machine, tmp_path
):
    path = elsewhere(copied, tmp_path / "elsewhere.json")
    with pytest.raises(ValueError, match="give --run DIR") as error:
        verified(path, None, copied, gl="a third")
    assert "gl a third, in the receipt another" in str(error.value)
    assert verified(path, None, copied, gl="a third", share=0.0).differences == ()


def test_other_code_weights_and_objects_here_are_found(finished, receipt, check, tmp_path):
    changed = read_receipt(receipt)
    (method,) = changed["weights"]
    changed["weights"][method] = changed["metrics"]["judge"] = "1" * 64
    changed["code"] |= {"sha256": "2" * 64, "commit": "abc"}
    changed["inputs"]["sha256"] = "3" * 64
    lines = check(None, write_receipt(tmp_path / "other.json", changed))
    assert [line.partition(" ")[0] for line in lines] == ["code:", "weights", "weights", "objects"]
    assert lines[0] == "code: not that of the receipt; check out abc"
    assert lines[1].startswith(f"weights here: {method} ")
    assert lines[2].startswith("weights of metrics here: judge ")


def test_what_cannot_be_verified_is_refused(finished, receipt, tmp_path, command):
    def answer(*arguments):
        status, out, err = command("verify", *arguments)
        assert (out, err.count("\n")) == ("", 1)
        return status, err

    assert answer(receipt, "--run", tmp_path / "none")[0] == 2
    status, err = answer(receipt, "--share", "1.5")
    assert (status, err) == (2, "bench: --share 1.5: must be from 0 to 1\n")
    garbled = tmp_path / "garbled.json"
    garbled.write_bytes(receipt.read_bytes().replace(b'"seed": 0', b'"seed": 1'))
    assert "garbled" in answer(garbled)[1]
    assert "no such file" in answer(tmp_path / "none.json")[1].lower()
    unknown = read_receipt(receipt)
    unknown["request"]["methods"] = ["splta"]
    status, err = answer(write_receipt(tmp_path / "unknown.json", unknown))
    assert status == 2
    assert err == (
        "bench: unknown method 'splta'; install its package, or give --images TREE if it was "
        "entered by images\n"
    )


def test_the_commands(finished, tmp_path, command, same_machine):
    folder, path = finished[0], tmp_path / "receipt.json"
    status, out, _ = command("receipt", folder)
    assert (status, json.loads(out)) == (0, make_receipt(folder))
    assert command("receipt", folder, "--out", path)[0] == 0
    assert path.read_text() == out
    status, out, err = command("verify", path, "--run", folder, "--share", "0")
    assert (status, out.splitlines()[-1]) == (0, "verified"), err
    copy = shutil.copytree(folder, tmp_path / "copy")
    in_file("tables/headline.csv", one_digit)(copy)
    status, out, _ = command("verify", path, "--run", copy, "--share", "0", "--seed", "5")
    lines = out.splitlines()
    assert status == 1
    assert "DIFFERS tables/headline.csv: not the table of the receipt" in lines
    assert lines[-1] == "not verified: 2 differences"
    assert "0 of 18 jobs" in out
    assert "--seed 5" in out


def test_the_seed_is_another_each_time(finished, receipt):
    assert len({random_seed() for _ in range(20)}) == 20
    assert "--share" in refusal(verify, receipt, VerifierChoices(share=-0.1))
