from __future__ import annotations

from bench.analysis.comparison import NAN, Estimate
from bench.report.build import table_group
from bench.tables.orderings import Ordering, orderings_table


def ordering(class_name, metric, lead, paper, condition="2048"):
    return Ordering(
        condition, class_name, metric, 0.5, 0.6, Estimate(*lead), paper, 4, "pc2pix@all"
    )


ROWS = (
    ordering("car", "ssim", (0.1, 0.05, 0.15), 163.1),
    ordering("lamp", "ssim", (0.1, 0.05, 0.15), -60.5),
    ordering("vessel", "ssim", (0.02, -0.05, 0.09), 24.4),
    ordering("average", "ssim", (0.07, 0.01, 0.13), 57.2),
    ordering("car", "fd-views", (20.0, 10.0, 30.0), 163.1),
    ordering("lamp", "fd-views", (NAN, NAN, NAN), -60.5),
    ordering("vessel", "fd-views", (-3.25, NAN, NAN), 24.4),
    ordering("average", "fd-views", (8.4, 1.0, 15.0), 57.2),
)


def lines_of(table):
    return {line.name: line for line in table.lines}


def test_verdicts_stand_beside_the_leads():
    group = table_group(orderings_table("s", "pc2pix@all", ROWS), folded=False)
    counts, table = group.tables
    assert [name for name, _ in table.columns] == ["objects", "paper (FID)", "ssim", "fd-views"]
    assert [line.cells[0].text for line in table.lines] == ["4"] * 4
    cells = {name: line.cells[1:] for name, line in lines_of(table).items()}
    assert list(cells) == ["car", "lamp", "vessel", "average"]
    assert [cells[name][0].text for name in cells] == ["+163.1", "-60.5", "+24.4", "+57.2"]
    car, lamp, vessel, average = (cells[name][1] for name in cells)
    assert (car.text, car.beside, car.value) == ("+0.100", "+0.050 to +0.150", 0.1)
    assert [(c.mark, c.gap) for c in (car, lamp, vessel, average)] == [
        ("reproduced", ""), ("", "opposite"), ("", ""), ("reproduced", ""),
    ]  # fmt: skip
    assert [cells[name][2].text for name in cells] == ["+20.0", "-", "-3.2", "+8.4"]
    assert [cells[name][2].value for name in cells] == [20.0, None, -3.25, 8.4]
    assert cells["vessel"][2].beside == ""
    found = {line.name: [cell.text for cell in line.cells] for line in counts.lines}
    assert [name for name, _ in counts.columns][:2] == ["reproduced", "opposite"]
    assert {name: texts[:2] for name, texts in found.items()} == {
        "ssim": ["1", "1"],
        "fd-views": ["1", "0"],
    }
    assert "pc2pix@all is than surface-apss" in group.remark


def test_filters_by_class_and_condition():
    noisy = tuple(
        ordering(r.class_name, r.metric, r.lead, r.paper_lead, "noise-0.10") for r in ROWS
    )
    made = orderings_table("s", "pc2pix@all", ROWS + noisy)
    tables = table_group(made, folded=False).tables
    assert [table.tags.condition for table in tables] == ["2048"] * 2 + ["noise-0.10"] * 2
    assert all(table.unfolded for table in tables)
    tags = {name: line.tags.class_name for name, line in lines_of(tables[1]).items()}
    # the average is of all classes: no choice of one hides it
    assert tags == {"car": "car", "lamp": "lamp", "vessel": "vessel", "average": ""}
