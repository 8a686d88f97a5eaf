// The chosen theme, before the first paint: a module would come too late.
(() => {
  let theme = null;
  try {
    theme = localStorage.getItem("meshdeform.theme");
  } catch {
    // A browser that keeps nothing: as the system has it.
  }
  const dark = theme === "dark" || (theme !== "light" && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.dataset.theme = dark ? "dark" : "light";
})();
