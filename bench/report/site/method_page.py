"""The page of a method on a site: accuracy, comparisons, cost, parameters and model card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bench.catalogue.claims import entered_claims
from bench.catalogue.condition_names import condition_words
from bench.catalogue.methods import known_method, role
from bench.catalogue.parameters import PARAMETERS
from bench.report.site.methods import SiteMethod
from bench.report.site.page import Section, SitePage, card_html
from bench.report.site.site_run import (
    COST_REMARK,
    FAILURES,
    SiteRun,
    caption_of,
    cost_grid_of,
    headers,
    lead_record,
    letters_remark,
    method_file,
    pair_file,
    rank_cell,
    share_ranking,
)
from bench.tables.grid import (
    NOTHING,
    Cell,
    Grid,
    TableRow,
    grid,
)
from data_prep.files.checksums import file_sha256


def method_page(method: str, ranked: Sequence[str], all_runs: Sequence[SiteRun]) -> SitePage:
    """Return the page of a method; `ranked` are the methods of the site in their order."""
    runs = [run for run in all_runs if method in run.methods]
    on_site = runs[0].methods[method]
    known = known_method(on_site.id)
    grids = []
    for metric in dict.fromkeys(metric for run in runs for metric in run.metrics):
        rankings = [(run, r) for run in runs for r in run.rankings if r.metric == metric]
        conditions = list(dict.fromkeys(ranking.condition for _, ranking in rankings))
        lines = []
        for run in runs:
            at = {ranking.condition: ranking for owner, ranking in rankings if owner is run}
            values = (rank_cell(run, at[c], method) if c in at else NOTHING for c in conditions)
            truth = f"against {run.truth}"
            about = "; ".join(filter(None, [truth, run.machine, run.methods[method].libraries]))
            lines.append(TableRow(run.name, tuple(values), about, link=run.page))
        remark = letters_remark(ranking for _, ranking in rankings)
        grids.append(
            Grid(
                "run",
                headers(map(condition_words, conditions)),
                tuple(lines),
                caption=caption_of(metric),
                remark=remark,
            )
        )
    others = [
        other for other in ranked if other != method and share_ranking(all_runs, method, other)
    ]
    against = []
    for other in others:
        ahead, ties, behind = lead_record(all_runs, method, other)
        cells = (Cell(str(ahead), float(ahead)), Cell(str(ties)), Cell(str(behind)))
        pair = sorted((method, other), key=ranked.index)
        against.append(TableRow(other, cells, link=pair_file(*pair)))
    costs = tuple(filter(None, (cost_grid_of(run, (), method) for run in runs)))
    sections = [
        Section("Accuracy", FAILURES, tuple(grids)),
        Section(
            "Against the others",
            "Metrics and conditions of all runs, counted by what is shown.",
            (
                Grid(
                    "other method",
                    headers(("ahead", "tie", "behind")),
                    tuple(against),
                    caption=f"{method} against each other method",
                ),
            ),
        ),
        Section("Cost", COST_REMARK, costs),
    ]
    parameters = [p for p in PARAMETERS if p.method == on_site.id]
    if parameters:
        rows = [
            [f"{on_site.id}@{p.name}=", f"{p.low:g} to {p.high:g}", p.about] for p in parameters
        ]
        settings = grid(["variant", "values", "meaning"], rows, caption="What can be set")
        sections.append(Section("Parameters", grids=(settings,)))
    claims = entered_claims(runs[0].run.manifest, on_site.id)
    about = "no longer installed: its package or its weights are gone"
    if claims is not None:
        about = claims.about
    elif known is not None:
        about = known.source
    if known and known.weights_file:
        weights = known.weights_file()
        if not _has_weights(on_site, weights):
            about += "; the weights of these runs are not those installed"
        elif card := _card(weights):
            sections.append(Section("Model card", trusted=card_html(card)))
    counts = [run.images[c.condition, method] for run in runs for c in run.compared]
    failed, images = sum(n - n_ok for n_ok, n in counts), sum(n for _, n in counts)
    return SitePage(
        method_file(method),
        method,
        "pc2pix-bench, a method",
        about,
        (
            ("kind", role(on_site.id) or "competes"),
            ("runs", str(len(runs))),
            ("failed", f"{failed} of {images} images"),
            *([("identity", ", ".join(on_site.identity))] if on_site.identity else []),
        ),
        tuple(sections),
    )


def _has_weights(method: SiteMethod, weights: Path) -> bool:
    """Return whether a method was drawn with these weights, as far as its runs say."""
    stated = [part for part in method.identity if part.startswith("weights ")]
    return not stated or (weights.is_file() and f"weights {file_sha256(weights)}" in stated)


def _card(weights: Path) -> str | None:
    """Return the model card of a weights file, None without one.

    It has the name of the file, or lies beside it with a heading that names it, because one card
    may be of several files.
    """
    same_name = weights.with_suffix(".md")
    for path in (same_name, *sorted(weights.parent.glob("*.md"))):
        if not path.is_file():
            continue
        card = path.read_text("utf-8", errors="replace")
        if path == same_name or f"`{weights.stem}`" in card.partition("\n")[0]:
            return card
    return None
