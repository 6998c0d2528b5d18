from __future__ import annotations

from bench.analysis.comparison import NAN, Estimate
from bench.report.tables import orderings_group
from bench.tables.orderings import Ordering, OrderingsTable


def ordering(class_name, metric, lead, paper, condition="2048"):
    return Ordering(condition, class_name, metric, 0.5, 0.6, Estimate(*lead), paper, 4)


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
    (table,) = orderings_group(OrderingsTable("s", "pc2pix@all", ROWS)).tables
    assert [name for name, _ in table.columns] == ["FID, as published", "ssim", "fd-views"]
    cells = {name: line.cells for name, line in lines_of(table).items()}
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
    assert table.notes == (
        "ssim: 1 of 3 classes reproduced, 1 opposite",
        "fd-views: 1 of 3 classes reproduced, 0 opposite",
    )


def test_filters_by_class_and_condition():
    noisy = tuple(
        ordering(r.class_name, r.metric, r.lead, r.paper_lead, "noise-0.10") for r in ROWS
    )
    tables = orderings_group(OrderingsTable("s", "pc2pix@all", ROWS + noisy)).tables
    assert [table.tags.condition for table in tables] == ["2048", "noise-0.10"]
    tags = {name: line.tags.class_name for name, line in lines_of(tables[0]).items()}
    # the average is of all classes: no choice of one hides it
    assert tags == {"car": "car", "lamp": "lamp", "vessel": "vessel", "average": ""}
