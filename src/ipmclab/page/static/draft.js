// A half-written experiment stays in this browser until it is saved: what was changed in the form, and the file that it was begun
// from. It needs no server: what is typed while the link is lost, or just before the server ends, is kept too.
"use strict";

window.LabDraft = (() => {
  const key = `lab-draft-${document.currentScript.dataset.lab}`; // of this folder: another may be served here next
  // This window's own first; a new window goes on with what was written last, and from then on with that alone.
  const stores = ["sessionStorage", "localStorage"];

  // Half a letter (a lone surrogate) cannot be sent: the server would wait for it.
  const whole = (_, value) => (typeof value === "string" ? value.replace(/\p{Surrogate}/gu, "\ufffd") : value);

  function kept() {
    for (const store of stores)
      try {
        const found = JSON.parse(recall(store, key), whole);
        if (typeof found?.from === "string" && found.values) return found;
      } catch {} // somebody else's text
    return { from: "", values: {} };
  }

  function write(draft) {
    for (const store of stores) remember(store, key, JSON.stringify(draft));
  }

  if (recall("sessionStorage", key) === null) remember("sessionStorage", key, JSON.stringify(kept()));

  return {
    kept,
    keep(name, value) {
      const draft = kept();
      draft.values[name] = value ?? "";
      write(draft);
    },
    // Nothing is changed yet of this file, or of a new experiment where it is empty; the digest tells what it says.
    begin: (from, digest) => write({ from, digest, values: {} }),
  };
})();
