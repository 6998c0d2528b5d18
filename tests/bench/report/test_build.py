"""The report of a run: its values are the tables', and whatever is in a run, it is only shown."""

from __future__ import annotations

import base64
import hashlib
import io
import json
import math
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from builders import make_failed, make_record, write_all, write_run
from PIL import Image
from report_parser import parse

from bench.records.artifacts import read_artifact
from bench.records.journal import read_manifest, write_manifest
from bench.records.parquet import read_records
from bench.records.record import GROUND_TRUTH
from bench.report.build import read_page, write_report
from bench.running.protocol import artifact_path
from bench.tables.build import make_outputs, read_scored, tables
from data_prep.failures import BadInput, CannotWrite
from data_prep.whole_files import write_whole

HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{ 7 * 7 }}"
BIDI = "name\u202ereversed"


def page_of(directory):
    return parse(write_report(make_outputs(read_scored(directory))).read_text(encoding="utf-8"))


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


def replace_records(directory, records):
    write_all(directory, records)


# --- the values -----------------------------------------------------------------------------------


def test_every_value_of_the_tables_is_in_the_page(tmp_path):
    directory = write_run(tmp_path, methods=["surface-apss", "splat", "true-mesh", "blank"])
    shown = number_tables(page_of(directory))
    checked = 0
    decimals = {"table3_ssim": 3, "table4_fid": 1, "table_detail": 3, "table_control": 2}
    for table in tables(read_scored(directory)):
        digits = decimals[table.name]
        for row in table.rows:
            better = "(higher is better)" if _higher(row.metric) else "(lower is better)"
            columns, lines = shown[f"{row.metric}, chair {better}"]
            cell = lines[row.method][columns.index(row.condition)]
            assert cell.attributes["data-condition"] == row.condition
            if math.isfinite(row.value):
                assert cell.attributes["data-value"] == f"{row.value:.6f}"
                value = cell.one("span", class_="value").text
                assert value == f"{row.value:.{digits}f}"
                low, high = (f"{v:.{digits}f}" for v in (row.ci_low, row.ci_high))
                assert cell.one("span", class_="beside").text == f"{low} to {high}"
            else:
                assert "data-value" not in cell.attributes
                assert cell.one("span", class_="value").text == "skipped"
            papers = [paper.text for paper in cell.all("span", class_="paper")]
            assert papers == ([f"paper {row.paper:g}"] if math.isfinite(row.paper) else [])
            checked += 1
    assert checked == 4 * 2 * (4 + 3 + 4 + 3)
    columns, lines = shown["ssim, chair (higher is better)"]
    papers = [cell.one("span", class_="paper").text for cell in lines["surface-apss"]]
    assert (columns, papers) == (["2048", "512"], ["paper 0.7", "paper 0.63"])  # Table 3, SR


def _higher(metric):
    return not metric.startswith(("fid", "fd-", "azimuth", "elevation"))


def test_costs_are_the_records_times(tmp_path):
    directory = write_run(tmp_path)
    times = {"a": (1.0, 0.5), "b": (2.0, 0.25), "c": (4.0, 0.125)}
    frame = read_records(directory)
    replace_records(
        directory,
        [
            make_record(
                row["method"],
                row["condition"],
                row["object"],
                row["view"],
                ssim=row["ssim"],
                prepare_s=times[row["object"]][0],
                draw_s=times[row["object"]][1],
            )
            for row in frame.to_dict("records")
        ],
    )
    ((_, lines),) = [
        table for caption, table in number_tables(page_of(directory)).items() if "Milli" in caption
    ]
    cell = lines["splat"][0]
    # With 2 views: 2000, 2500 and 4250 ms; the median of the sums, and medians of the parts.
    assert cell.attributes["data-value"] == "2500.000000"
    assert cell.one("span", class_="beside").text == "2000 + 250 × 2"
    assert cell.one("span", class_="mark").text == "frontier"  # nothing else competes


def test_head_counts_images(tmp_path):
    directory = write_run(tmp_path)
    failed = [make_failed("splat", "512", "b", view) for view in range(2)]
    kept = [
        make_record(*row[["method", "condition", "object", "view"]])
        for _, row in read_records(directory).iterrows()
        if tuple(row[["method", "condition", "object"]]) != ("splat", "512", "b")
    ]
    replace_records(directory, [*kept, *failed])
    description = [one.text for one in page_of(directory).one("p", class_="outcomes").all("span")]
    assert description == ["34 pictures ok", "2 pictures failed", "fid skipped"]
    facts = {d.one("dt").text: d.one("dd").text for d in page_of(directory).all("dl")[0].all("div")}
    assert facts["objects"] == "3 of class chair × 2 views"
    assert facts["finished"] == "2026-01-01 00:00:00 UTC"


def test_failures_are_listed_with_their_reasons(tmp_path):
    directory = write_run(tmp_path, methods=["splat", "surface-apss", "blank"])
    records = [
        make_record(*row[["method", "condition", "object", "view"]])
        for _, row in read_records(directory).iterrows()
    ]
    reasons = {"a": "timeout: 3 s", "b": "ball-pivoting: no faces", "c": "timeout: 3 s"}
    records = [
        make_failed(r.method, r.condition, r.object, r.view, reason=reasons[r.object])
        if (r.method, r.condition) == ("surface-apss", "512")
        else r
        for r in records
    ]
    replace_records(directory, records)
    document = page_of(directory)
    section = document.one("section", id="failures")
    groups = {
        d.one("h3").text: (d.one("summary").one("span").text, [i.text for i in d.all("li")])
        for d in section.all("details")
    }
    assert groups == {
        "timeout: 3 s": (
            "4 pictures of 2 clouds",
            [f"surface-apss/512/chair/{o} views 0 to 1" for o in "ac"],
        ),
        "ball-pivoting: no faces": (
            "2 pictures of 1 clouds",
            ["surface-apss/512/chair/b views 0 to 1"],
        ),
    }
    assert next(iter(groups)) == "timeout: 3 s"  # the most frequent first
    _, lines = number_tables(document)["ssim, chair (higher is better)"]
    gap = lines["surface-apss"][1].one("span", class_="gap").text
    assert gap == "0 of 6 pictures; 0.500 with blank ones for the others"
    line = next(
        tr for tr in document.all("tr") if tr.attributes.get("data-method") == "surface-apss"
    )
    assert line.attributes["data-outcome"] == "failed ok"


# --- one file, harmless ---------------------------------------------------------------------------


def test_the_page_loads_nothing(finished, tmp_path):
    path = write_report(make_outputs(read_scored(finished[0])), tmp_path / "report.html")
    document = parse(path.read_text(encoding="utf-8"))
    for element in document.all():
        for name, value in element.attributes.items():
            if name in ("src", "href", "srcset", "xlink:href", "action", "data", "poster"):
                assert value.startswith(("data:", "#")), (element.tag, name, value[:80])
            assert name != "style"
            assert not name.startswith("on")
    style, script = document.one("style"), document.one("script")
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
        make_record(*row[["method", "condition", "object", "view"]], notes=HOSTILE)
        for _, row in read_records(directory).iterrows()
    ]
    replace_records(
        directory,
        [
            *(r for r in records if (r.method, r.object) != ("splat", BIDI)),
            *(
                make_failed("splat", c, BIDI, v, reason=HOSTILE)
                for c in ("2048", "512")
                for v in (0, 1)
            ),
        ],
    )
    text = write_report(make_outputs(read_scored(directory))).read_text(encoding="utf-8")
    document = parse(text)
    assert len(document.all("script")) == 1
    assert not [img for img in document.all("img") if img.attributes["src"] == "x"]
    assert not [e for e in document.all() if any(a.startswith("on") for a in e.attributes)]
    reason = document.one("section", id="failures").all("h3")[0].text
    assert reason.startswith("<script>alert(1)")
    cases = [p.text for p in document.all("p", class_="case-name")]
    assert any(HOSTILE in name for name in cases)
    assert "{{ 7 * 7 }}" in text
    assert "\u202e" not in text
    assert "name\\u202ereversed" in text


def test_the_same_run_gives_the_same_bytes(finished, tmp_path):
    first = write_report(make_outputs(read_scored(finished[0])), tmp_path / "a.html").read_bytes()
    elsewhere = shutil.copytree(finished[0], tmp_path / "elsewhere")
    assert write_report(make_outputs(read_scored(elsewhere))).read_bytes() == first
    assert (elsewhere / "report.html").is_file()


# --- pictures -------------------------------------------------------------------------------------


def _journal(directory):
    (shard,) = (directory / "journal").iterdir()
    return [json.loads(line.split(" ", 1)[1]) for line in shard.read_text().splitlines()]


def _entry(directory, method, condition, obj):
    for values in _journal(directory):
        first = values["records"][0]
        if (first["method"], first["condition"], first["object"]) == (method, condition, obj):
            return values
    raise AssertionError


def _write_line(path, values):
    body = json.dumps(values, ensure_ascii=False)
    path.write_text(f"{hashlib.sha256(body.encode()).hexdigest()} {body}\n", encoding="utf-8")


def _grid_images(directory, index=0):
    """Of the grid of an object: {condition: {column: picture or None}}."""
    grid = parse((directory / "report.html").read_text(encoding="utf-8")).all(
        "table", class_="pictures"
    )[index]
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
    write_report(make_outputs(read_scored(copied)))
    shown = _grid_images(copied, index=1)
    network = next(m for m in read_manifest(copied)["methods"] if m.startswith("pc2pix@"))
    assert list(shown) == ["2048", "noise-0.10"]
    for condition, by_column in shown.items():
        assert list(by_column) == ["cloud", "truth", "splat", network]
        for column, image in by_column.items():
            if column == "cloud":
                continue
            cell = (GROUND_TRUTH, "") if column == "truth" else (column, condition)
            key = _entry(copied, *cell, "test-0001")["key"]
            expected = read_artifact(artifact_path(copied, key))["images"][0]
            np.testing.assert_array_equal(image, expected)
    clean, noisy = (shown[c]["cloud"] < 255 for c in ("2048", "noise-0.10"))
    assert 0.02 < clean.mean() < 0.2
    assert (clean & ~noisy).sum() > 0.3 * clean.sum()  # noise has moved the points


def test_a_run_that_was_stopped_and_changed_shows_what_its_records_measured(copied):
    """A later start under another key, whose records are not those of the run, does not count."""
    entry = _entry(copied, "splat", "2048", "test-0000")
    kept = read_artifact(artifact_path(copied, entry["key"]))["images"]
    for number, factor in ((2, 2.0), (3, 3.0)):
        other = f"{number}" * 64
        buffer = io.BytesIO()
        np.savez_compressed(buffer, images=255 - kept)
        write_whole(artifact_path(copied, other), buffer.getvalue())
        later = [r | {"prepare_s": factor * r["prepare_s"]} for r in entry["records"]]
        line = {"key": other, "artifact_sha256": "0" * 64, "records": later}
        _write_line(copied / "journal" / f"{number:04d}.jsonl", line)
    write_report(make_outputs(read_scored(copied)))
    np.testing.assert_array_equal(_grid_images(copied)["2048"]["splat"], kept[0])


def test_missing_images_are_named_and_the_rest_is_there(copied):
    shutil.rmtree(copied / "artifacts")
    document = page_of(copied)
    warnings = [p.text for p in document.all("p", class_="warning")]
    assert warnings == [
        "The pictures of this run are no longer there (its folder artifacts is empty or gone); "
        "its command makes them again."
    ]
    description = {i.attributes["alt"] for i in document.all("img")}
    assert all(alt.startswith("the cloud") for alt in description)  # these are made again
    lacking = [e.attributes["aria-label"] for e in document.all("span", class_="lacking")]
    assert "the truth, chair test-0000; the picture is no longer there" in lacking
    assert number_tables(document)["ssim, chair (higher is better)"][1]["splat"]


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04" + bytes(40)])
def test_an_unreadable_image_is_a_missing_one(copied, content):
    path = artifact_path(copied, _entry(copied, "splat", "2048", "test-0000")["key"])
    path.write_bytes(content)
    write_report(make_outputs(read_scored(copied)))
    shown = _grid_images(copied)
    assert shown["2048"]["splat"] is None
    assert shown["noise-0.10"]["splat"] is not None


def test_clouds_of_a_dataset_that_has_gone_are_named_as_missing(copied, tmp_path):
    manifest = read_manifest(copied)
    write_manifest(copied, manifest | {"dataset": f"folder:{tmp_path / 'gone'}"})
    document = page_of(copied)
    (description,) = (p.text for p in document.all("p", class_="warning"))
    assert description.startswith("The clouds cannot be made again: ")
    assert "gone" in description
    images = [i.attributes["alt"] for i in document.all("img")]
    assert images
    assert not any(alt.startswith("the cloud") for alt in images)


# --- the command ----------------------------------------------------------------------------------


def test_the_command_prints_where_the_report_is(finished, tmp_path, command):
    status, out, _ = command("report", finished[0], "--out", tmp_path / "mine.html")
    assert (status, out) == (0, f"{tmp_path / 'mine.html'}\n")
    assert (tmp_path / "mine.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.parametrize("suite", ["latent", "stability", "speed"])
def test_runs_that_write_their_own_tables_are_refused_by_name(tmp_path, suite):
    write_run(tmp_path)
    write_manifest(tmp_path, read_manifest(tmp_path) | {"suite": suite})
    with pytest.raises(BadInput, match=f"a run of {suite} writes its tables itself"):
        write_report(make_outputs(read_scored(tmp_path)))
    assert not (tmp_path / "report.html").exists()


def test_an_unfinished_run_is_refused(tmp_path):
    write_run(tmp_path, finished=None)
    with pytest.raises(BadInput, match="not finished"):
        write_report(make_outputs(read_scored(tmp_path)))


def test_a_place_that_cannot_be_written_is_reported(tmp_path):
    directory = write_run(tmp_path / "run")
    (tmp_path / "file").write_text("")
    with pytest.raises(CannotWrite, match=r"file/r\.html: cannot be written .*another --out"):
        write_report(make_outputs(read_scored(directory)), tmp_path / "file" / "r.html")


def test_what_a_run_was_started_with_can_be_typed_again(tmp_path):
    words = ["some/folder/bench", "run", "--suite", "chair-robustness", "--out", "my run"]
    directory = write_run(tmp_path, command=words)
    page, again = (read_page(make_outputs(read_scored(directory))) for _ in range(2))
    assert page.command == "bench run --suite chair-robustness --out 'my run'"
    assert replace(page, command="") == replace(again, command="")
