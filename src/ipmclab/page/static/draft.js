// A form that is half filled in stays in this browser: of an experiment until it is saved, what was changed and the file that it
// was begun from; of another section as long as its window shows it. It needs no server: what is typed while the link is lost, or
// just before the server ends, is kept too.
"use strict";

window.LabDraft = (() => {
  const { lab, own } = document.currentScript.dataset;
  const isOwn = own !== undefined; // of this address in this window alone
  const key = `lab-draft-${lab}${isOwn ? location.pathname + location.search : ""}`; // of this folder: another may be served here next
  // This window's own first; a new window goes on with the experiment that was written last, and from then on with that alone.
  const stores = isOwn ? ["sessionStorage"] : ["sessionStorage", "localStorage"];

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

  function change(say) {
    const draft = kept();
    say(draft.values);
    write(draft);
  }

  // Who follows a link to a section begins anew there; who reloads it, or goes back to it, goes on.
  const isNew = isOwn && performance.getEntriesByType("navigation")[0]?.type === "navigate";
  if (isNew) remember("sessionStorage", key, null);
  else if (recall("sessionStorage", key) === null) remember("sessionStorage", key, JSON.stringify(kept()));

  return {
    kept,
    keep: (name, value) => change((values) => (values[name] = value ?? "")),
    forget: (name) => change((values) => delete values[name]),
    // Nothing is changed yet of this file, or of a new experiment where it is empty; the digest tells what it says.
    begin: (from, digest) => write({ from, digest, values: {} }),
  };
})();
