"use strict";
// Enlarges images, beside or under the truth of their group, and hides methods in all plots of the page.
(() => {
  const dialog = document.createElement("dialog");
  dialog.className = "enlarged before-after";
  dialog.setAttribute("aria-labelledby", "enlarged-title");
  dialog.innerHTML = `<p id="enlarged-title" aria-live="polite"></p>
    <div class="frame"><img class="under" alt=""><img class="over" alt=""></div>
    <label>truth <input class="share" type="range" min="0" max="100" aria-label="From the image to the truth"> image</label>
    <p><button type="button" value="-1">Previous</button> <button type="button" value="1" autofocus>Next</button>
    <button type="button" value="0">Close</button></p>`;
  document.body.append(dialog);
  const [under, over, share] = [".under", ".over", ".share"].map((name) => dialog.querySelector(name));

  let group = []; // the images of a table or of a case; one of them is enlarged, and one a stop of the tabulator
  let shown = null;
  const enlarge = (image) => {
    shown = image;
    const truth = group.find((other) => other.dataset.truth !== undefined);
    const compared = truth !== undefined && truth !== image && image.dataset.cloud === undefined;
    dialog.querySelector("#enlarged-title").textContent = image.alt;
    over.src = image.src;
    over.alt = image.alt;
    under.hidden = share.parentElement.hidden = !compared;
    if (compared) under.src = truth.src;
    share.value = compared ? 50 : 0;
    share.dispatchEvent(new Event("input", { bubbles: true }));
  };
  const neighbour = (image, step) => group[(group.indexOf(image) + step + group.length) % group.length];
  const focus = (image) => {
    for (const other of group) other.tabIndex = other === image ? 0 : -1;
    image.focus();
  };
  const arrows = { ArrowLeft: -1, ArrowRight: 1 };
  for (const element of document.querySelectorAll("table.images, .three")) {
    const images = [...element.querySelectorAll("img")];
    const open = ({ currentTarget }) => {
      group = images;
      enlarge(currentTarget);
      focus(currentTarget); // so that the focus comes back to it
      dialog.showModal();
    };
    images.forEach((image, number) => {
      image.tabIndex = number ? -1 : 0;
      image.setAttribute("role", "button");
      image.addEventListener("click", open);
      image.addEventListener("keydown", (event) => {
        group = images;
        if (event.key === "Enter" || event.key === " ") open(event);
        else if (arrows[event.key]) focus(neighbour(image, arrows[event.key]));
        else return;
        event.preventDefault();
      });
    });
  }
  dialog.addEventListener("click", ({ target }) => {
    if (target === dialog || target.value === "0") dialog.close();
    else if (target.tagName === "BUTTON") enlarge(neighbour(shown, Number(target.value)));
  });
  dialog.addEventListener("keydown", (event) => {
    if (arrows[event.key] && event.target !== share) enlarge(neighbour(shown, arrows[event.key]));
  });
  dialog.addEventListener("close", () => focus(shown));

  const names = [...document.querySelectorAll("[data-legend]")];
  const marks = [...document.querySelectorAll("[data-method]")];
  const entries = names.filter((name) => marks.some((mark) => mark.dataset.method === name.dataset.legend));
  const toggle = (method, pressed) => {
    for (const mark of marks) if (mark.dataset.method === method) mark.classList.toggle("unseen", !pressed);
    for (const entry of entries) if (entry.dataset.legend === method) entry.setAttribute("aria-pressed", pressed);
  };
  for (const entry of entries) {
    entry.closest("svg").setAttribute("role", "group"); // an image would hide its buttons from screen readers
    entry.setAttribute("role", "button");
    entry.setAttribute("tabindex", "0");
    entry.setAttribute("aria-label", `Show ${entry.dataset.legend}`);
    entry.setAttribute("aria-pressed", "true");
    const press = () => toggle(entry.dataset.legend, entry.getAttribute("aria-pressed") !== "true");
    entry.addEventListener("click", press);
    entry.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      press();
    });
  }
})();
