"use strict";
// A button with data-copy copies the text of the element that it names.
for (const button of document.querySelectorAll("button[data-copy]"))
  button.addEventListener("click", async () => {
    const copied = document.getElementById(button.dataset.copy);
    getSelection().selectAllChildren(copied);  // what stays for Ctrl+C where copying is forbidden
    try { await navigator.clipboard.writeText(copied.innerText); }
    catch { if (!document.execCommand("copy")) return; }
    button.textContent = "Copied";
  });
// A link to a folded section unfolds it.
const unfold = () => {
  const section = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!section) return;
  for (let e = section.querySelector(":scope > details") ?? section; e; e = e.parentElement)
    if (e.tagName === "DETAILS") e.open = true;
  section.scrollIntoView();
};
addEventListener("hashchange", unfold);
unfold();
