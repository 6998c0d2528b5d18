"""The option `--open` of run, report and site."""

from __future__ import annotations

import os
import subprocess
import webbrowser
from pathlib import Path

import pytest

from bench.commands.browser import open_page

from ..builders import write_run
from ..conftest import BENCH


def test_the_page_is_opened_by_its_address(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    opened = []
    open_page(Path("a b.html"), lambda address: opened.append(address) is None)
    assert opened == [f"{tmp_path.as_uri()}/a%20b.html"]
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("problem", [None, webbrowser.Error("none"), OSError(), ValueError()])
def test_without_a_browser_one_line_names_the_page(capsys, problem):
    def open_url(address):
        if problem:
            raise problem
        return False

    open_page(Path("run/report.html"), open_url)
    line = "bench: no browser could be started; the page is run/report.html\n"
    assert capsys.readouterr() == ("", line)


def test_report_and_site_open_their_page(tmp_path):
    """$BROWSER is what `webbrowser` starts: here a program that notes what it is given."""
    run, noted = write_run(tmp_path / "run"), tmp_path / "noted"
    browser = tmp_path / "browser"
    browser.write_text(f'#!/bin/sh\necho "$1" >> "{noted}"\n')
    browser.chmod(0o755)
    environment = os.environ | {"BROWSER": str(browser)}
    site = tmp_path / "site"
    for asked in (("report", run), ("site", run, "--out", site)):
        command = [*BENCH, *map(str, asked), "--open"]
        subprocess.run(command, check=True, capture_output=True, env=environment)
    pages = (run / "report.html", site / "index.html")
    assert noted.read_text().splitlines() == [page.as_uri() for page in pages]


def test_a_suite_without_a_page_refuses(command, tmp_path):
    status, out, err = command("run", "--suite", "latent", "--open", "--out", tmp_path / "run")
    assert (status, out) == (2, "")
    assert err == "bench: --open: the suite latent makes tables and no page; leave it out\n"
    assert not (tmp_path / "run").exists()
