// Set the equations of a page: what Sphinx writes between \( and \), or \[ and \].
document.addEventListener("DOMContentLoaded", () =>
  renderMathInElement(document.body, {
    delimiters: [
      { left: "\\(", right: "\\)", display: false },
      { left: "\\[", right: "\\]", display: true },
    ],
    ignoredTags: ["script", "style", "textarea", "code"],
  }),
);
