"""The report of a run: its values are the tables', and whatever is in a run, it is only shown."""

from __future__ import annotations

import base64
import hashlib
import io
import math
import re
import shutil
import sqlite3
import zlib
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from builders import (
    damage_images,
    make_failed,
    make_manifest,
    read_all,
    rows_of,
    write_all,
    write_run,
)
from PIL import Image
from report_parser import parse

from bench.analysis.digits import decimals
from bench.analysis.run import read_run
from bench.catalogue.metrics import CONTROL_METRICS, higher_is_better
from bench.commands.run import print_ending
from bench.records.folder import open_folder, read_manifest, write_manifest
from bench.records.job import GROUND_TRUTH, pack
from bench.records.store import STORE
from bench.report.build import write_report
from bench.running.run import RunResult
from bench.tables.build import make_outputs
from bench.tables.grid import number_text as as_shown
from data_prep.failures import BadInput, CannotWrite

HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{ 7 * 7 }}"
BIDI = "name\u202ereversed"


def report_of(directory):
    """The text of its report."""
    return write_report(make_outputs(read_run(directory))).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def of_random_values(tmp_path_factory):
    """What is made of a run with random values, in which three clouds have failed."""
    directory = write_run(
        tmp_path_factory.mktemp("random") / "run",
        methods=["surface-apss", "splat", "true-mesh", "blank"],
        objects=[f"chair/{name}" for name in "abcd"],
        command=["some/folder/bench", "run", "--suite", "chair-robustness", "--out", "my run"],
        added=[["some/folder/bench", "add", "my_method:METHOD", "my run"]],
    )
    reasons = {
        ("surface-apss", "b"): "timeout: 3 s",
        ("splat", "b"): "timeout: 3 s",
        ("surface-apss", "c"): "ball-pivoting: no faces",
    }
    times = {"a": (1.0, 0.5), "b": (1.5, 0.375), "c": (2.0, 0.25), "d": (4.0, 0.125)}
    records = []
    for record in read_all(directory):
        prepare_s, draw_s = times[record.object]
        made = replace(record, prepare_s=prepare_s, draw_s=draw_s)
        reason = reasons.get((record.method, record.object))
        if reason and record.condition == "512":
            made = make_failed(record.method, "512", record.object, record.view, reason)
        records.append(made)
    write_all(directory, records)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bench.analysis.intervals.FEWEST", 2)  # of four objects
        return make_outputs(read_run(directory))


@pytest.fixture(scope="module")
def document(of_random_values):
    return parse(write_report(of_random_values).read_text(encoding="utf-8"))


def number_tables(document):
    """Caption: (names of columns, {name of line: cells})."""
    found = {}
    for table in document.all("table", class_="numbers"):
        columns = [head.text for head in table.one("thead").all("th")[1:]]
        lines = {
            line.one("th").one("span", class_="name").text: line.all("td")
            for line in table.one("tbody").all("tr")
        }
        found[table.one("caption").text] = columns, lines
    return found


def image_of(uri):
    kind, _, data = uri.partition(",")
    assert kind == "data:image/webp;base64"
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        return np.asarray(image.convert("RGB"))


def test_the_first_screen_and_the_terminal_say_what_is_not_measured(
    of_random_values, document, capsys
):
    line = "fid: not measured, not here"
    said = {entry.one("dt").text: entry for entry in document.one("dl", class_="answer").all("div")}
    assert said["Not measured"].one("dd").text == line
    of_run = of_random_values.run.directory, of_random_values
    counts = {"objects": 4, "planned": 4, "done": 1, "reused": 0, "failed": 0}
    print_ending(
        RunResult(*of_run, **counts, interrupted=False, hopeless=(), seconds={}, shares={})
    )
    assert f"\nbench: {line}\n" in capsys.readouterr().err


def test_every_value_of_the_tables_is_in_the_page(of_random_values, document):
    shown = number_tables(document)
    rows = rows_of(*of_random_values.tables)
    # four methods and best-classical
    assert len(rows) == 5 * 2 * (4 + 6 + 6 + 3)
    for row in rows:
        two, one = row.metric in ("psnr", *CONTROL_METRICS), row.metric.startswith("fd-")
        # Fewer of some methods (results/decimals.csv).
        every = 2 if two else 1 if one else 3
        digits = min(every, decimals(row.metric, row.images_of))
        mark = "≈" * (digits < every)
        better = "(higher is better)" if higher_is_better(row.metric) else "(lower is better)"
        columns, lines = shown[f"{row.metric}, chair {better}"]
        cell = lines[row.method][columns.index(row.condition)]
        expected = {"value": ["skipped"], "beside": [], "gap": []}
        if math.isfinite(row.value):
            assert cell.attributes["data-value"] == f"{row.value:.6f}"
            numbers = (row.value, row.ci_low, row.ci_high, row.failures_as_blank)
            value, low, high, blank = (as_shown(number, digits) for number in numbers)
            gap = f"{row.n_ok} of 8 images; {blank} with blank ones for the others"
            interval = f"{low} to {high}†" if row.n_ok < row.n else f"{low} to {high}"
            expected = {"value": [mark + value], "beside": [interval] * (low != "-")}
            expected["gap"] = [gap] if row.n_ok < row.n else []
        else:
            assert "data-value" not in cell.attributes
        expected["paper"] = [f"paper {row.paper:g}"] if math.isfinite(row.paper) else []
        for name, texts in expected.items():
            assert [span.text for span in cell.all("span", class_=name)] == texts
    columns, lines = shown["ssim, chair (higher is better)"]
    papers = [cell.one("span", class_="paper").text for cell in lines["surface-apss"]]
    assert (columns, papers) == (["2048", "512"], ["paper 0.7", "paper 0.63"])  # Table 3, SR


def test_the_commands_of_the_run_are_shown(document):
    shown = [command.text for command in document.all("pre", class_="command")]
    assert shown[0] == "bench run --suite chair-robustness --out 'my run'"
    assert shown[1:] == ["bench add my_method:METHOD 'my run'"]


def test_failures_are_listed_with_their_reasons(document):
    groups = [
        (d.one("h3").text, d.one("summary").one("span").text, [i.text for i in d.all("li")])
        for d in document.one("section", id="failures").all("details")
    ]
    apss, splat = (f"{method}/512/chair" for method in ("surface-apss", "splat"))
    of_b = [f"{apss}/b views 0 to 1", f"{splat}/b views 0 to 1"]
    assert groups == [
        ("timeout: 3 s", "4 images of 2 clouds", of_b),  # the most frequent first
        ("ball-pivoting: no faces", "2 images of 1 clouds", [f"{apss}/c views 0 to 1"]),
    ]


def test_the_page_of_the_command_loads_nothing(finished, tmp_path, command):
    path = tmp_path / "mine.html"
    status, out, _ = command("report", finished[0], "--out", path)
    assert (status, out) == (0, f"{path}\n")
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    document = parse(path.read_text(encoding="utf-8"))
    for element in document.all():
        for name, value in element.attributes.items():
            if name in ("src", "href", "srcset", "xlink:href", "action", "data", "poster"):
                assert value.startswith(("data:", "#")), (element.tag, name, value[:80])
            assert name != "style"
            assert not name.startswith("on")
    style, script = document.one("style"), document.all("script")[1]
    assert not re.search(r"@import|url\(", style.children[0])
    policy = next(
        m.attributes["content"] for m in document.all("meta") if "http-equiv" in m.attributes
    )
    hashes = [
        base64.b64encode(hashlib.sha256(e.children[0].encode()).digest()).decode()
        for e in (style, script)
    ]
    assert policy == (
        f"default-src 'none'; img-src data:; style-src 'sha256-{hashes[0]}'; "
        f"script-src 'sha256-{hashes[1]}'; base-uri 'none'; form-action 'none'"
    )
    anchors = {a.attributes["href"][1:] for a in document.all("a")}
    ids = [e.attributes["id"] for e in document.all() if "id" in e.attributes]
    assert anchors <= set(ids)
    assert len(ids) == len(set(ids))
    labels = [e.attributes.get("aria-labelledby", "").split() for e in document.all()]
    assert {name for names in labels for name in names} <= set(ids)


def test_names_and_reasons_are_only_shown(tmp_path):
    names = [HOSTILE, BIDI, "../../etc/passwd"]
    directory = write_run(tmp_path, objects=[f"chair/{name}" for name in names])
    records = [
        make_failed("splat", record.condition, BIDI, record.view, reason=HOSTILE)
        if (record.method, record.object) == ("splat", BIDI)
        else replace(record, notes=HOSTILE)
        for record in read_all(directory)
    ]
    write_all(directory, records)
    text = report_of(directory)
    document = parse(text)
    assert len(document.all("script")) == 2  # the data of the viewer, and the page's own
    assert not [img for img in document.all("img") if img.attributes["src"] == "x"]
    assert not [e for e in document.all() if any(a.startswith("on") for a in e.attributes)]
    reason = document.one("section", id="failures").all("h3")[0].text
    assert reason.startswith("<script>alert(1)")
    cases = [p.text for p in document.all("p", class_="case-name")]
    assert any(HOSTILE in name for name in cases)
    assert "{{ 7 * 7 }}" in text
    assert "\u202e" not in text
    assert "name\\u202ereversed" in text


@pytest.mark.slow
def test_the_same_run_gives_the_same_bytes(finished, tmp_path):
    first = write_report(make_outputs(read_run(finished[0])), tmp_path / "a.html").read_bytes()
    elsewhere = shutil.copytree(finished[0], tmp_path / "elsewhere")
    assert write_report(make_outputs(read_run(elsewhere))).read_bytes() == first
    assert (elsewhere / "report.html").is_file()


def _stored(directory, *job):
    """Return key and images of a method, condition and object, past the code of the store."""
    query = (
        "SELECT key, data FROM listed JOIN job USING (key) JOIN blob ON blob.job = job.id "
        "WHERE method = ? AND condition = ? AND object = ? AND name = 'images'"
    )
    with closing(sqlite3.connect(directory / STORE)) as connection:
        ((key, data),) = connection.execute(query, job)
    return key, np.load(io.BytesIO(zlib.decompress(data)))


def _grid_images(text, index=0):
    """Of the grid of an object in a report: {condition: {column: image or None}}."""
    grid = parse(text).all("table", class_="images")[index]
    columns = [head.text for head in grid.one("thead").all("th")[1:]]
    found = {}
    for row in grid.one("tbody").all("tr"):
        images = [cell.all("img") for cell in row.all("td")]
        found[row.one("th").text] = {
            column: image_of(image[0].attributes["src"]) if image else None
            for column, image in zip(columns, images, strict=True)
        }
    return found


def test_images_are_those_of_the_run_to_the_last_bit(copied):
    shown = _grid_images(report_of(copied), index=1)
    network = next(m for m in read_manifest(copied)["methods"] if m.startswith("pc2pix@"))
    assert list(shown) == ["2048", "noise-0.10"]
    for condition, by_column in shown.items():
        assert list(by_column) == ["cloud", "truth", "splat", network]
        for column, image in by_column.items():
            if column == "cloud":
                continue
            cell = (GROUND_TRUTH, "") if column == "truth" else (column, condition)
            _, expected = _stored(copied, *cell, "test-0001")
            np.testing.assert_array_equal(image, expected[0])
    clean, noisy = (shown[c]["cloud"] < 255 for c in ("2048", "noise-0.10"))
    assert 0.02 < clean.mean() < 0.2
    assert (clean & ~noisy).sum() > 0.3 * clean.sum()  # noise has moved the points


def test_a_run_that_was_stopped_and_changed_shows_what_its_records_measured(copied):
    """A later start under another key, whose records are not those of the run, does not count."""
    key, kept = _stored(copied, "splat", "2048", "test-0000")
    with open_folder(copied) as store:
        was = store.result(key)
        for number in (2, 3):
            later = replace(was, key=f"{number}" * 64, prepare_s=number * was.prepare_s)
            store.append(replace(later, arrays={"images": pack(255 - kept)}))
    np.testing.assert_array_equal(_grid_images(report_of(copied))["2048"]["splat"], kept[0])


def test_missing_images_are_named_and_the_rest_is_there(copied):
    damage_images(copied)
    document = parse(report_of(copied))
    images = {i.attributes["alt"] for i in document.all("img")}
    assert all(alt.startswith("the cloud") for alt in images)  # these are made again
    lacking = [e.attributes["aria-label"] for e in document.all("span", class_="lacking")]
    assert "the truth, chair test-0000; the image is no longer there" in lacking
    assert number_tables(document)["ssim, chair (higher is better)"][1]["splat"]


def test_clouds_of_a_dataset_that_has_gone_are_named_as_missing(copied, tmp_path):
    manifest = read_manifest(copied)
    write_manifest(copied, manifest | {"dataset": f"folder:{tmp_path / 'gone'}"})
    document = parse(report_of(copied))
    (description,) = (p.text for p in document.all("p", class_="warning"))
    assert description.startswith("The clouds cannot be made again: ")
    assert "gone" in description
    images = [i.attributes["alt"] for i in document.all("img")]
    assert images
    assert not any(alt.startswith("the cloud") for alt in images)


def test_runs_that_write_their_own_tables_are_refused_by_name(tmp_path):
    for suite in ("latent", "stability", "speed"):
        write_manifest(tmp_path, make_manifest(suite=suite))
        with pytest.raises(BadInput, match=f"a run of {suite} writes its tables itself"):
            read_run(tmp_path)


def test_a_place_that_cannot_be_written_is_reported(of_random_values, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CannotWrite, match=r"file/r\.html: cannot be written .*another --out"):
        write_report(of_random_values, tmp_path / "file" / "r.html")
