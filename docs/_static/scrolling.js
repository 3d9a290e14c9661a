// Makes an element that scrolls in its own frame reachable with the keyboard.
addEventListener("load", () => {
  for (const part of document.querySelectorAll("article pre, article .table-wrapper, article div.math")) {
    if (part.scrollWidth > part.clientWidth || part.scrollHeight > part.clientHeight) part.tabIndex = 0;
  }
});
