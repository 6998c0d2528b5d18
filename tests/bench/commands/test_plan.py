"""What a run would do and cost, without doing it."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace

import pytest
import torch
from harness_objects import Tetrahedron

import bench.metrics.inception_weights
from bench.catalogue.lookup import find
from bench.catalogue.methods import METHODS
from bench.catalogue.reconstruction import RANKING
from bench.catalogue.suites import SUITES
from bench.commands.plan import _kind, plan_of
from bench.commands.run import describe_run
from bench.records.job import failed
from bench.records.journal import open_journal, read_manifest, write_manifest
from bench.records.record import GROUND_TRUTH
from bench.running.manifest import describe
from bench.running.options import Options
from bench.running.pilot import Pilot, Sample
from bench.running.plan import plan
from bench.running.protocol import protocol_of
from bench.running.status import RunStatus, run_status
from bench.tables.markdown import document

from ..builders import SUITE, make_protocol

pytestmark = pytest.mark.usefixtures("no_machine")

FEW = ("--methods", "splat,blank", "--conditions", "2048,512", "--limit", "3", "--views", "2")


def tree(directory):
    """All files below, with times and bytes."""
    files = (path for path in directory.rglob("*") if path.is_file())
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


@pytest.fixture
def no_cache(monkeypatch, tmp_path_factory):
    """No weights of Inception have been downloaded before."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))


def test_dry_run_of_a_new_run_tells_all_and_writes_nothing(command, tmp_path, no_cache):
    status, out, err = command("run", "--suite", SUITE, *FEW, "--dry-run", "--out", tmp_path / "a")
    assert (status, err) == (0, "")
    assert list(tmp_path.iterdir()) == []
    for line in (
        r"objects +3 chair",
        rf"folder +{tmp_path}/a \(new\)",
        r"  splat +version 1, scipy .*",
        r"  fd-views +/.*views_network.safetensors",
        r"  fid +skipped: weights.*",
        r"ground truths: 3 to be done, 0 there",
        r"items: 12 to be done, 0 there",
        r"\| splat \| 3 \| 3 \|.*",
    ):
        assert re.search(f"^{line}$", out, re.M), line


@pytest.fixture
def one_run(copied, monkeypatch):
    """A finished run, on its machine."""
    environment = read_manifest(copied)["environment"]
    monkeypatch.setattr("bench.running.protocol.environment", lambda: environment)
    monkeypatch.setenv("XDG_CACHE_HOME", str(copied.parent))  # no weights for fid
    return copied


def test_dry_run_of_a_finished_run_leaves_it_as_it_is(one_run, command, arguments):
    before = tree(one_run)
    dry = (*arguments, "--dry-run", "--out", one_run)
    status, out, _ = command(*dry)
    assert status == 0
    assert "items: 0 to be done, 24 there" in out
    _, out, _ = command(*dry, "--fresh")
    assert "items: 24 to be done, 0 there" in out
    assert "the run there would be renamed" in out
    assert tree(one_run) == before


def test_dry_run_counts_what_is_left_of_a_begun_run(one_run, command, arguments):
    (journal,) = (one_run / "journal").glob("*.jsonl")
    lines = journal.read_bytes().splitlines(keepends=True)
    found = [json.loads(line.partition(b" ")[2]) for line in lines]
    splat = [i for i, line in enumerate(found) if line["records"][0]["method"] == "splat"]
    kept = [line for i, line in enumerate(lines) if i not in splat[:4]]  # of 6
    journal.write_bytes(b"".join(kept) + lines[splat[3]][:100])  # three gone, one torn
    key = found[splat[4]]["key"]
    next((one_run / "artifacts").rglob(f"{key}.npz")).write_bytes(b"not what was written")
    before = tree(one_run)
    _, out, _ = command(*arguments, "--dry-run", "--out", one_run)
    assert "items: 5 to be done, 19 there" in out
    assert tree(one_run) == before  # the journal is not repaired


def test_dry_run_of_a_download_fetches_nothing(no_cache, monkeypatch, tmp_path):
    monkeypatch.setattr(bench.metrics.inception_weights, "_download", pytest.fail)
    options = Options(SUITE, methods=("blank",), limit=1, inception_weights="download")
    out = describe_run(options)
    assert re.search(r"^  fid +to be downloaded first$", out, re.M)
    assert "skipped:" not in out
    assert "fid, fd-views" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("run --dry-run --suite speed", "--dry-run: the suite speed takes minutes and has no plan"),
        ("run --dry-run --suite latent", "--dry-run: the suite latent takes minutes and has no "),
        ("run --dry-run --suite speed-accuracy --workers 2", "--workers: has no meaning"),
        ("plan --suite stability", "bench plan: the suite stability takes minutes and has no plan"),
        (f"plan --suite {SUITE} --also splta", "unknown method 'splta': did you mean 'splat'?"),
        (f"plan --suite {SUITE} --pilot 0", "--pilot 0: must be at least 1"),
        (f"plan --suite {SUITE} --samples no/a.csv", "--samples no/a.csv: its folder is not there"),
    ],
)
def test_both_refuse_as_the_run_does(command, arguments, message, tmp_path):
    status, out, err = command(*arguments.split(), "--limit", "1", "--out", tmp_path / "a")
    assert (status, out) == (2, "")
    assert err.startswith(f"bench: {message}")


def test_dry_run_refuses_a_folder_of_another_run(one_run, command, arguments):
    other = one_run.parent / "other"
    other.mkdir()
    (other / "mine").write_text("")
    for message, more in (
        ("holds a run of seed 0, not 1", ("--out", one_run, "--seed", "1")),
        ("not empty and not a run", ("--out", other)),
        ("not empty and not a run", ("--out", other, "--fresh")),
    ):
        status, _, err = command(*arguments, "--dry-run", *more)
        assert (status, err.count(message)) == (2, 1)


def test_items_of_an_object_that_cannot_be_drawn_are_there(tmp_path):
    suite = find(SUITE, SUITES, "suite")
    options = Options(SUITE, methods=("blank",), conditions=("2048",), limit=3, out=tmp_path)
    protocol, _ = protocol_of(suite, options)
    planned = plan(protocol, tmp_path)
    with open_journal(tmp_path) as journal:
        journal.append(failed(planned.ground_truths[1], "input: no such shape"))
    write_manifest(tmp_path, describe(protocol, 1, {}))
    ahead = run_status(options, protocol)
    for found, left in (
        (ahead.left, 2),
        (ahead.left_of_first(1), 1),
        (ahead.left_of_first(2), 1),
        (ahead.left_of_first(9), 2),
    ):
        assert found == {(GROUND_TRUTH, ""): left, ("blank", "2048"): left}


@pytest.mark.slow
def test_plan_of_a_new_run(command, tmp_path, no_cache):
    pilot = ("--pilot", "2", "--workers", "1", "--also", "splat@spread=1.5")
    places = ("--out", tmp_path / "a", "--samples", tmp_path / "samples.csv")
    status, out, err = command("plan", "--suite", SUITE, *FEW, *pilot, *places)
    assert status == 0
    assert [path.name for path in tmp_path.iterdir()] == ["samples.csv"]
    assert "pilot: 2 of 3 objects x 2 conditions x 3 methods" in err
    assert "12 items to do" in out
    assert "Measured just now on 2 objects with one worker" in out
    for name, items in (("ground-truth", 3), ("splat", 6), ("blank", 3), ("**all**", 9)):
        assert re.search(rf"^\| {re.escape(name)} \| {items} \|", out, re.M), name
    assert "| without splat |" in out
    assert "--limit" not in out  # there is no smaller one
    with (tmp_path / "samples.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * (1 + 2 * 2 + 1)
    assert {row["method"] for row in rows} == {GROUND_TRUTH, "splat", "blank", "splat@spread=1.5"}


def test_plan_of_a_finished_run_measures_nothing(one_run, command, arguments):
    status, out, err = command("plan", *arguments[1:], "--out", one_run)
    assert (status, err) == (0, "")
    assert out == f"{one_run}: nothing is left to do; the run would make its tables.\n"


def make_run(tmp_path, objects=8, there=0, **changes) -> RunStatus:
    """A run of two workers; of its items the first `there` are done."""
    protocol = make_protocol(
        dataset="folder:a|b",
        methods=("pc2pix", "blank"),
        conditions=("2048", "1024", "512", "noise-0.05", "noise-0.10"),
        objects=tuple(Tetrahedron(str(number)) for number in range(objects)),
        views=20,
        **{"device": "auto"} | changes,
    )
    planned = plan(protocol, tmp_path)
    done = frozenset(job.key for job in planned.method_jobs[:there])
    return RunStatus(protocol, tmp_path, planned, done, 2)


def make_pilot(run, *methods, **changes) -> Pilot:
    """Of four objects: 180 s an item (45 s of them the method's), 45 s a ground truth."""
    common = {"peak_mib": 512.0, "reason": "", "method_s": 45.0}
    item = common | {"seconds": 180.0, "size_b": 125_000.0} | changes
    cells = [(m, c) for m in (*run.protocol.methods, *methods) for c in run.protocol.conditions]
    samples = []
    for number in range(4):
        place = {"class_name": "chair", "object_id": str(number), "size": 50.0 * number}
        truth = common | place | {"seconds": 45.0, "size_b": 125_000.0, "peak_mib": 256.0}
        loading = None if number else 18.0
        samples.append(Sample(GROUND_TRUTH, "", **truth, ssim=None, loading_s=loading))
        for method, condition in cells:
            values = item | place | ({"seconds": 0.0, "size_b": 0.0} if method == "blank" else {})
            samples.append(Sample(method, condition, **values, ssim=0.1 * number))
    return Pilot(tuple(samples), (0.0, 50.0, 100.0, 150.0))


def text_of(run, pilot, also=()) -> str:
    return document(plan_of(run, pilot, also))


def test_plan_has_hours_gpu_hours_disk_and_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    run = make_run(tmp_path)
    lines = text_of(run, make_pilot(run)).splitlines()
    assert lines[0] == r"# Plan of chair-robustness on folder:a\|b"
    assert "| ground-truth | 8 | 45 | 0.1 [0.1, 0.1] | - | 1 | 256 |" in lines
    assert "| pc2pix | 40 | 180 | 2 [2, 2] | 0.5 | 5 | 512 |" in lines
    assert "| start and loading |  |  | 0.01 | - |  |  |" in lines
    assert "| **all** | 48 |  | 2.1 [2.1, 2.1] | 0.5 | 6 | 512 |" in lines
    assert any(line.startswith("With 2 workers: **63 min** [63 min, 63 min], ") for line in lines)
    assert not any("pilot's items failed" in line for line in lines)
    refused = make_run(tmp_path, device="cpu")
    text = text_of(refused, make_pilot(refused))
    assert "| pc2pix | 40 | 180 | 2 [2, 2] | - | 5 | 512 |" in text


def test_plan_of_the_rest_and_of_failures(tmp_path):
    run = make_run(tmp_path, there=10)
    text = text_of(run, make_pilot(run, reason="draw: no"))
    assert f"70 items to do, 10 there in `{tmp_path}`." in text
    assert "24 of the pilot's items failed; they are counted as they were." in text
    few = make_run(tmp_path, objects=1, there=10)
    assert "With 2 workers: **63 s** [63 s, 63 s], " in text_of(few, make_pilot(few))


def test_plan_says_what_would_save(tmp_path):
    run = make_run(tmp_path, objects=20)
    text = text_of(run, make_pilot(run, optional_s=18.0))
    assert (
        "| --limit 10 | 2.6 | 2.6 | 50% | mean SSIM of pc2pix at 2048, the least certain: "
        "about ±0.080 in place of ±0.057 |"
    ) in text
    assert re.search(r"^\| without pc2pix \| 0.26 \| 5 \| 95% \| the most expensive", text, re.M)
    assert re.search(r"^\| without fid \| 4.6 \| 0.7 \| 13% \|", text, re.M)
    assert "`--also` with some of `pc2pix@" in text


def test_plan_compares_with_cheaper_methods_of_the_same_kind(tmp_path):
    run = make_run(tmp_path)
    also = ("pc2pix@bf16", "splat")
    found = make_pilot(run, *also)
    cheaper = [replace(s, seconds=90.0, ssim=0.5) if "@" in s.method else s for s in found.samples]
    text = text_of(run, replace(found, samples=tuple(cheaper)), also)
    assert (
        "| pc2pix@bf16 for pc2pix | 1.1 | 1 | 47% "
        "| mean SSIM in the pilot 0.500 in place of 0.150 |"
    ) in text
    assert "splat" not in text
    assert "`--also`" not in text


def test_all_reconstructions_are_of_one_kind():
    """Also the variants of one; nothing else is."""
    of_one_kind = {m.id for m in METHODS if _kind(m.id) == "reconstruction"}
    assert {*RANKING["2048"], "open3d-poisson"} == of_one_kind
    assert _kind("surface-apss@resolution=50") == "reconstruction"
    assert [_kind(id_) for id_ in ("splat", "pc2pix@bf16", "gone")] == ["splat", "pc2pix", "gone"]
