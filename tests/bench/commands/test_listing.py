"""`bench list`: its sections, what stands beside a name, and narrow terminals."""

from __future__ import annotations

import re

import pytest

from bench.catalogue.chosen import measured_methods
from bench.catalogue.conditions import CONDITIONS
from bench.catalogue.methods import CHOOSE_FOR, METHODS, PARAMETERS, RECOMMENDED
from bench.catalogue.metrics import METRICS
from bench.catalogue.suites import ALL_SUITES, SUITES
from bench.commands.listing import SECTIONS, section_lines

from ..conftest import on_terminal

ENTRY = re.compile(r"[* ] (\S+) +(\S.*)")
BY_SECTION = {
    "suites": [suite.id for suite in ALL_SUITES],
    "methods": [method.id for method in METHODS],
    "variants": [f"{parameter.method}@{parameter.name}=" for parameter in PARAMETERS],
    "conditions": [condition.id for condition in CONDITIONS],
    "metrics": [*METRICS],
    "datasets": ["procedural", *(f"{kind}:PATH" for kind in ("folder", "shapenet", "modelnet"))],
}


def names(lines):
    """Return the names of entries among lines that are not wrapped."""
    entries = (ENTRY.fullmatch(line) for line in lines)
    return [entry[1] for entry in entries if entry]


def sections_of(printed):
    return dict(re.findall(r"^(\w[\w ]*):\n((?:.+\n)+?)(?=\w[\w ]*:\n|\Z)", printed, re.MULTILINE))


def test_all_sections_name_everything(command):
    status, out, err = command("list", "--all")
    assert (status, err) == (0, "")
    sections = sections_of(out)
    assert list(sections) == list(SECTIONS)
    for title, expected in BY_SECTION.items():
        found = [name for name in names(sections[title].splitlines()) if name in expected]
        assert found == expected, title
        assert command("list", title) == (0, f"{title}:\n{sections[title]}", "")


def test_without_all_methods_to_choose_from_and_metrics_that_suites_show(command):
    status, out, err = command("list")
    assert (status, err) == (0, "")
    sections = {title: names(lines.splitlines()) for title, lines in sections_of(out).items()}
    methods = sections.pop("methods to choose from")
    assert methods[0] == RECOMMENDED
    assert sorted(methods) == sorted(CHOOSE_FOR)
    metrics = [name for name in METRICS if any(name in suite.metrics for suite in SUITES)]
    on_request = {"flip", "dists", "st-lpips", "invented-holes", "invented-parts"}
    of_meshes = {"chamfer", "f-score", "normal-consistency"}
    assert {*BY_SECTION["metrics"]} - {*metrics} == on_request | of_meshes
    assert [name for name in sections.pop("metrics") if name in METRICS] == metrics
    assert sections == {title: BY_SECTION[title] for title in ("suites", "conditions")}
    assert all(text in out for text in CHOOSE_FOR.values())


def test_costs_are_those_of_the_table():
    """Without a line of its own a method has about that of its family."""
    costs = measured_methods()
    lines = section_lines("methods")
    about = {entry[1]: entry[2] for line in lines if (entry := ENTRY.fullmatch(line))}
    for method in METHODS:
        cost = re.search(r" (~?)([\d.]+) ms ", about[method.id])
        expected = costs.get(method.id, costs.get(method.family))
        if expected is None:
            assert cost is None
        else:
            assert float(cost[2]) == pytest.approx(expected.one_view_ms, rel=0.01)
            assert bool(cost[1]) == (method.id not in costs)


def test_metrics_say_which_way_is_better_and_which_are_in_the_headline():
    lines = list(section_lines("metrics"))
    stars = [line.split()[1] for line in lines if line.startswith("* ")]
    assert stars[:-1] == ["ssim-object", "lpips"]  # the last one is the note
    better = dict(re.findall(r"^[* ] (\S+) +(higher|lower) ", "\n".join(lines), re.MULTILINE))
    assert list(better) == BY_SECTION["metrics"]
    higher = {"ssim", "retrieval"}
    lower = {"lpips", "fd-views", "flip", "dists", "st-lpips", "kd-alexnet", "invented-holes"}
    assert {better[name] for name in higher} == {"higher"}
    assert {better[name] for name in lower} == {"lower"}


@pytest.mark.parametrize("width", [100, 50, 20])
@pytest.mark.parametrize("title", SECTIONS)
def test_a_terminal_wraps_and_loses_no_word(title, width):
    lines = list(section_lines(title, width))
    assert max(map(len, lines)) <= width
    every = {word for line in section_lines(title) for word in line.split()}
    shown = "".join("".join(line.split()) for line in lines)
    assert [word for word in every if word not in shown] == []


def test_the_width_is_that_of_the_terminal():
    printed = on_terminal(20, "list", "suites")
    assert printed == ["suites:", *section_lines("suites", 20)]
