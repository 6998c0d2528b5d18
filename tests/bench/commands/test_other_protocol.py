"""Runs of another version of the protocol: each command refuses them and writes nothing."""

from __future__ import annotations

import json

import pytest
from builders import SUITE, write_run

from bench.records.run_folder import set_aside, write_manifest
from data_prep.datasets.protocol_version import PROTOCOL_VERSION

from .test_dry_run import tree

OLDER, NEWER = PROTOCOL_VERSION - 1, PROTOCOL_VERSION + 1
RUN = ("run", "--suite", SUITE, "--methods", "splat", "--limit", "1", "--views", "2")


def with_protocol(directory, version):
    manifest = json.loads((directory / "manifest.json").read_text())
    write_manifest(directory, manifest | {"protocol": version})
    return directory


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a folder with a run of this version, one of an older and one of a newer."""
    folder = tmp_path_factory.mktemp("protocols")
    write_run(folder / "ours")
    for name, version in (("older", OLDER), ("newer", NEWER)):
        with_protocol(write_run(folder / name), version)
    return folder


@pytest.mark.parametrize("other", ["older", "newer"])
@pytest.mark.parametrize(
    "arguments",
    [
        ("table", "OTHER"),
        ("report", "OTHER"),
        ("check", "OTHER"),
        ("check", "OTHER", "--bless"),
        ("check", "ours", "OTHER", "--claims"),
        ("recommend", "OTHER", "--budget-ms", "100"),
        ("score", "OTHER", "--metrics", "ms-ssim"),
        ("compare", "ours", "OTHER"),
        ("compare", "OTHER", "ours"),
        ("report", "ours", "OTHER"),
        ("merge", "OTHER", "--out", "whole"),
        (*RUN, "--out", "OTHER"),
        (*RUN, "--dry-run", "--out", "OTHER"),
        ("run", "--suite", "stability", "--methods", "splat", "--out", "OTHER"),
    ],
    ids=" ".join,
)
def test_each_command_refuses_it_in_one_line(
    command, runs, no_machine, monkeypatch, arguments, other
):
    monkeypatch.chdir(runs)
    before = tree(runs)
    status, out, err = command(*(part.replace("OTHER", other) for part in arguments))
    version, release = (
        (OLDER, "check out the release that made it")
        if other == "older"
        else (NEWER, "update pc2pix-bench")
    )
    assert (status, out) == (2, "")
    assert err == (
        f"bench: {other}: of protocol {version}, this version has protocol {PROTOCOL_VERSION} "
        f"('bench --protocol'); {release}, or run again with another --out or --fresh\n"
    )
    assert tree(runs) == before


def test_a_run_of_a_newer_protocol_is_not_compared_within_itself(refused, runs):
    said = refused("compare", runs / "newer", "--methods", "splat,blank")
    assert f"{runs / 'newer'}: of protocol {NEWER}" in said


@pytest.mark.parametrize("version", ["2", None, [1], 1.5])
def test_a_version_that_is_no_number_is_refused(command, tmp_path, version):
    run = with_protocol(write_run(tmp_path / "run"), version)
    assert command("table", run)[0] == 2
    assert command("compare", run, "--methods", "splat,blank")[0] == 2


def test_fresh_renames_it(tmp_path):
    run = with_protocol(write_run(tmp_path / "run"), OLDER)
    assert set_aside(run) == tmp_path / "run.old-1"
