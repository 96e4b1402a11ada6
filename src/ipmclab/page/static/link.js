// The link to the bench: one WebSocket that brings readings and what the bench does, and plain POSTs that steer it.
// It depends on nothing but the browser: STOP and ZERO work while the rest of the page is still loading or has failed.
"use strict";

const lab = (window.lab = {
  state: null,
  stacks: new Set(),
  listeners: new Set(),
  socket: null,
  heard: 0,
  pressed: 0,
  wanted: { view: "none" },
  retry: 300,
  patience: 3500, // ms without a pulse: then the link is taken as lost

  connect() {
    const socket = new WebSocket(`${location.origin.replace(/^http/, "ws")}/live`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.retry = 300;
      this.hear();
      if (this.wanted.view !== "none") socket.send(JSON.stringify(this.wanted));
    };
    socket.onmessage = (event) => {
      this.hear();
      if (typeof event.data === "string") this.told(JSON.parse(event.data));
      else {
        const frame = LabPlot.unpack(event.data);
        this.stacks.forEach((stack) => stack.taken(frame));
      }
    };
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.lose();
      setTimeout(() => this.connect(), this.retry);
      this.retry = Math.min(2000, 1.5 * this.retry);
    };
  },

  hear() {
    this.heard = performance.now();
    const banner = document.getElementById("lab-lost");
    if (banner && !banner.hidden) banner.hidden = true;
    document.documentElement.classList.remove("lab-is-lost");
  },

  lose() {
    const banner = document.getElementById("lab-lost");
    if (!banner || !banner.hidden) return;
    const since = new Date().toLocaleTimeString("en-GB");
    banner.querySelector("span").textContent =
      `Connection lost at ${since}: what you see is old. A recording continues and stays guarded; this page reconnects by itself.`;
    banner.hidden = false;
    document.documentElement.classList.add("lab-is-lost");
    if (this.pressed > this.heard) say("The connection was lost as you pressed that: it may not have been done.", false);
  },

  view(wanted) {
    this.wanted = wanted;
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(wanted));
  },

  follow(stack) {
    this.stacks.add(stack);
    this.view(stack.view());
  },

  unfollow(stack) {
    this.stacks.delete(stack);
    if (!this.stacks.size) this.view({ view: "none" });
  },

  // Call with every document of the bench, now and from now on.
  listen(listener) {
    this.listeners.add(listener);
    if (this.state) listener(this.state);
    return () => this.listeners.delete(listener);
  },

  told(message) {
    if (message.kind === "pulse") {
      if (!this.state) return;
      Object.assign(this.state, message);
    } else this.state = message;
    this.listeners.forEach((listener) => listener(this.state));
  },

  // What is still recorded of a run that is being ended: that the output is at 0 V is said once the recorder has said so.
  ends: (state) => (state.run && state.ending.at_zero ? `discharging at 0 V, ${left(state)}` : "until the recorder has ended"),

  // Ask the bench for something: {ok, message}.
  async post(what, values = {}) {
    let answer;
    if (what === "release") {
      keepSeat.isGiven = true; // at once: the page may be loaded anew before the answer comes
      remember("sessionStorage", "lab-held", null);
    }
    try {
      answer = await fetch(`/bench/${what}`, {
        method: "POST",
        keepalive: true, // a press as the page changes, STOP above all, is not dropped with the page
        headers: { "content-type": "application/json" },
        body: JSON.stringify(values),
      });
    } catch {
      if (what === "release") keepSeat.isGiven = false;
      return { ok: false, message: "the page's server does not answer: use the switch of the amplifier if in doubt" };
    }
    if (what === "release" && !answer.ok) keepSeat.isGiven = false;
    const told = await answer.json().catch(() => ({}));
    return { ok: answer.ok, message: told.message ?? (answer.ok ? "" : `refused (${answer.status})`) };
  },
});

// ---- the header

const WORDS = {
  idle: "idle", starting: "starting", planned: "planned", preparing: "preparing", asking: "question",
  recording: "recording", ended: "ended", lost: "recorder lost",
};

const ENDINGS = { stop: "stopping", limit: "limit passed", zero: "to 0 V", abort: "aborting" };

const isBusy = (state) => !["idle", "ended", "lost"].includes(state.bench);

function tellHeader(state) {
  const bench = document.getElementById("lab-bench");
  if (!bench) return;
  const busy = isBusy(state);
  bench.dataset.bench = state.bench;
  const set = (id, text) => {
    const element = document.getElementById(id);
    if (element && element.textContent !== text) element.textContent = text;
  };
  bench.dataset.output = state.output;
  bench.toggleAttribute("data-trouble", state.trouble);
  bench.title = state.trouble ? [state.alarm, state.text].filter(Boolean).join("; ") : "";
  const ending = busy && state.ending;
  const word = state.silent !== null ? "no readings" : ending ? ENDINGS[ending.how] : WORDS[state.bench] ?? state.bench;
  // What nobody has confirmed to be at 0 V is said before all else.
  set("lab-bench-word", state.alarm || word);
  set("lab-bench-text", state.alarm ? `${word}: ${state.text}` : state.trouble ? state.text : ending ? lab.ends(state) :
    state.bench === "recording" && state.run ? `${state.run.signal}, ${left(state)}` : state.text);
  set("lab-guard", state.guard);
  const may = state.mine || !state.held;
  document.getElementById("lab-stop").disabled = !busy || !may;
  document.getElementById("lab-stop").title = may ? "End the run now and keep it" : "Only who holds the bench stops a run";
}

function left(state) {
  if (!state.progress) return "starting";
  const seconds = Math.max(0, (state.progress.of - state.progress.rows) / state.run.rate);
  return seconds < 120 ? `${seconds.toFixed(0)} s left` : `${(seconds / 60).toFixed(0)} min left`;
}

async function press(what, button) {
  button.classList.add("lab-pressed");
  const { ok, message } = await lab.post(what);
  button.classList.remove("lab-pressed");
  say(ok && lab.state?.bench === "ended" ? "" : message, ok);
  press.asked = ok ? what : "";
}

function say(text, ok) {
  const said = document.getElementById("lab-said");
  if (said.textContent === text) said.textContent = ""; // it is read out once more
  said.textContent = text;
  said.dataset.ok = ok;
  clearTimeout(say.timer);
  say.timer = setTimeout(() => (said.textContent = ""), 8000);
}

// What only the server does: while the link is lost it would wait in a queue and be done later, or never, and the browser would
// leave for a page of its own. What the browser does itself (zoom, save a figure, type) goes on, and so does what steers the bench.
const SERVERS = ".q-btn, .q-toggle, .q-select, .q-menu .q-item, .lab-run-table button, a[href^='/']";
const ENTERS = `${SERVERS}, .lab-enters`; // and fields that Enter sends

function holdBack(event) {
  const target = event.target.closest?.(event.key === "Enter" ? ENTERS : SERVERS);
  if (!target || target.closest(".q-notification")) return;
  if (event.type === "keydown" && !["Enter", " "].includes(event.key)) return;
  lab.pressed = performance.now();
  if (!document.documentElement.classList.contains("lab-is-lost")) return;
  event.preventDefault();
  event.stopImmediatePropagation();
  // A server that ends takes along what only it was told: what a form says stays where the browser keeps it.
  say(`Not done: the connection is lost. ${window.LabDraft ? "What the form says stays; press" : "Press"} again when it is back.`, false);
}

// A browser says of a download that failed neither why nor what to do: it is asked for here, and said.
async function fetchFile(event) {
  const link = event.target.closest?.("a.lab-download[download]");
  if (!link) return;
  event.preventDefault();
  const late = setTimeout(() => say("The file is being prepared.", true), 1000);
  try {
    const answer = await fetch(link.href);
    if (!answer.ok) {
      const { detail = `The file did not come: the server answered ${answer.status}.` } = await answer.json().catch(() => ({}));
      return void say(detail, false);
    }
    const header = answer.headers.get("content-disposition") ?? "";
    const coded = /filename\*=utf-8''([^;]+)/i.exec(header)?.[1];
    const name = coded ? decodeURIComponent(coded) : /filename="([^"]*)"/.exec(header)?.[1] ?? "";
    LabPlot.save(await answer.blob(), name);
  } catch {
    say("The file did not come: the connection was lost. Press again when it is back.", false);
  } finally {
    clearTimeout(late);
  }
}

// "Stopping" is not said of what has ended: the header then says what the output is at.
function hush(state) {
  if (["stop", "zero"].includes(press.asked) && !isBusy(state)) {
    press.asked = "";
    document.getElementById("lab-said").textContent = "";
  }
}

// The server keeps in memory who holds the bench: after it was begun anew in mid-run, whoever held this run holds it again.
function keepSeat(state) {
  const held = recall("sessionStorage", "lab-held");
  const experiment = String(state.experiment);
  if (!state.mine) keepSeat.isGiven = false;
  if (state.mine && isBusy(state) && !keepSeat.isGiven) {
    keepSeat.link = lab.socket;
    if (held !== experiment) remember("sessionStorage", "lab-held", experiment);
  } else if (held !== null && (keepSeat.link === lab.socket || (state.held && !state.mine)))
    remember("sessionStorage", "lab-held", null); // it ended, was released, or is somebody else's now
  else if (held === experiment && isBusy(state)) {
    remember("sessionStorage", "lab-held", null); // asked once; it is remembered again when it is ours
    lab.post("hold", { again: true });
  }
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  remember("localStorage", "lab-theme", theme);
  window.Quasar?.Dark.set(theme === "dark");
  document.getElementById("lab-theme")?.setAttribute("aria-pressed", String(theme === "dark"));
}

// Quasar puts the options of an open list into a focusable box within the list, where nothing but options may be: screen
// readers would count none. The box is never focused; without the attribute it is none to them.
const lists = new MutationObserver(() =>
  requestAnimationFrame(() => {
    for (const box of document.querySelectorAll('[role="listbox"] > [tabindex]:not([role])')) box.removeAttribute("tabindex");
  }),
);

for (const type of ["click", "keydown"]) document.addEventListener(type, holdBack, true);
document.addEventListener("click", fetchFile);

document.addEventListener("DOMContentLoaded", () => {
  lab.heard = performance.now(); // from now on there is something to hear
  lab.connect(); // before all that could fail
  let looked = lab.heard, awake = lab.heard;
  setInterval(() => {
    const now = performance.now();
    if (now - looked > 2000) awake = now; // the page stood still itself: what came meanwhile waits to be heard
    looked = now;
    if (now - Math.max(lab.heard, awake) > lab.patience) {
      lab.lose();
      if (lab.socket.readyState === WebSocket.OPEN) lab.socket.close();
    }
  }, 500);
  document.getElementById("lab-stop").addEventListener("click", (event) => press("stop", event.currentTarget));
  document.getElementById("lab-zero").addEventListener("click", (event) => press("zero", event.currentTarget));
  document.getElementById("lab-theme").addEventListener("click", () =>
    setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  );
  setTheme(document.documentElement.dataset.theme);
  lists.observe(document.body, { childList: true });
  lab.listen(tellHeader);
  lab.listen(hush);
  lab.listen(keepSeat);
});
