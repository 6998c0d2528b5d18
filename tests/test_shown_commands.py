"""Run the `bench` commands of some pages in one folder, in the order of the pages.

What a page writes in capitals stands for something of the reader's, and a suite takes minutes: the
tables below say what is given here instead, and what makes it small. What a command prints is
compared with the `text` block below it, in which `…` stands for times, paths and the like.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from bench.cli import app
from data_prep.datasets.registry import open_dataset
from data_prep.scene import Mesh

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).parents[1]
DOCS = REPOSITORY / "docs"
PAGES = (DOCS / "quickstart.md", REPOSITORY / "README.md", DOCS / "datasets.md")
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"\d+\.\d+")
SMALL = "--limit 2 --views 2 --methods splat --conditions 2048 --workers 1"
GIVEN = {
    "CLOUDS": "examples",
    "PATH": "meshes",
    "folder:PATH": "folder:meshes",
    "DIR_A": "first",
    "DIR_B": "first",
    "DIR": "own",
    "IMAGES": "ours",
    "TRUTH": "true",
}
FURTHER = {
    "run --suite own-meshes --dataset folder:PATH": (
        f"{SMALL.replace('splat', 'splat,alpha-wrap')} --out own"
    ),
    "run --suite chair-robustness --dataset exported:exported-chairs": f"{SMALL} --out of-export",
    "data export --dataset procedural --conditions all --out exported-chairs": (
        "--limit 1 --views 2 --workers 1"
    ),
}


def shown(page: Path) -> list[str]:
    """What the page gives `bench`, without what explains it."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [command for kind, block in blocks if not kind for command in commands_of(block)]


def commands_of(block: str) -> list[str]:
    lines = re.findall("^bench (.*)$", re.sub(r" *\\\n *", " ", block), re.MULTILINE)
    return [re.split(r" {2,}", line)[0] for line in lines]


def typed(command: str) -> list[str]:
    """The same with something in place of each name in capitals, and small."""
    text = f" {command} "
    for name, given in GIVEN.items():
        text = re.sub(rf"(?<= ){re.escape(name)}(?= )", given, text)
    return shlex.split(f"{text} {FURTHER.get(command, '')}")


def shown_outputs(page: Path) -> dict[str, str]:
    """Return the `text` blocks of a page, by the command that they stand below."""
    outputs, command = {}, ""
    for kind, block in BLOCK.findall(page.read_text(encoding="utf-8")):
        if kind == "text":
            outputs[command] = block
        elif not kind and (commands := commands_of(block)):
            command = commands[-1]
    return outputs


def assert_same_output(actual: str, expected: str) -> None:
    """Compare words exactly, numbers as far as another driver rounds alike, and nothing at `…`."""
    pattern = "(.*)".join(map(re.escape, NUMBER.sub("#", expected).split("…")))
    assert re.fullmatch(pattern, NUMBER.sub("#", actual)), f"{actual}\nis not\n{expected}"
    if "…" not in expected:
        values, shown_values = (list(map(float, NUMBER.findall(t))) for t in (actual, expected))
        assert values == pytest.approx(shown_values, abs=0.005)


def run(words: list[str]) -> tuple[int, str, str]:
    """Return the exit status of a command, all that it prints, and its standard output."""
    ended = CliRunner().invoke(app, words, prog_name="bench")
    return ended.exit_code, ended.output, ended.stdout


def write_obj(mesh: Mesh, path: Path) -> None:
    lines = [
        *(f"v {x} {y} {z}" for x, y, z in mesh.vertices.tolist()),
        *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()),
    ]
    path.write_text("\n".join(lines))


def test_they_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")  # pytest-xdist sets 80
    Path("examples").mkdir()
    cloud = Path("examples/chair.ply")
    cloud.write_bytes((REPOSITORY / cloud).read_bytes())
    Path("meshes/chair").mkdir(parents=True)
    for index, shape in enumerate(open_dataset("procedural").objects("chair", 2, 2)):
        write_obj(shape.load(), Path(f"meshes/chair/{index}.obj"))
    for folder, grey in (("ours", 100), ("true", 200)):
        Path(folder).mkdir()
        Image.new("L", (64, 64), grey).save(f"{folder}/image.png")
    commands = [command for page in PAGES for command in shown(page)]
    assert len(commands) >= 20
    assert {*FURTHER} <= {*commands}, "what a page no longer shows"
    expected = {command: text for page in PAGES for command, text in shown_outputs(page).items()}
    assert set(expected) <= set(commands)
    assert expected, "no page shows what a command prints"
    for command in commands:
        ended, output, printed = run(typed(command))
        assert ended == 0, f"{command}: {output}"
        if command in expected:
            assert_same_output(printed, expected[command])
    for path in ("first/report.html", "first/comparisons", "sheet.png", "turn.gif", "chair.png"):
        assert Path(path).exists(), path


def test_those_of_rendering_run(tmp_path, monkeypatch):
    """Each image and turntable is where the page says."""
    monkeypatch.chdir(tmp_path)
    Path("chair.ply").write_bytes((REPOSITORY / "examples" / "chair.ply").read_bytes())
    page = (DOCS / "rendering.md").read_text(encoding="utf-8")
    (camera,) = (block for kind, block in BLOCK.findall(page) if kind == "json")
    Path("camera.json").write_text(camera)
    (table,) = open_dataset("procedural").objects("table", 1, 1)
    write_obj(table.load(), Path("table.obj"))
    for command in shown(DOCS / "rendering.md"):
        ended, output, _ = run(shlex.split(command))
        assert ended == 0, f"{command}: {output}"
    sizes = {}
    for path in (path for path in Path().rglob("*") if path.suffix in (".png", ".gif")):
        with Image.open(path) as image:
            sizes[str(path)] = (image.size, getattr(image, "n_frames", 1))
    of_one = (
        *("chair", "pc2pix", "splat", "coloured", "budget", "lying", "table", "wrapped"),
        *("images/chair", "images/table"),
    )
    assert sizes == {
        **{f"{name}.png": ((128, 128), 1) for name in of_one},
        "large.png": ((512, 512), 1),
        "seen.png": ((320, 240), 1),
        "sheet.png": ((3 * 262 + 6, 2 * 280 + 6), 1),  # tiles with their margins and labels
        "turntable.gif": ((4 * 262 + 6, 280 + 6), 36),
        "table-sheet.png": ((4 * 262 + 6, 280 + 6), 1),
        "turns/chair.gif": ((128, 128), 36),
        "turns/table.gif": ((128, 128), 36),
    }
