"use strict";
// Enlarges images, over the truth of their table or case, and hides methods in all plots of the page.
(() => {
  const dialog = document.createElement("dialog");
  dialog.className = "enlarged before-after";
  dialog.setAttribute("aria-labelledby", "enlarged-title");
  dialog.innerHTML = `<p id="enlarged-title" aria-live="polite"></p>
    <div class="frame"><img class="under" alt=""><img class="over" alt=""></div>
    <label>truth <input class="share" type="range" aria-label="From the image to the truth"> image</label>
    <p><button value="-1">Previous</button> <button value="1" autofocus>Next</button> <button>Close</button></p>`;
  document.body.append(dialog);
  const [title, under, over, share] = ["p", ".under", ".over", ".share"].map((name) => dialog.querySelector(name));

  let group = []; // the images of a table or a case, of which one is in the dialog
  let shown = null;
  const enlarge = (image) => {
    shown = image;
    const truth = group.find((other) => "truth" in other.dataset);
    const compared = truth && !("truth" in image.dataset || "cloud" in image.dataset);
    title.textContent = over.alt = image.alt;
    over.src = image.src;
    under.hidden = share.parentElement.hidden = !compared;
    if (compared) under.src = truth.src;
    share.value = compared ? 50 : 0;
    share.dispatchEvent(new Event("input", { bubbles: true }));
  };
  const go = (step) => enlarge(group[(group.indexOf(shown) + step + group.length) % group.length]);
  // Makes an element a button; a press is a click, Enter or the space bar.
  const pressable = (element, press) => {
    element.setAttribute("role", "button");
    element.setAttribute("tabindex", "0");
    element.addEventListener("click", press);
    element.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      press();
    });
  };
  for (const element of document.querySelectorAll("table.images, .three")) {
    const images = [...element.querySelectorAll("img")];
    for (const image of images) {
      pressable(image, () => {
        group = images;
        enlarge(image);
        dialog.showModal();
      });
      image.tabIndex = image === images[0] ? 0 : -1; // the dialog leads to the others
    }
  }
  dialog.addEventListener("click", ({ target }) => {
    if (target.value === "") dialog.close();
    else if (target.tagName === "BUTTON") go(Number(target.value));
  });
  dialog.addEventListener("keydown", ({ key, target }) => {
    if (target !== share && key === "ArrowLeft") go(-1);
    if (target !== share && key === "ArrowRight") go(1);
  });
  dialog.addEventListener("close", () => shown.focus());

  const entries = [...document.querySelectorAll("[data-legend]")];
  const toggle = (method, pressed) => {
    for (const mark of document.querySelectorAll("[data-method]")) {
      if (mark.dataset.method === method) mark.classList.toggle("unseen", !pressed);
    }
    for (const entry of entries) if (entry.dataset.legend === method) entry.setAttribute("aria-pressed", pressed);
  };
  for (const entry of entries) {
    entry.closest("svg").setAttribute("role", "group"); // an image would hide its buttons from screen readers
    entry.setAttribute("aria-pressed", "true");
    pressable(entry, () => toggle(entry.dataset.legend, entry.getAttribute("aria-pressed") !== "true"));
  }
})();
