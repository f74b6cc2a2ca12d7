// What the theme leaves out, after the equations have been set.
window.addEventListener("load", () => {
  // a narrow window shows a row of a table as a list of its cells, each after the head of its column
  for (const table of document.querySelectorAll("table.docutils")) {
    const heads = [...table.querySelectorAll("thead th")].map((head) => head.textContent);
    for (const row of table.querySelectorAll("tbody tr"))
      [...row.cells].forEach((cell, column) => (cell.dataset.head = heads[column] ?? ""));
  }
  for (const head of document.querySelectorAll("thead th"))
    if (!head.textContent.trim()) head.replaceWith(document.createElement("td"));
  // for readers without a screen or a mouse: levels and names of the sidebars, and keys for what scrolls sideways
  for (const caption of document.querySelectorAll("p.caption[role=heading]")) caption.setAttribute("aria-level", "2");
  document.querySelector(".sidebar-drawer")?.setAttribute("aria-label", "Pages");
  document.querySelector(".toc-drawer")?.setAttribute("aria-label", "On this page");
  for (const wide of document.querySelectorAll("pre, .table-wrapper, div.math"))
    if (wide.scrollWidth > wide.clientWidth) wide.tabIndex = 0;
});
