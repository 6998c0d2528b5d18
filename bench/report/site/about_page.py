"""The page of a site on documentation, licence and citation."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from bench.records.run_folder import PROTOCOL
from bench.report.site.page import Section, SitePage
from bench.report.site.site_run import SiteRun

ABOUT = "about.html"
PACKAGE = "pc2pix-bench"
LICENCE, CITATION = "LICENSE", "CITATION.cff"
ROOT = Path(__file__).parents[3]  # of a checkout
READ = (
    "The documentation is the folder docs of the project: report.md says how to read these pages, "
    "protocol.md what is measured, compare.md how differences are tested."
)


def about_page(runs: Sequence[SiteRun]) -> SitePage:
    """Return the page; texts that are not installed are left out."""
    protocol = str(runs[0].run.manifest[PROTOCOL])
    versions = {
        str(run.run.manifest.get("versions", {}).get(PACKAGE, "unknown")): None for run in runs
    }
    cite = (
        f"The pc2pix-bench developers. pc2pix-bench, version {', '.join(versions)}, protocol "
        f"{protocol}. Give the version of the protocol and the dataset beside each number."
    )
    sections = [
        Section("Documentation", READ, links=_project_links()),
        Section("Citation", cite, trusted=_text(CITATION)),
        Section("Licence", "MIT.", trusted=_text(LICENCE)),
    ]
    return SitePage(
        ABOUT,
        "Licence and citation",
        PACKAGE,
        "Where to read on, how to cite, and what may be done with it.",
        (("protocol", protocol), ("version", ", ".join(versions))),
        tuple(sections),
    )


def _project_links() -> tuple[tuple[str, str], ...]:
    """Return the addresses that the package names: of its documentation, of the paper."""
    try:
        urls = distribution(PACKAGE).metadata.get_all("Project-URL") or []
    except PackageNotFoundError:
        return ()
    pairs = (url.partition(", ") for url in urls)
    return tuple((name, address) for name, _, address in pairs)


def _text(name: str) -> str:
    """Return a file of the package or of the checkout as HTML; empty where there is none."""
    try:
        text = distribution(PACKAGE).read_text(f"licenses/{name}")
    except PackageNotFoundError:
        text = None
    path = ROOT / name
    text = text or (path.read_text("utf-8") if path.is_file() else "")
    label = f'role="region" aria-label="{escape(name)}" tabindex="0"'
    return f"<pre {label}><code>{escape(text)}</code></pre>" if text else ""
