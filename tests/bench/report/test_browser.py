"""The report as a browser shows it, offline: images, filters, keyboard, accessibility.

Skipped where there is no Chromium; `make test` installs it where it may.
"""

from __future__ import annotations

import re
import shutil

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from builders import make_failed, read_all, write_all, write_run
from playwright.sync_api import sync_playwright

from bench.analysis.run import read_run
from bench.report.build import write_report
from bench.report.site import write_site
from bench.tables.build import make_outputs

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium"),
    pytest.mark.slow,
]

FLAGS = (  # WebGL is drawn by the processor
    *("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
)
WIDE, PHONE = {"width": 1280, "height": 900}, {"width": 360, "height": 740}
FAILED_REASON = "ball-pivoting: no faces"


@pytest.fixture(scope="module")
def report(finished, tmp_path_factory):
    """The report of a real run in which one item has failed."""
    directory = shutil.copytree(finished[0], tmp_path_factory.mktemp("browser") / "run")
    item = ("splat", "noise-0.10", "test-0001")
    records = [
        make_failed(*item, record.view, reason=FAILED_REASON)
        if (record.method, record.condition, record.object) == item
        else record
        for record in read_all(directory)
    ]
    write_all(directory, records)
    return write_report(make_outputs(read_run(directory)))


@pytest.fixture(scope="module")
def index(tmp_path_factory):
    """The site of two runs of random scores, with failures, and of one of another data set."""
    root = tmp_path_factory.mktemp("browser-index")
    methods, objects = ["pc2pix", "splat", "blank"], [f"chair/{i:02d}" for i in range(9)]
    run = write_run(root / "run", methods=methods, objects=objects)
    write_all(run, [_failed(r) if r.method == "splat" else r for r in read_all(run)])
    other = write_run(root / "ラン", methods=methods, objects=objects, seed=1)
    apart = write_run(root / "apart", methods=methods, objects=objects, dataset="folder:/meshes")
    return write_site([run, other, apart], root / "site")


def _failed(record):
    return make_failed(record.method, record.condition, record.object, record.view)


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=[*FLAGS])
        yield started
        started.close()


@pytest.fixture
def open_page(browser, report):
    """Opens the report in a context of its own; fails where anything was complained of."""
    contexts, complaints, requests = [], [], []

    def open_it(path=report, **stated):
        context = browser.new_context(**({"viewport": WIDE, "offline": True} | stated))
        contexts.append(context)
        page = context.new_page()
        # The driver's remarks on its speed are no complaint.
        page.on("console", lambda m: "GL Driver" in m.text or complaints.append(m.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        return page

    yield open_it
    for context in contexts:
        context.close()
    assert complaints == []
    assert {url.partition(":")[0] for url in requests} <= {"file", "data"}


def test_all_images_are_there(open_page):
    page = open_page()
    page.wait_for_load_state("load")
    widths = page.evaluate(
        "Promise.all([...document.images].filter(i => i.src)"
        ".map(i => i.decode().then(() => i.naturalWidth)))"
    )
    assert len(widths) > 50
    assert set(widths) == {128}


def test_rows_are_hidden_by_a_field(open_page):
    page = open_page()
    rows = page.locator(".compact tbody tr:visible")
    assert rows.count() == 4
    page.get_by_label("Rows of tables that contain").fill(" SPLAT")
    assert [text.split()[0] for text in rows.all_inner_texts()] == ["splat"]
    status = page.locator(".filter [role=status]").inner_text()
    assert re.fullmatch(r"\d+ of \d+ rows", status)
    page.get_by_label("Rows of tables that contain").fill("")
    assert rows.count() == 4
    assert page.locator(".filter [role=status]").inner_text() == ""


def test_tables_are_sorted_by_value(open_page):
    page = open_page()
    table = page.locator("table.numbers").first  # the headline
    head = table.get_by_role("button", name="2,048").first
    values = "cells => cells.map(cell => Number(cell.dataset.value))"
    cells = table.locator("tbody td:nth-child(2)")
    before = cells.evaluate_all(values)
    head.click()
    assert cells.evaluate_all(values) == sorted(before, reverse=True)  # the best first
    assert table.locator("th[aria-sort=descending]").count() == 1
    head.click()
    assert cells.evaluate_all(values) == sorted(before)
    table.get_by_role("button", name="method").click()
    names = table.locator("tbody th .name").all_inner_texts()
    assert names == sorted(names)
    assert table.locator("[aria-sort]").count() == 1


def tab_into(page, selector):
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate(f"document.activeElement.closest('{selector}') !== null"):
            return


def test_everything_can_be_reached_by_keyboard(open_page):
    page = open_page()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    assert page.locator(".skip").bounding_box()["x"] >= 0  # seen while it has the focus
    tab_into(page, ".filter")
    page.keyboard.type("splat")
    assert page.locator(".compact tbody tr:visible").count() == 1
    tab_into(page, "th[data-column]")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    assert page.locator("th[aria-sort=descending]").count() == 1
    outline = "getComputedStyle(document.activeElement).outlineStyle"
    assert page.evaluate(outline) == "solid"


@pytest.mark.parametrize("written", ["report", "index", "method"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("viewport", [WIDE, PHONE], ids=["wide", "phone"])
def test_axe_finds_nothing(open_page, request, written, scheme, viewport):
    if written == "method":
        path = request.getfixturevalue("index").parent / "run" / "pc2pix.html"
    else:
        path = request.getfixturevalue(written)
    page = open_page(path, color_scheme=scheme, viewport=viewport)
    assert page.evaluate("document.documentElement.scrollWidth") == viewport["width"]
    page.evaluate("for (const one of document.querySelectorAll('main details')) one.open = true")
    page.evaluate(AXE_SCRIPT)
    found = page.evaluate("axe.run()")
    violations = [
        (violation["id"], node["html"][:200])
        for violation in found["violations"]
        for node in violation["nodes"]
    ]
    assert violations == []
    assert "color-contrast" in {rule["id"] for rule in found["passes"]}  # it was looked at


WORDS = "document.querySelector('.look-words').textContent"
SEEN = f"[document.querySelector('.look-cloud').toDataURL(), {WORDS}]"


@pytest.mark.parametrize("viewport", [WIDE, PHONE], ids=["wide", "phone"])
def test_the_cloud_turns_and_the_images_follow(open_page, viewport):
    page = open_page(viewport=viewport)
    cloud = page.get_by_label("The cloud; arrow keys turn it")
    cloud.scroll_into_view_if_needed()
    page.wait_for_function(f"{WORDS} !== ''")
    seen = [page.evaluate(SEEN)]
    cloud.press("ArrowRight")
    seen.append(page.evaluate(SEEN))
    box = cloud.bounding_box()
    page.mouse.move(box["x"] + 20, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 320, box["y"] + 60)  # about half a turn
    page.mouse.up()
    seen.append(page.evaluate(SEEN))
    number = seen[2][1].split(":")[0].removeprefix("View ")
    assert number != "0"
    assert len({picture for picture, _ in seen}) == 3
    images = page.locator(".look-frame img")
    assert [one.get_attribute("alt").split()[-1] for one in images.all()] == [number] * 2
    page.get_by_label("View", exact=True).press("Home")
    assert page.evaluate(SEEN) == seen[0]
    page.locator(".look-condition").select_option("noise-0.10")
    assert page.evaluate(SEEN)[0] != seen[0][0]
    page.get_by_label("From the method's image to the truth").fill("80")
    assert images.nth(1).evaluate("one => one.style.clipPath") == "inset(0px 0px 0px 80%)"


def test_without_webgl_the_images_are_there(open_page):
    page = open_page()
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.reload()
    assert page.locator(".look-note").inner_text().startswith("This browser has no WebGL")
    assert page.locator(".look-frame img").first.is_visible()


def test_an_image_is_enlarged_and_its_neighbours_follow(open_page):
    page = open_page(viewport={"width": 390, "height": 800})
    images = page.locator("table.images").first.locator("img")
    alts = [image.get_attribute("alt") for image in images.all()]
    images.nth(2).click()
    dialog = page.get_by_role("dialog")
    assert dialog.locator(".frame").bounding_box()["width"] >= 384
    assert dialog.get_by_label("From the image to the truth").is_visible()
    title = dialog.locator("#enlarged-title")
    assert title.inner_text() == alts[2]
    page.keyboard.press("ArrowLeft")
    assert title.inner_text() == alts[1]  # the truth itself, under no slider
    assert not dialog.get_by_label("From the image to the truth").is_visible()
    page.keyboard.press("Escape")
    assert page.evaluate("document.activeElement.alt") == alts[1]
    page.keyboard.press("Enter")
    assert dialog.is_visible()


def test_a_name_in_a_legend_hides_its_marks_in_all_plots(open_page):
    page = open_page()
    marks = page.locator("[data-method=splat]:visible")
    assert marks.count() > 3
    name = page.locator("[data-legend=splat]").first
    name.press("Enter")
    assert marks.count() == 0
    pressed = page.locator("[data-legend=splat]").evaluate_all("all => all.map(e => e.ariaPressed)")
    assert set(pressed) == {"false"}
    name.click()
    assert marks.count() > 3


def board_column(page, number):
    board = page.locator("table.board").first
    cells = board.locator(f"tbody tr:visible > :nth-child({number})")
    return [text.split()[0] for text in cells.all_inner_texts()]


def test_the_leaderboard_is_sorted_by_a_button(open_page, index):
    page = open_page(index)
    before = board_column(page, 3)  # ssim-object of the first run
    assert len(before) == 3
    head = page.get_by_role("button", name="ssim-object").first
    head.click()
    assert board_column(page, 3)[:2] == sorted(before[:2], reverse=True)  # the best first
    head.click()
    assert board_column(page, 3) == sorted(before)
    page.get_by_role("button", name="method").first.click()
    assert board_column(page, 2) == ["blank", "pc2pix", "splat"]
    assert page.locator("table.board [aria-sort]").count() == 1
    plain = open_page(index, java_script_enabled=False)
    assert plain.locator("table.board button").count() == 0
    assert len(board_column(plain, 2)) == 3


def test_without_scripts_all_is_there(open_page):
    page = open_page(java_script_enabled=False)
    assert not page.locator(".filter").is_visible()
    assert page.locator("table.numbers").first.is_visible()
    assert page.locator("thead button").count() == 0
    summary = page.locator("#tables details.more summary").first
    summary.click()
    assert page.locator("#tables details.more table").first.is_visible()
