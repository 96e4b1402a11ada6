// What the bench does, on the page Run: numbers, plan, steps to tick, questions, and what steers it.
// It is drawn from the document that the live link brings, and steers by plain POSTs: it needs nothing else.
"use strict";

(() => {
  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (value === false || value === null || value === undefined) continue;
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else if (name === "class") element.className = value;
      else element.setAttribute(name, value === true ? "" : value);
    }
    element.append(...children.filter((child) => child !== null && child !== undefined));
    return element;
  };
  const CHANNELS = {
    voltage: ["voltage", "V", 1, 3],
    current: ["current", "mA", 1e3, 2],
    displacement: ["displacement", "mm", 1e3, 3],
    force: ["force", "mN", 1e3, 3],
    temperature: ["temperature", "°C", 1, 1],
    relative_humidity: ["relative humidity", "%", 1, 1],
    chamber_temperature: ["chamber temperature", "°C", 1, 1],
    chamber_relative_humidity: ["chamber humidity", "%", 1, 1],
  };
  const duration = (seconds) => {
    const whole = Math.round(seconds);
    if (whole < 120) return `${whole} s`;
    const minutes = Math.floor(whole / 60);
    if (minutes < 120) return `${minutes} min${whole % 60 ? ` ${whole % 60} s` : ""}`;
    return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
  };
  // "3.5 V for 0.02 s, then zero" is shown whole under what the guard watches.
  const limit = (text) => (!text ? "" : text.startsWith("not watched") ? "not watched" : `limit ${text.split(/ for |, /)[0].replace("degC", "°C").replace(" percent", " %")}`);
  const clock = (seconds) => new Date(1000 * seconds).toLocaleTimeString("en-GB");
  const size = (bytes) => (bytes >= 1e9 ? `${(bytes / 1e9).toPrecision(3)} GB` : `${(bytes / 1e6).toPrecision(3)} MB`);

  // Draw a part anew only where what it shows has changed: a button that is about to be pressed stays where it is.
  const drawn = new Map();
  function part(id, shown, draw) {
    const element = document.getElementById(id);
    if (!element) return;
    const key = JSON.stringify(shown);
    if (drawn.get(id)?.key === key && drawn.get(id).element === element) return;
    drawn.set(id, { key, element });
    const focused = element.contains(document.activeElement) ? document.activeElement : null;
    element.replaceChildren(...[draw(shown)].flat().filter(Boolean));
    if (focused) (element.querySelector(`[data-key="${CSS.escape(focused.dataset.key ?? "")}"]`) ?? home())?.focus();
  }

  // Where the focus goes when what had it is gone. Never a button: a second Enter would press it.
  const home = () => document.getElementById("lab-progress");
  let last = null;
  document.addEventListener("focusin", (event) => (last = event.target));
  function keepFocus() {
    const active = document.activeElement;
    const gone = active === document.body ? last : active;
    if (gone && (!gone.isConnected || !gone.getClientRects().length)) home()?.focus();
  }

  async function ask(what, values) {
    const { ok, message } = await lab.post(what, values);
    const said = document.getElementById("lab-run-said");
    if (!said) return;
    said.textContent = message;
    said.classList.toggle("lab-bad", !ok);
  }
  const button = (text, what, values = {}, more = {}) =>
    make("button", { type: "button", class: "lab-button", "data-key": text, onclick: () => ask(what, values), ...more }, text);

  function numbers(state) {
    const names = Object.keys(CHANNELS).filter((name) => name in state.latest);
    const limits = state.plan?.limits ?? {};
    part("lab-numbers", { names, limits, old: state.old }, () =>
      names.length
        ? [
            state.old ? make("p", { class: "lab-old" }, "Old: the last readings that came. Nothing is read now.") : null,
            ...names.map((name) =>
              make(
                "div",
                { class: "lab-number" },
                make("span", { class: "lab-number-name" }, CHANNELS[name][0]),
                make("b", { id: `lab-now-${name}` }, "–"),
                make("span", { class: "lab-quiet", title: limits[name] ?? "" }, limit(limits[name])),
              ),
            ),
          ]
        : [make("p", { class: "lab-quiet" }, "Readings stand here while a run is recorded.")],
    );
    for (const name of names) {
      const [, unit, factor, digits] = CHANNELS[name];
      const value = state.latest[name];
      const text = value === null ? "no reading" : `${(value * factor).toFixed(digits).replace(/^-(0\.?0*)$/, "$1")} ${unit}`;
      const element = document.getElementById(`lab-now-${name}`);
      if (element && element.textContent !== text) element.textContent = text;
    }
    const bar = document.getElementById("lab-progress-bar");
    if (bar) {
      const { run, progress, ending } = state;
      bar.hidden = !run || state.bench === "lost"; // what is left of a run whose recorder is gone nobody knows
      const rows = progress?.of ?? run?.rows ?? 1;
      bar.querySelector("progress").max = rows;
      bar.querySelector("progress").value = progress?.rows ?? 0;
      const left = () => (state.trouble ? state.alarm || state.text : ending ? lab.ends(state) : `${duration(Math.max(0, (rows - progress.rows) / run.rate))} left`);
      bar.querySelector("span").textContent = bar.hidden ? "" :
        `${run.signal} (${run.purpose === "fingerprint" ? "fingerprint" : `run ${run.place} of ${run.of}`}): ` +
        (progress ? `${left()}, ${progress.acknowledged} of ${rows} rows on disk` : "begins");
    }
  }

  function question(state) {
    const { question, mine, held } = state;
    part("lab-question", { question, mine, held }, () => {
      if (!question) return [];
      const { number, text, choices, step, example } = question;
      const answer = (value) => ask("answer", { number, value });
      const allowed = mine || !held;
      const ways = choices.map((choice) =>
        make("button", { type: "button", class: "lab-button", "data-key": choice, disabled: !allowed,
          onclick: () => answer(choice) }, choice));
      if (example) {
        const typed = make("input", { type: "text", "aria-label": `A number with its unit, such as ${example}`, placeholder: example,
          "data-key": "answer-text", maxlength: "40", disabled: !allowed,
          onkeydown: (event) => { if (event.key === "Enter") answer(typed.value); } });
        ways.unshift(typed, make("button", { type: "button", class: "lab-button lab-primary", "data-key": "answer", disabled: !allowed,
          onclick: () => answer(typed.value) }, "Enter"));
      }
      return make("div", { class: "lab-question", role: "group", "aria-label": `Step ${step}` },
        make("strong", {}, step), make("p", {}, text), make("div", { class: "lab-row" }, ...ways),
        allowed ? null : make("p", { class: "lab-quiet" }, "Who holds the bench answers this."));
    });
  }

  function steps(state) {
    part("lab-steps", state.steps, (all) => {
      const marks = { done: "✓", now: "▶", open: "○", ended: "■" };
      const words = { done: "done", now: "now", open: "to do", ended: "ended here" };
      return all.map((step) =>
        make("li", { "data-state": step.state, "aria-current": step.state === "now" ? "step" : null },
          make("span", { class: "lab-mark", role: "img", "aria-label": words[step.state] }, marks[step.state]),
          make("span", {}, make("b", {}, step.name), ` ${step.text}`),
          make("span", { class: "lab-quiet" }, step.seconds ? duration(step.seconds) : step.asks ? "by hand" : "")));
    });
    const list = document.getElementById("lab-steps");
    const now = list?.querySelector('[aria-current="step"]');
    if (now && now !== steps.last) list.scrollTop = now.offsetTop - list.offsetTop - 40;
    steps.last = now;
  }

  // What surrounds the strip: what the chamber tells, how far the waiting has come, and every condition in its turn.
  function climate(state) {
    const conditions = state.plan?.conditions ?? [];
    const card = document.getElementById("lab-climate-card");
    if (!card) return;
    card.hidden = !conditions.length;
    if (card.hidden) return;
    const { chamber, equilibrium, condition } = state;
    const shown = (value, unit) => (value === null || value === undefined ? null : `${value.toFixed(1)} ${unit}`);
    part("lab-climate", { chamber, equilibrium: equilibrium && [equilibrium.temperature, equilibrium.relative_humidity] }, () => {
      const rows = [["temperature", "°C", "temperature_set_point"], ["relative_humidity", "%RH", "humidity_set_point"]].map(
        ([name, unit, set]) => {
          const own = shown(chamber?.[name], unit), strip = shown(equilibrium?.[name], unit);
          if (!own && !strip) return null;
          const asked = chamber && chamber[set] !== null ? `set to ${shown(chamber[set], unit)}` : chamber ? "not regulated" : "";
          return make("div", { class: "lab-number" },
            make("span", { class: "lab-number-name" }, CHANNELS[name][0]), make("b", {}, strip ?? own),
            make("span", { class: "lab-quiet" }, [strip && own ? `chamber ${own}` : "", asked].filter(Boolean).join(", ")));
        });
      const doing = !chamber ? "" : chamber.is_still ? "still: fan and compressor are off" : chamber.mode === "constant" ? "regulates" : chamber.mode;
      return [
        make("div", { class: "lab-numbers" }, ...rows),
        doing ? make("p", { class: "lab-quiet" }, `The chamber: ${doing}.`) : null,
        ...(chamber?.alarms ?? []).map((alarm) => make("p", { class: "lab-bad", role: "alert" }, `alarm: ${alarm}`)),
      ];
    });
    const bar = document.getElementById("lab-equilibrium");
    bar.hidden = !equilibrium;
    if (equilibrium) {
      const { settled_for, settle, waited, longest } = equilibrium;
      bar.querySelector("progress").value = settle ? Math.min(1, settled_for / settle) : 1;
      bar.querySelector("span").textContent =
        `within tolerance for ${duration(settled_for)} of ${duration(settle)}; waited ${duration(waited)} of at most ${duration(longest)}`;
    }
    const now = condition?.number ?? 0, over = state.bench === "ended" && state.ended?.how === "done";
    part("lab-conditions", { conditions, now, over }, () =>
      conditions.map((one) => {
        const at = over || one.number < now ? "done" : one.number === now ? "now" : "open";
        return make("li", { "data-state": at, "aria-current": at === "now" ? "step" : null },
          make("span", { class: "lab-mark", role: "img", "aria-label": { done: "done", now: "now", open: "to do" }[at] },
            { done: "✓", now: "▶", open: "○" }[at]),
          make("span", {}, make("b", {}, one.name.replace("degC", "°C")), one.is_reference ? " reference" : ""),
          make("span", { class: "lab-quiet" }, `after ${duration(one.starts)}`));
      }));
  }

  function plan(state) {
    const { plan, bench } = state;
    part("lab-plan", { plan, bench, text: state.text }, () => {
      if (!plan) return make("p", { class: "lab-quiet" }, state.text);
      const remarks = plan.remarks.map((remark) => make("p", { class: "lab-remark" }, remark));
      const short = `at least ${duration(plan.seconds)}, ${plan.rows} rows, ${size(plan.bytes_needed)} of ${size(plan.bytes_free)} free` +
        (state.rig_is_virtual ? "; a simulated bench is through sooner" : "");
      return [
        make("h2", {}, plan.title),
        make("p", { class: "lab-quiet" }, `sample ${plan.sample} on ${plan.rig}; ${short}`),
        bench === "planned" || !plan.remarks.length ? null
          : make("details", {}, make("summary", {}, "To think of"), ...remarks),
        ...(bench === "planned" ? remarks : []),
      ];
    });
    part("lab-watched", plan?.limits ?? {}, (limits) => [
      make("summary", {}, "What the guard watches"),
      make("ul", {}, ...Object.entries(limits).map(([name, text]) =>
        make("li", {}, `${name.replaceAll("_", " ")}: ${text}`)))]);
  }

  function steering(state) {
    const { bench, mine, held, watching } = state;
    const phase = bench === "planned" ? "planned" : ["preparing", "asking", "recording", "starting"].includes(bench) ? "busy" : "";
    part("lab-steer", { phase, mine, held }, () => {
      const may = mine || !held ? {} : { disabled: true };
      const after = { rest: "lab-row" };
      if (phase === "planned")
        return make("div", { class: after.rest }, button("Start", "start", {}, { ...may, class: "lab-button lab-primary" }),
          button("Do not begin", "stop", {}, may));
      if (phase === "busy") {
        const text = make("input", { type: "text", "aria-label": "Text of a mark", placeholder: "mark", "data-key": "mark-text", maxlength: "500",
          onkeydown: (event) => { if (event.key === "Enter" && (mine || !held)) set(); } });
        const set = () => { ask("mark", { text: text.value }); text.value = ""; };
        return make("div", { class: after.rest },
          button("Stop and keep", "stop", {}, may), button("Abort", "abort", {}, may), text,
          make("button", { type: "button", class: "lab-button", "data-key": "mark", ...may,
            onclick: set }, "Mark"));
      }
      return [];
    });
    part("lab-seat", { mine, held, watching }, () => {
      const others = watching > 1 ? ` ${watching} browsers watch.` : "";
      if (mine) return [make("span", {}, `You hold the bench.${others}`), button("Release", "release")];
      if (held) return [make("span", {}, `Somebody else holds the bench: you watch, and ZERO is yours too.${others}`)];
      return [make("span", {}, `Nobody holds the bench.${others}`), button("Take it", "hold")];
    });
  }

  function told(state) {
    part("lab-notes", state.notes, (notes) =>
      [...notes].reverse().slice(0, 30).map((note) => make("li", {}, make("time", { class: "lab-quiet" }, clock(note.at)), ` ${note.text}`)));
    part("lab-recorded", state.recorded, (runs) =>
      runs.map((run) => {
        const codes = [...new Set(run.findings.map((one) => one.code).filter((code) => code !== "fingerprint"))];
        const name = run.path.split(/[\\/]/).pop();
        return make("li", {}, make("b", {}, run.signal), ` ${run.purpose}, ${run.state}`,
          run.state_reason ? make("span", { class: "lab-bad" }, ` (${run.state_reason})`) : null,
          make("div", { class: "lab-quiet" },
            make("a", { href: `/runs?run=${encodeURIComponent(run.path)}`, "data-key": run.path, title: "Open in Runs" }, name),
            `: ${codes.join(", ") || "nothing found"}`));
      }));
    part("lab-outcome", { ended: state.ended, bench: state.bench, text: state.text, alarm: state.alarm }, ({ ended, bench, text, alarm }) => {
      if (bench === "lost") return make("p", { class: "lab-bad", role: "alert" }, alarm ? `${alarm}; ${text}` : text);
      if (!ended) return [];
      const failed = ended.error;
      return [
        make("p", { class: failed ? "lab-bad" : "", role: failed ? "alert" : "status" },
          failed ? `${failed.where ? `${failed.where}: ` : ""}${failed.message}` : { done: "Done.", stop: "Stopped; what was recorded is kept.",
            declined: "Not begun." }[ended.how] ?? "Ended."),
        failed?.repair ? make("p", {}, failed.repair) : null,
      ];
    });
  }

  let shown = null;
  function show(state) {
    const before = shown?.bench;
    shown = state;
    if (!document.getElementById("lab-progress")) return;
    document.documentElement.dataset.bench = state.bench;
    if (before !== state.bench && ["planned", "ended", "lost"].includes(state.bench))
      document.getElementById("lab-run-said").textContent = "";
    const preview = document.getElementById("lab-preview");
    const file = (state.experiment ?? "").split(/[\\/]/).pop();
    const isFree = ["idle", "ended", "lost"].includes(state.bench);
    const isPlanned = ["starting", "planned"].includes(state.bench) && state.mine;
    if (preview) preview.hidden = !isFree && !(isPlanned && file === `${preview.dataset.name}.toml`);
    plan(state);
    question(state);
    steering(state);
    climate(state);
    steps(state);
    numbers(state);
    told(state);
    for (const id of ["lab-notes-card", "lab-recorded-card"]) {
      const card = document.getElementById(id);
      if (card) card.hidden = !(id === "lab-notes-card" ? state.notes : state.recorded).length;
    }
    if (before !== state.bench) requestAnimationFrame(keepFocus);
  }
  lab.listen(show);
  // The page is put together after this script: draw once its places are there.
  const waiting = setInterval(() => {
    if (!document.getElementById("lab-progress")) return;
    clearInterval(waiting);
    if (shown) show(shown);
  }, 50);
})();
