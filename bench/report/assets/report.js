"use strict";
// The page is complete without this: it adds sorting and filters, and opens what is folded to print.
(() => {
  const keys = ["method", "condition", "class", "outcome"];
  const form = document.querySelector(".filters");
  const status = form.querySelector(".status");
  const reset = form.querySelector(".reset");
  const picks = [...form.querySelectorAll(".pick")];
  const main = document.querySelector("main");
  const tagged = [...main.querySelectorAll(keys.map((key) => `[data-${key}]`).join())];
  const groups = [...main.querySelectorAll("[data-group]")].reverse(); // inner ones come first
  const items = [...main.querySelectorAll("[data-item]")];

  const chosen = () =>
    new Map(picks.map((pick) => [
      pick.dataset.key,
      new Set([...pick.querySelectorAll(":checked")].map((box) => box.value)),
    ]));

  const fits = (element, wanted) =>
    keys.every((key) => {
      const of_key = wanted.get(key);
      const tag = element.dataset[key];
      if (!of_key || !of_key.size || tag === undefined) return true;
      return key === "outcome" ? tag.split(" ").some((one) => of_key.has(one)) : of_key.has(tag);
    });

  const visible = (element) => !element.closest("[hidden]");

  const counted = () => {
    const counts = new Map();
    for (const item of items) {
      const kind = item.dataset.item;
      if (kind === "series") continue;
      const [seen, all] = counts.get(kind) || [0, 0];
      counts.set(kind, [seen + visible(item), all + 1]);
    }
    return [...counts].map(([kind, [seen, all]]) => `${seen} of ${all} ${kind}`).join(", ");
  };

  const filter = () => {
    const wanted = chosen();
    for (const element of [...tagged, ...groups]) element.removeAttribute("hidden");
    for (const element of tagged) element.toggleAttribute("hidden", !fits(element, wanted));
    for (const group of groups) {
      const inside = [...group.querySelectorAll("[data-item]")];
      if (inside.length && !inside.some(visible)) group.setAttribute("hidden", "");
    }
    for (const description of main.querySelectorAll(".nothing")) {
      const inside = [...description.closest("section").querySelectorAll("[data-item]")];
      description.hidden = inside.some(visible);
    }
    for (const head of main.querySelectorAll("[scope=colgroup]")) {
      const below = [...head.closest("thead").querySelectorAll("[scope=col]")];
      const columns = below.filter((one) => one.dataset.metric === head.dataset.metric);
      const seen = columns.filter((one) => !one.hidden).length;
      head.colSpan = Math.max(seen, 1);
      head.hidden = !seen;
    }
    let active = false;
    for (const pick of picks) {
      const count = wanted.get(pick.dataset.key).size;
      const of_all = pick.querySelectorAll("input").length;
      pick.querySelector(".state").textContent = count ? `${count} of ${of_all}` : "all";
      pick.toggleAttribute("data-active", count > 0);
      active ||= count > 0;
    }
    form.toggleAttribute("data-active", active);
    reset.disabled = !active;
    status.textContent = active ? `Showing ${counted()}.` : "";
  };

  const close = (pick) => {
    pick.open = false;
    pick.querySelector("summary").focus();
  };
  for (const pick of picks) {
    pick.addEventListener("toggle", () => {
      if (pick.open) for (const other of picks) if (other !== pick) other.open = false;
    });
    pick.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && pick.open) close(pick);
    });
  }
  document.addEventListener("click", (event) => {
    for (const pick of picks) if (!pick.contains(event.target)) pick.open = false;
  });
  form.addEventListener("change", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  reset.addEventListener("click", () => {
    for (const box of form.querySelectorAll("input")) box.checked = false;
    filter();
    status.textContent = "Showing all.";
    picks[0].querySelector("summary").focus();
  });

  const sort = (head) => {
    const table = head.closest("table");
    const body = table.tBodies[0];
    const numeric = head.dataset.sort === "number";
    const better = head.dataset.better || table.dataset.better;
    const first = numeric && better === "higher" ? "descending" : "ascending";
    const other = first === "ascending" ? "descending" : "ascending";
    const order = head.getAttribute("aria-sort") === first ? other : first;
    const sign = order === "ascending" ? 1 : -1;
    const key = (row) => {
      const cell = row.cells[head.cellIndex];
      if (!numeric) return cell.textContent;
      return cell.dataset.value === undefined ? null : Number(cell.dataset.value);
    };
    const compare = (a, b) => {
      const [x, y] = [key(a), key(b)];
      if (x === null || y === null) return (x === null) - (y === null); // always last
      return sign * (numeric ? x - y : x.localeCompare(y));
    };
    body.append(...[...body.rows].sort(compare));
    for (const one of head.parentElement.cells) one.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", order);
    const name = head.textContent.trim();
    status.textContent = `${table.caption.textContent}: sorted by ${name}, ${order}.`;
  };
  for (const head of main.querySelectorAll("th[data-sort]")) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    button.addEventListener("click", () => sort(head));
    head.append(button);
  }

  let folded = [];
  window.addEventListener("beforeprint", () => {
    folded = [...main.querySelectorAll("details:not([open])")];
    for (const one of folded) one.open = true;
  });
  window.addEventListener("afterprint", () => {
    for (const one of folded) one.open = false;
  });

  form.hidden = !picks.length;
})();
