"use strict";
// Colours, sortable tables, and tables that unfold on paper.
(() => {
  const themes = [["", "system"], ["light", "light"], ["dark", "dark"]];
  const button = document.getElementById("theme");
  let theme = 0;
  button.hidden = false;
  button.addEventListener("click", () => {
    theme = (theme + 1) % themes.length;
    const [name, words] = themes[theme];
    if (name) document.documentElement.dataset.theme = name;
    else delete document.documentElement.dataset.theme;
    button.textContent = `Colours: ${words}`;
  });

  let folded = [];
  addEventListener("beforeprint", () => {
    folded = [...document.querySelectorAll("details:not([open])")];
    for (const each of folded) each.open = true;
  });
  addEventListener("afterprint", () => { for (const each of folded) each.open = false; });

  for (const table of document.querySelectorAll("table.sortable")) {
    const body = table.tBodies[0];
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      const press = document.createElement("button");
      press.type = "button";
      press.title = "Sort by this column";
      press.textContent = head.textContent;
      head.replaceChildren(press);
      press.addEventListener("click", () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        for (const other of heads) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const rows = [...body.rows].map((row) => [row.cells[column], row]);
        rows.sort(([a], [b]) => compare(a, b, down));
        body.append(...rows.map(([, row]) => row));
      });
    });
  }

  // Numbers are sorted by value, text by the alphabet; undefined values always come last.
  function compare(a, b, down) {
    const [left, right] = [a.dataset.value, b.dataset.value];
    if (left === undefined && right === undefined) {
      const order = a.textContent.localeCompare(b.textContent);
      return down ? -order : order;
    }
    if (!left || !right) return !left - !right;
    return down ? right - left : left - right;
  }
})();
