// A click, or Enter, on a picture shows it as large as the window; Esc or another click closes it.
const dialog = document.querySelector("dialog.large");
for (const button of document.querySelectorAll("button.picture")) {
  button.addEventListener("click", () => {
    const small = button.querySelector("img");
    const large = dialog.querySelector("img");
    large.src = small.src;
    large.alt = small.alt;
    dialog.querySelector("p").textContent = small.alt;
    dialog.showModal();
  });
}
dialog.addEventListener("click", () => dialog.close());
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));
// A link to a part of the page opens what it is folded into.
const unfold = () => { const part = document.getElementById(location.hash.slice(1))?.closest("details"); if (part) part.open = true; };
addEventListener("hashchange", unfold);
unfold();
