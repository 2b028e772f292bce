/* The theme's arrows that open a part of the navigation have no name: they get that of the page they belong to. */
document.addEventListener("DOMContentLoaded", () => {
  for (const arrow of document.querySelectorAll("summary:not([aria-label])")) {
    if (arrow.textContent.trim()) continue;
    const page = arrow.closest("li")?.querySelector("a")?.textContent.trim();
    arrow.setAttribute("aria-label", page ? `Pages below ${page}` : "More pages");
  }
});
