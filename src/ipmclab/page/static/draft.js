// A half-written experiment stays in this browser until it is saved: what was changed in the form, and the file that it was begun
// from. It needs no server: what is typed while the link is lost, or just before the server ends, is kept too.
"use strict";

window.LabDraft = (() => {
  const key = `lab-draft-${document.currentScript.dataset.lab}`; // of this folder: another may be served here next
  // This window's own first; a new window goes on with what was written last.
  const stores = ["sessionStorage", "localStorage"];

  function kept() {
    for (const store of stores)
      try {
        const found = JSON.parse(recall(store, key));
        if (typeof found?.from === "string" && found.values) return found;
      } catch {} // somebody else's text
    return { from: "", values: {} };
  }

  function write(draft) {
    for (const store of stores) remember(store, key, JSON.stringify(draft));
  }

  return {
    kept,
    keep(name, value) {
      const draft = kept();
      draft.values[name] = value ?? "";
      write(draft);
    },
    // Nothing is changed yet of this file; of a new experiment where it is empty.
    begin: (from) => write({ from, values: {} }),
  };
})();
