"use strict";
// The table is complete without this: it adds buttons that sort it.
(() => {
  const sorted = (rows, column, numeric, sign) => {
    const key = (row) => {
      const cell = row.cells[column];
      if (!numeric) return (cell.querySelector(".name") || cell).textContent.trim();
      return cell.dataset.value === undefined ? null : Number(cell.dataset.value);
    };
    return rows.sort((a, b) => {
      const [x, y] = [key(a), key(b)];
      if (x === null || y === null) return (x === null) - (y === null); // always last
      return sign * (numeric ? x - y : x.localeCompare(y));
    });
  };
  for (const table of document.querySelectorAll("table.board")) {
    const status = table.closest(".leaderboard").querySelector(".status");
    const [first, second] = table.tHead.rows;
    const below = [...second.cells];
    const heads = [...first.cells].flatMap((head) => (head.colSpan > 1 || head.rowSpan === 1 ? below.splice(0, head.colSpan) : [head]));
    heads.forEach((head, column) => {
      const name = head.getAttribute("aria-label") || head.textContent.trim();
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-label", `Sort by ${name}`);
      button.addEventListener("click", () => {
        const numeric = head.dataset.sort === "number";
        const best = numeric && head.dataset.better === "higher" ? "descending" : "ascending";
        const other = best === "ascending" ? "descending" : "ascending";
        const order = head.getAttribute("aria-sort") === best ? other : best;
        const body = table.tBodies[0];
        body.append(...sorted([...body.rows], column, numeric, order === "ascending" ? 1 : -1));
        for (const one of heads) one.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", order);
        status.textContent = `Sorted by ${name}, ${order}.`;
      });
      head.querySelector("span").after(button);
    });
  }
})();
