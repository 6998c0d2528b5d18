"""`bench site` over runs with failures, with other weights of one id, of any name, and copies."""

from __future__ import annotations

import re
import shutil
from html import unescape
from pathlib import Path

import pandas as pd
import pytest
from builders import make_failed, make_record, read_all, write_all, write_run

from bench.analysis.scored import scored_run
from bench.records.run_folder import read_manifest
from bench.report.site.methods import LONGEST, method_slug, site_methods
from bench.report.site.write import write_site
from bench.tables.build import write_outputs

OBJECTS = [f"chair/{i:02d}" for i in range(12)]
METHODS = ["splat", "splat-net", "surface-bpa", "blank"]
SMALL = {"objects": OBJECTS, "methods": METHODS, "conditions": ["2048", "512"]}
REASON = "memory: 2 GiB"
ONE, OTHER = "1" * 64, "2" * 64


def drawn_with(weights, scipy):
    """Return the entries of a manifest about weights and libraries."""
    stated = {"splat-net": [2, f"scipy {scipy}, weights {weights}", "cpu"]}
    stated |= {"splat": [1, f"scipy {scipy}", "cpu"]}
    identities = {method: stated.get(method, [1, "", "cpu"]) for method in METHODS}
    return {"identities": identities, "versions": {"scipy": scipy}}


def write_small(directory: Path, **changes) -> Path:
    """A run with a report, which a site copies instead of making one."""
    write_run(directory, **(SMALL | changes))
    (directory / "report.html").write_text("<p>report</p>")
    return directory


def text(path: Path) -> str:
    body = path.read_text("utf-8").partition("<body>")[2].partition("<script>")[0]
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Run "a", of which 18 of 24 images of a cell failed, and "b", with other weights."""
    root = tmp_path_factory.mktemp("failed")
    a = write_small(root / "a", **drawn_with(ONE, "1.17.1"))
    records = [
        make_failed(r.method, r.condition, r.object, r.view, reason=REASON)
        if (r.method, r.condition) == ("surface-bpa", "512") and int(r.object) < 9
        else r
        for r in read_all(a)
    ]
    write_all(a, records)
    write_outputs(scored_run(a, read_manifest(a)))
    b = write_small(root / "b", **drawn_with(OTHER, "1.18.0"))
    write_site([a, b], root / "site")
    return root / "site"


def test_failures_are_shown_where_the_values_are(site):
    scored = r"surface-bpa ≈?0\.\d{2,3} .*?6 of 24 images, the others scored as blank"
    assert len(re.findall(scored, text(site / "run-a.html"))) == 2  # metrics
    assert "6 of 24 images" not in text(site / "run-b.html")
    pairs = [path for path in site.glob("compare-*--*.html") if "bpa" in path.name]
    assert pairs
    for path in pairs:
        of_a = text(path).count("surface-bpa: 6 of 24 images, the others scored as blank")
        assert of_a == (0 if "2222222" in path.name else 2), path.name
    assert text(site / "method-surface-bpa.html").count("6 of 24 images, the others") == 2
    assert "of 6 of 24 images" in text(site / "cost.html")


def test_failures_are_counted_and_their_reasons_named(site):
    images = len(OBJECTS) * 2 * len(METHODS) * 2
    index = text(site / "index.html")
    assert f"failed 18 of {2 * images} images" in index  # of both runs
    assert f"failed 18 of {images} images" in index
    assert f"surface-bpa: 18 × {REASON}" in index
    assert index.count("18 of 48 failed") == 2  # metrics
    of_run = text(site / "run-a.html")
    assert f"failed 18 of {images} images" in of_run
    assert "Failed images method 2,048 points 512 of 2,048 points surface-bpa - 18 of 24" in of_run
    assert f"surface-bpa: 18 × {REASON}" in of_run
    assert f"failed 0 of {images} images" in text(site / "run-b.html")
    assert "Failures" not in text(site / "run-b.html")
    assert "failed 18 of 96 images" in text(site / "method-surface-bpa.html")


def test_the_csv_has_the_values_of_the_page_under_the_same_name_as_the_tables(site):
    ranks = pd.read_csv(site / "a-ranks.csv", dtype={"condition": str})
    table = pd.read_csv(site / "a-table_detail.csv", dtype={"condition": str})
    both = ranks.merge(table, on=["metric", "condition", "class", "method"])
    assert set(both["metric"]) == {"ssim-object", "lpips"}
    assert len(both) == len(METHODS) * 2 * 2
    assert (both["failures_as_blank_x"] - both["failures_as_blank_y"]).abs().max() < 2e-6
    assert (both["n_ok_x"] == both["n_ok_y"]).all()
    failed = both[(both["method"] == "surface-bpa") & (both["condition"] == "512")].iloc[0]
    assert abs(failed["failures_as_blank_x"] - failed["value"]) > 0.001
    shown = text(site / "run-a.html").partition("lpips, lower")[0]
    value = r"0\.\d{2,3}"  # with the digits that survive rounding
    on_page = re.search(rf"surface-bpa .*?({value}) [^.]*?{value} to {value} 6 of 24", shown)
    assert on_page is not None
    assert on_page[1] == f"{failed['failures_as_blank_x']:.{len(on_page[1]) - 2}f}"
    assert "as in the column “failures_as_blank” of the CSV files" in shown


def test_other_weights_of_an_id_are_another_method(site):
    names = ["splat-net (weights 1111111)", "splat-net (weights 2222222)"]
    overview, matrix = text(site / "index.html"), text(site / "compare.html")
    for name, run in zip(names, ("a", "b"), strict=True):
        assert name in overview
        assert name in matrix
        assert name in text(site / f"run-{run}.html")
        assert name in text(site / "cost.html")
        (page,) = site.glob(f"method-splat-net-weights-{name[-8]}*.html")
        assert f"runs 1 failed 0 of 48 images identity version 2, weights {name[-8] * 64}" in (
            text(page)
        )
        assert "Model card" not in text(page)  # of the installed weights
        assert "not those installed" in text(page)
    assert not (site / "method-splat-net.html").exists()
    splat = text(site / "method-splat.html")  # one method with two versions of a library
    assert "runs 2 " in splat
    assert splat.count("scipy 1.17.1") == splat.count("scipy 1.18.0") == 2  # metrics
    both = [p.name for p in site.glob("compare-*--*.html") if p.name.count("splat-net") == 2]
    assert both == []  # no run has both


def test_methods_are_told_apart_by_what_differs():
    def names(*stated, **changes):
        manifests = [
            {"methods": ["m"], "identities": {"m": of} if of else {}, "versions": {"torch": "2.1"}}
            for of in stated
        ]
        return [methods["m"].name for methods in site_methods(manifests)]

    assert names([1, "", "cpu"], [1, "", "cuda"]) == ["m", "m"]
    assert names([1, "torch 2.1, weights x", "cpu"], [1, "weights x", "cpu"]) == ["m", "m"]
    assert names([1, "", "cpu"], [2, "", "cpu"]) == ["m (version 1)", "m (version 2)"]
    assert names([1, "1.4", "cpu"], [1, "1.5", "cpu"]) == ["m (1.4)", "m (1.5)"]
    assert names(None, None) == ["m", "m"]
    assert names(None, [1, "", "cpu"]) == ["m (identity unknown)", "m (version 1)"]
    long = names([1, f"weights {'a' * 64}", "cpu"], [1, f"weights {'a' * 63}b", "cpu"])
    assert len(set(long)) == 2  # although they begin alike
    part = names([1, "x", "cpu"], [1, "x, y", "cpu"])
    assert part[1] == "m (y)"
    assert re.fullmatch(r"m \([0-9a-f]{7}\)", part[0])


def test_no_two_methods_share_a_file():
    names = ["a@b", "a_b", "a@/x/y.safetensors", "a@/x-y.safetensors", "a (v)", "a-v", "a" * 300]
    names += ["a" * 301, "网络", "模型"]
    slugs = [method_slug(name) for name in names]
    assert len({slug.casefold() for slug in slugs}) == len(names)
    assert max(len(slug.encode()) for slug in slugs) <= LONGEST + 8
    assert method_slug("pc2pix@all") == "pc2pix_all"


def test_a_copied_run_is_counted_once(tmp_path, command):
    few = {"objects": OBJECTS[:2], "methods": ["splat", "blank"], "conditions": ["2048"]}
    run = write_small(tmp_path / "run", **few)
    copy = shutil.copytree(run, tmp_path / "copy")
    other = write_small(tmp_path / "other", **few)
    write_all(other, [make_record(r.method, r.condition, r.object, r.view) for r in read_all(run)])
    status, _, err = command("site", run, copy, other, "--out", tmp_path / "site")
    assert status == 0
    assert f"{copy}: the same records as {run}; the run is counted once\n" in err
    overview = text(tmp_path / "site" / "index.html")
    assert "runs 2 " in overview
    assert "copy has the same records; it is not counted again" in overview
    assert {path.name for path in (tmp_path / "site").glob("run-*.html")} == {
        "run-run.html",
        "run-other.html",
    }


NAMES = {
    "中文": "中文",
    "日本": "日本",
    "e\u0301te\u0301": "été",
    "हिन्दी": "हिन्दी",
    "a b": "a-b",
    "a-b": "a-b-2",
    "A": "A",
    "a": "a-2",
    "☂": "run",
    "☃": "run-2",
    "run": "run-3",
    "report": "report",
    "x" * 240: "x" * LONGEST,
}


def test_runs_of_any_name_have_pages_of_their_own(tmp_path):
    runs = []
    for i, name in enumerate(NAMES):
        few = {"objects": [f"chair/{i}"], "methods": ["blank"], "conditions": ["2048"]}
        runs.append(write_small(tmp_path / name, **few))
    write_site(runs, tmp_path / "site")
    pages = {path.name for path in (tmp_path / "site").glob("run-*.html")}
    assert pages == {f"run-{slug}.html" for slug in NAMES.values()}
    for name, slug in NAMES.items():
        title = "a-2" if name == "a" else name  # "A" came before
        assert f" {title} " in text(tmp_path / "site" / f"run-{slug}.html")
        assert (tmp_path / "site" / f"{slug}-ranks.csv").is_file()
