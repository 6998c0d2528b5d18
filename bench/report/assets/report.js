"use strict";
// The page is complete without this: it adds sorting and a field that hides rows, and opens what is folded to print.
(() => {
  const sort = (head) => {
    const table = head.closest("table");
    const { column, better } = head.dataset;
    const first = better === "higher" ? "descending" : "ascending";
    const other = first === "ascending" ? "descending" : "ascending";
    const order = head.getAttribute("aria-sort") === first ? other : first;
    const sign = order === "ascending" ? 1 : -1;
    const key = (row) => {
      const cell = row.cells[column];
      if (better) return cell.dataset.value === undefined ? null : Number(cell.dataset.value);
      return (cell.querySelector(".name") || cell).textContent.trim();
    };
    const compare = (a, b) => {
      const [x, y] = [key(a), key(b)];
      if (x === null || y === null) return (x === null) - (y === null); // always last
      return sign * (better ? x - y : x.localeCompare(y));
    };
    table.tBodies[0].append(...[...table.tBodies[0].rows].sort(compare));
    for (const sorted of table.querySelectorAll("[aria-sort]")) sorted.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", order);
  };
  for (const head of document.querySelectorAll("th[data-column]")) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    button.addEventListener("click", () => sort(head));
    head.append(button);
  }

  const form = document.querySelector(".filter");
  const rows = [...document.querySelectorAll("table:not(.images) tbody tr")];
  const filter = () => {
    const wanted = form.querySelector("input").value.trim().toLowerCase();
    for (const row of rows) row.hidden = !row.textContent.toLowerCase().includes(wanted);
    const seen = rows.filter((row) => !row.hidden).length;
    form.querySelector("[role=status]").textContent = wanted ? `${seen} of ${rows.length} rows` : "";
  };
  if (form) {
    form.hidden = !rows.length;
    form.addEventListener("input", filter);
    form.addEventListener("submit", (event) => event.preventDefault());
  }

  let folded = [];
  window.addEventListener("beforeprint", () => {
    folded = [...document.querySelectorAll("main details:not([open])")];
    for (const details of folded) details.open = true;
  });
  window.addEventListener("afterprint", () => {
    for (const details of folded) details.open = false;
  });
})();
