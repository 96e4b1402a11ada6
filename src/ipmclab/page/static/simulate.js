// Simulate: sliders on the parameters, the response, the frequency response and the bent strip, answered by a warm worker.
// Only the newest position counts: one question is on its way at a time, and the next one is what the sliders say then.
"use strict";

const LabSimulate = (() => {
  const STEPS = 1000; // of a slider
  const OUTPUTS = {
    current: { label: "current", unit: "mA", factor: 1e3 },
    applied_voltage: { label: "applied voltage", unit: "V", factor: 1 },
    displacement: { label: "displacement", unit: "mm", factor: 1e3 },
    force: { label: "force", unit: "mN", factor: 1e3 },
  };
  const KINDS = {
    step: "Step", sine: "Sine", square: "Square", triangle: "Triangle", chirp: "Chirp", written: "As text",
  };
  const OLD = "not answered: what is shown is from before";
  const PAUSE = 30; // [ms] between two pictures of the strip
  const MAGNIFY = [1, 2, 5, 10, 20, 50];

  function make(tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name in made && name !== "list") made[name] = value;
      else made.setAttribute(name, value);
    }
    made.append(...children);
    return made;
  }

  const svg = (tag, attributes = {}) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    return made;
  };

  // What the values as loaded answer: the voltage, and the files as they were.
  const keyOf = ({ run, signal, duration, rate }, { stamps }) => [...stamps, run, ...(run ? [] : [signal, duration, rate])].join("|");
  // As text: a number field of a browser in English takes the comma out of 1,5 and has 15.
  const numberInput = (value) => make("input", { type: "text", inputMode: "decimal", autocomplete: "off", value });
  const NUMBER = /^\s*[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?\s*$/i; // and no 0x10
  const digits = (value) => String(Number(Number(value).toPrecision(5)));
  let counter = 0;

  // A label, its input, and the place of its message.
  class Field {
    constructor(label, input, unit = "", factor = 1, range = [-Infinity, Infinity]) {
      const id = `lab-field-${++counter}`;
      this.input = input;
      this.unit = unit;
      this.factor = factor; // from SI to what it shows
      this.range = range; // that is allowed [SI]
      input.id = id;
      this.message = make("p", { className: "lab-bad lab-field-message", id: `${id}-m`, hidden: true });
      this.row = make("div", { className: "lab-field" },
        make("label", { htmlFor: id }, label), make("span", { className: "lab-field-input" }, input, unit), this.message);
      input.setAttribute("aria-describedby", `${id}-m`);
    }
    get isEmpty() {
      const { inputMode, value } = this.input;
      return inputMode === "decimal" && !(NUMBER.test(value) && Number.isFinite(value / this.factor));
    }
    get repair() {
      const { value } = this.input;
      if (value.includes(",")) {
        const isEnglish = value.lastIndexOf(".") > value.indexOf(",") || value.split(",").length > 2; // 1,000.5
        const meant = isEnglish ? value.replaceAll(",", "") : value.replaceAll(".", "").replace(",", ".");
        return `Write a decimal point and no comma: ${meant}.`;
      }
      const [, number] = /^(.*?)\s*[^\d\s.]+$/.exec(value) ?? [];
      return NUMBER.test(number ?? "") ? `Write the number without a unit: ${number}.` : "Write a number.";
    }
    // In the unit of the field, where what it holds is a number that is not allowed.
    get outside() {
      const [low, high] = this.range;
      const value = this.input.value / this.factor;
      if (this.isEmpty || (value >= low && value <= high)) return "";
      const ends = [low, high].map((end) => digits(end * this.factor)).join(" to ");
      return `${this.input.value.trim()} is outside the allowed ${ends} ${this.unit}`.trim();
    }
    complain(text) {
      this.message.textContent = text;
      this.message.hidden = !text;
      this.input.setAttribute("aria-invalid", text ? "true" : "false");
    }
  }

  // The strip from the side, to scale along it, heights magnified as it says.
  class Strip {
    constructor(host) {
      this.host = host;
      this.at = 0;
      this.picture = svg("svg", { role: "img", class: "lab-strip", "aria-label": "The strip from the side" });
      this.time = make("input", { type: "range", min: 0, max: 1, value: 0 });
      this.time.setAttribute("aria-label", "Time of the picture");
      this.time.addEventListener("input", () => this.show(Number(this.time.value)));
      this.button = make("button", { type: "button", textContent: "Play" });
      this.button.addEventListener("click", () => (this.timer ? this.stop() : this.play()));
      this.says = make("output", { className: "lab-strip-says" });
      const svgButton = make("button", { type: "button", textContent: "SVG", title: "Save the picture" });
      svgButton.setAttribute("aria-label", "Save the picture: strip");
      svgButton.addEventListener("click", () => this.saveSvg());
      const csvButton = make("button", { type: "button", textContent: "CSV", title: "Save the shape at this time" });
      csvButton.setAttribute("aria-label", "Save the shape at this time: strip");
      csvButton.addEventListener("click", () => this.saveCsv());
      host.append(
        make("div", { className: "lab-stack-bar" }, this.button, this.time, svgButton, csvButton), this.says, this.picture);
    }

    take(about, arrays) {
      this.about = about;
      this.times = arrays.get("shape.time");
      this.x = arrays.get("shape.x").map((value) => 1e3 * value);
      this.y = arrays.get("shape.y").map((value) => 1e3 * value);
      const length = 1e3 * about.length;
      let most = 0;
      for (const value of this.y) most = Math.max(most, Math.abs(value));
      this.magnify = MAGNIFY.findLast((factor) => factor * most <= 0.4 * length) ?? 1;
      this.reach = Math.max(0.08 * length, 1.15 * this.magnify * most);
      this.length = length;
      this.time.max = this.times.length - 1;
      this.at = Math.min(this.at || this.largest(), this.times.length - 1);
      this.show(this.at);
    }

    largest() {
      const { places } = this.about;
      let best = 0;
      for (let k = 0; k < this.times.length; k++)
        if (Math.abs(this.y[(k + 1) * places - 1]) > Math.abs(this.y[(best + 1) * places - 1])) best = k;
      return best;
    }

    points(at) {
      const { places } = this.about;
      const found = [];
      for (let k = at * places; k < (at + 1) * places; k++) found.push([this.x[k], -this.magnify * this.y[k]]);
      return found;
    }

    show(at) {
      this.at = at;
      this.time.value = at;
      const path = this.points(at).map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(3)} ${y.toFixed(3)}`).join("");
      const { length, reach } = this;
      const clamp = 0.08 * length;
      const laser = 1e3 * this.about.laser;
      const box = `${-clamp} ${-reach} ${length * 1.06 + clamp} ${2 * reach}`;
      if (this.picture.getAttribute("viewBox") !== box || !this.strip) {
        this.picture.setAttribute("viewBox", box);
        this.strip = svg("path", { class: "lab-strip-line", fill: "none", "vector-effect": "non-scaling-stroke" });
        this.picture.replaceChildren(
          svg("rect", { class: "lab-strip-clamp", x: -clamp, y: -reach, width: clamp, height: 2 * reach }),
          svg("path", { class: "lab-strip-rest", d: `M0 0H${length}`, "vector-effect": "non-scaling-stroke" }),
          svg("path", { class: "lab-strip-laser", d: `M${laser} ${-reach}V${reach}`, "vector-effect": "non-scaling-stroke" }),
          this.strip,
        );
      }
      this.strip.setAttribute("d", path);
      const tip = this.y[(at + 1) * this.about.places - 1];
      const scale = this.magnify > 1 ? `, heights × ${this.magnify}` : "";
      this.says.textContent = `t = ${LabPlot.number(this.times[at], 4)} s, tip at ${LabPlot.number(tip, 3)} mm${scale}`;
      this.picture.setAttribute("aria-label", `The strip from the side: ${this.says.textContent}`);
    }

    play() {
      this.button.textContent = "Pause";
      this.timer = setInterval(() => this.show((this.at + 1) % this.times.length), PAUSE);
    }

    stop() {
      clearInterval(this.timer);
      this.timer = 0;
      this.button.textContent = "Play";
    }

    saveSvg() {
      const copy = this.picture.cloneNode(true);
      const [, , width, height] = this.picture.getAttribute("viewBox").split(" ").map(Number);
      copy.setAttribute("xmlns", "http://www.w3.org/2000/svg");
      copy.setAttribute("width", 800);
      copy.setAttribute("height", Math.round((800 * height) / width));
      const style = svg("style");
      style.textContent =
        ".lab-strip-clamp{fill:#d5dadf}.lab-strip-rest{stroke:#7a8691;stroke-width:1}" +
        ".lab-strip-laser{stroke:#d55e00;stroke-width:1;stroke-dasharray:6 4}.lab-strip-line{stroke:#0072b2;stroke-width:4}";
      copy.prepend(style);
      LabPlot.save(new Blob([copy.outerHTML], { type: "image/svg+xml" }), "strip.svg");
    }

    saveCsv() {
      const rows = this.points(this.at).map(([x, y]) => `${x.toPrecision(8)},${(-y / this.magnify).toPrecision(8)}`);
      LabPlot.save(new Blob([["x [mm],y [mm]", ...rows, ""].join("\n")], { type: "text/csv" }), "strip.csv");
    }
  }

  class View {
    // options: actuator, parameters [{name, label, group, unit, factor, value, low, high, log, note}], runs [[key, label]], run
    constructor(host, options, tell) {
      this.host = host;
      this.options = options;
      this.tell = tell;
      this.client = `s${Math.random().toString(36).slice(2)}`;
      this.changes = {};
      this.fields = new Map();
      this.setters = new Map(); // of each parameter: put its slider somewhere
      this.build();
      if (!View.isBegun) this.goOn();
      View.isBegun = true; // what is loaded later is looked at anew
      this.unlisten = window.lab.listen(() => this.isBack());
      this.ask();
    }

    // The link is heard again: what was asked over one that was lost is asked again.
    isBack() {
      if (this.isAsking && this.link && this.link !== window.lab.socket) this.asking.abort(); // nobody would answer it
      if (this.isLost) this.ask();
    }

    // The fields of the voltage as they are kept; which run it is over the server knows.
    get said() {
      const { kind, amplitude, tone, text, duration, rate } = this;
      return { kind, amplitude, tone, text, duration, rate };
    }

    // As this window left it, where that was of this actuator.
    goOn() {
      const view = window.LabDraft?.kept().values.view;
      if (view?.actuator !== this.options.actuator) return;
      for (const [name, input] of Object.entries(this.said)) if (typeof view[name] === "string") input.value = view[name];
      if (!this.kind.value) this.kind.value = "step";
      this.arrange();
      for (const [name, value] of Object.entries(view.changes ?? {}))
        if (Number.isFinite(value)) this.setters.get(name)?.(value);
    }

    keep() {
      const said = Object.fromEntries(Object.entries(this.said).map(([name, input]) => [name, input.value]));
      const { options: { actuator }, run, changes } = this;
      window.LabDraft?.keep("view", { ...said, actuator, run: run.value, changes });
    }

    destroy() {
      this.unlisten();
      this.strip.stop();
      this.stack.destroy();
      this.frequency.destroy();
      this.gone = true;
    }

    build() {
      this.alert = make("p", { className: "lab-bad", role: "alert", hidden: true });
      this.notes = make("ul", { className: "lab-notes" });
      this.sureSays = make("summary");
      this.sureMore = make("ul");
      this.sureness = make("details", { className: "lab-sureness", hidden: true }, this.sureSays, this.sureMore);
      this.took = make("span", { className: "lab-quiet", textContent: "the model is being loaded" });
      const left = make("div", { className: "lab-column" }, this.signalCard(), this.parametersCard());
      const time = make("div");
      const strip = make("div");
      const frequency = make("div");
      const right = make("div", { className: "lab-column" },
        make("section", { className: "lab-card" },
          make("div", { className: "lab-title" }, make("h2", {}, "Response"), this.took), this.alert, this.notes, this.sureness, time),
        make("section", { className: "lab-card" }, make("h2", {}, "The strip from the side"), strip),
        make("section", { className: "lab-card" },
          make("div", { className: "lab-title" }, make("h2", {}, "Frequency response"), this.outputChoice()), frequency),
      );
      this.host.classList.add("lab-simulator");
      this.host.replaceChildren(left, right);
      this.stack = new LabPlot.Stack(time, { name: "Simulated response", panels: [], height: 125 });
      this.strip = new Strip(strip);
      this.frequency = new LabPlot.Stack(frequency, {
        name: "Frequency response", panels: this.frequencyPanels(), height: 120,
        x: { label: "frequency", symbol: "f", unit: "Hz", power: true },
      });
    }

    outputChoice() {
      this.output = make("select");
      this.output.setAttribute("aria-label", "Output of the frequency response");
      for (const [name, { label }] of Object.entries(OUTPUTS)) this.output.add(new Option(label, name));
      this.output.value = "displacement";
      this.output.addEventListener("change", () => {
        this.frequency.setPanels(this.frequencyPanels());
        this.drawFrequency();
      });
      return this.output;
    }

    frequencyPanels() {
      const { unit } = OUTPUTS[this.output.value];
      const series = [{ key: "now", label: "now", colour: 0 }, { key: "loaded", label: "as loaded", colour: 7, style: "dashed" }];
      return [
        { key: "gain", label: "gain", unit: `dB re 1 ${unit}/V`, factor: 1, series },
        { key: "phase", label: "phase", unit: "°", factor: 1, series },
      ];
    }

    signalCard() {
      this.kind = make("select");
      for (const [name, text] of Object.entries(KINDS)) this.kind.add(new Option(text, name));
      const field = (label, input, unit, where) => {
        const made = new Field(label, input, unit);
        this.fields.set(where, made);
        input.addEventListener("input", () => this.ask());
        return made;
      };
      this.amplitude = numberInput("1");
      this.rate = numberInput("50");
      this.duration = numberInput("40");
      this.tone = numberInput("0.1");
      this.text = make("input", { type: "text", value: "step 1 V" });
      this.run = make("select");
      this.setRuns(this.options.runs);
      this.run.value = this.options.run ?? "";
      const kind = new Field("Signal", this.kind);
      const amplitude = field("Amplitude", this.amplitude, "V", "amplitude");
      const tone = field("Frequency", this.tone, "Hz", "frequency");
      const text = field("Signal as text", this.text, "", "signal");
      const duration = field("Duration", this.duration, "s", "duration");
      const rate = field("Rate", this.rate, "Hz", "rate");
      const run = field("Over a run", this.run, "", "run");
      run.row.classList.add("lab-field-whole"); // what tells runs apart is long
      const arrange = (this.arrange = () => {
        const over = this.run.value !== "";
        const written = this.kind.value === "written";
        if (written && document.activeElement === this.kind) this.text.value = this.signal("sine");
        for (const one of [kind, duration, rate]) one.row.hidden = over;
        amplitude.row.hidden = over || written;
        tone.row.hidden = over || written || this.kind.value === "step";
        text.row.hidden = over || !written;
      });
      this.kind.addEventListener("change", () => {
        arrange();
        this.ask();
      });
      this.run.addEventListener("change", () => {
        arrange();
        this.loaded = null;
      });
      arrange();
      return make("section", { className: "lab-card" }, make("h2", {}, "Voltage"),
        kind.row, amplitude.row, tone.row, text.row, duration.row, rate.row, run.row);
    }

    setRuns(runs) {
      const chosen = this.run.value;
      this.run.replaceChildren(new Option("none: the signal above", ""));
      for (const [key, label] of runs) this.run.add(new Option(label, key));
      this.run.value = [...this.run.options].some((option) => option.value === chosen) ? chosen : "";
    }

    signal(kind = this.kind.value) {
      const [volts, hertz] = [this.amplitude.value, this.tone.value];
      if (kind === "written") return this.text.value;
      if (kind === "step") return `step ${volts} V`;
      if (kind === "chirp") {
        return `chirp ${volts} V ${hertz} Hz ${10 * Number(hertz)} Hz sweep_time=${this.duration.value} s`;
      }
      return `${kind} ${volts} V ${hertz} Hz`;
    }

    parametersCard() {
      const all = make("button", { type: "button", textContent: "Reset all" });
      all.addEventListener("click", () => {
        for (const reset of this.resets) reset();
        this.changes = {};
        this.ask();
      });
      this.resets = [];
      const card = make("section", { className: "lab-card" },
        make("div", { className: "lab-title" }, make("h2", {}, "Parameters"), all));
      const open = this.options.parameters.filter((one) => one.note);
      if (open.length)
        card.append(make("p", { className: "lab-field-note" }, open.length === 1
          ? `The fit does not determine ${open[0].label}: what depends on it is a guess.`
          : `The fit does not determine ${open.length} of these parameters: what depends on them is a guess.`));
      const groups = new Map();
      for (const one of this.options.parameters) {
        if (!groups.has(one.group)) {
          const details = make("details", { open: one.group !== "geometry" }, make("summary", {}, one.group));
          groups.set(one.group, details);
          card.append(details);
        }
        groups.get(one.group).append(this.parameterRow(one));
      }
      return card;
    }

    parameterRow(one) {
      const toSlider = (value) =>
        one.log ? (STEPS * Math.log(value / one.low)) / Math.log(one.high / one.low)
          : (STEPS * (value - one.low)) / (one.high - one.low);
      const toValue = (place) =>
        one.log ? one.low * (one.high / one.low) ** (place / STEPS) : one.low + ((one.high - one.low) * place) / STEPS;
      const number = numberInput(digits(one.value * one.factor));
      const field = new Field(one.label, number, one.unit, one.factor, one.range);
      const slider = make("input", { type: "range", min: 0, max: STEPS, step: 1, value: toSlider(one.value) });
      slider.setAttribute("aria-label", one.label);
      slider.dataset.parameter = one.name;
      const say = (value) => slider.setAttribute("aria-valuetext", `${digits(value * one.factor)} ${one.unit}`);
      say(one.value);
      field.row.classList.add("lab-parameter");
      if (one.note) {
        const id = `${number.id}-n`;
        field.row.insertBefore(make("p", { className: "lab-field-note", id }, one.note), field.message);
        number.setAttribute("aria-describedby", `${id} ${number.id}-m`);
        slider.setAttribute("aria-describedby", id);
      }
      field.row.insertBefore(slider, field.message);
      this.fields.set(one.name, field);
      const set = (value) => {
        this.changes[one.name] = value;
        say(value);
        field.row.classList.add("lab-changed");
      };
      const change = (value) => {
        set(value);
        this.ask();
      };
      const show = (value) => {
        number.value = digits(value * one.factor);
        slider.value = toSlider(value);
      };
      this.setters.set(one.name, (value) => {
        show(value);
        set(value);
      });
      slider.addEventListener("input", () => {
        const value = toValue(Number(slider.value));
        number.value = digits(value * one.factor);
        change(value);
      });
      number.addEventListener("input", () => {
        if (field.isEmpty) return void this.ask();
        const value = Number(number.value) / one.factor;
        slider.value = toSlider(value) || 0; // the logarithm of what is not above 0 is no place
        change(value);
      });
      this.resets.push(() => {
        show(one.value);
        field.row.classList.remove("lab-changed");
        say(one.value);
      });
      return field.row;
    }

    question() {
      return {
        actuator: this.options.actuator, changes: this.changes, client: this.client, run: this.run.value,
        signal: this.signal(), duration: this.duration.value, rate: this.rate.value,
      };
    }

    // The fields that are empty, or hold no number: until they do, there is no question.
    lacking() {
      const own = { written: [], step: ["amplitude"] }[this.kind.value] ?? ["amplitude", "frequency"];
      const voltage = this.run.value === "" ? [...own, "duration", "rate"] : [];
      return [...this.setters.keys(), ...voltage].map((name) => this.fields.get(name)).filter((field) => field.isEmpty);
    }

    // What the sliders changed, and the parameters whose fields say something else: they are in sight then.
    told() {
      const wrong = this.options.parameters.filter(({ name }) => !this.fields.get(name).message.hidden);
      for (const { name } of wrong) this.fields.get(name).row.closest("details").open = true;
      if (wrong.length) this.fields.get(wrong[0].name).row.scrollIntoView({ block: "nearest" });
      return { changes: this.changes, wrong: wrong.map(({ label }) => label) };
    }

    ask() {
      this.keep();
      this.isOpen = !this.lacking().length;
      if (!this.isOpen) return void this.wait();
      this.since ??= performance.now();
      if (!this.isAsking) this.answer();
    }

    wait() {
      this.since = null;
      this.complain({ code: "no-number" });
      this.took.textContent = "waits for a number: what is shown is from before";
    }

    async answer() {
      this.isAsking = true;
      while (this.isOpen && !this.gone) {
        this.isOpen = false;
        const { since } = this;
        this.since = null;
        const question = this.question();
        this.link = window.lab.socket;
        this.asking = new AbortController();
        this.isLost = false;
        try {
          if (await this.one(question)) this.tell(question);
          this.host.dataset.took = String(performance.now() - since);
          this.took.textContent = this.host.dataset.error ? OLD
            : `answered in ${Math.round(performance.now() - since)} ms`;
        } catch (error) {
          this.isLost = true;
          this.complain({ message: `the simulation cannot be reached: ${error.message}`, where: "", repair: "it continues when the connection is back" });
          this.took.textContent = OLD;
        }
      }
      this.isAsking = false;
      if (this.lacking().length) this.wait();
    }

    // Whether it was answered: what is said of it beside the page is that of the last question that was.
    async one(question) {
      const body = JSON.stringify(question);
      const { signal } = this.asking;
      const answer = await fetch("/simulate", { method: "POST", headers: { "content-type": "application/json" }, body, signal });
      if (answer.status === 204) return false;
      if (!answer.ok) {
        const told = await answer.json().catch(() => ({ message: `the server answered ${answer.status}`, where: "", repair: "" }));
        this.complain(told);
        return false;
      }
      const { head, arrays } = LabPlot.unpack(await answer.arrayBuffer());
      this.complain(null);
      this.take(head, arrays, question);
      return true;
    }

    complain(error) {
      for (const field of this.fields.values()) field.complain("");
      this.alert.hidden = true;
      this.host.dataset.error = error ? error.code ?? "fault" : "";
      this.host.classList.toggle("lab-is-old", Boolean(error));
      // The server tells the first mistake; what can be seen from here is told of every field.
      for (const field of this.fields.values()) if (!field.row.hidden && field.isEmpty) field.complain(field.repair);
      for (const name of ["duration", "rate"])
        if (Number(this.fields.get(name).input.value) < 0) this.fields.get(name).complain("Must be above 0.");
      if (!error?.message) return;
      const text = error.repair ? `${error.message}; ${error.repair}` : error.message;
      const field = this.fields.get(error.where) ?? this.fields.get(this.written(error.where, error.message));
      if (field && !field.row.hidden) field.complain(field.isEmpty ? field.repair : field.outside || text);
      else {
        this.alert.textContent = text;
        this.alert.hidden = false;
      }
    }

    // Which field a place in the signal's text belongs to, and what is wrong there.
    written(where, message) {
      const last = String(where).split(/[.: ]/).pop();
      if (this.fields.has(last) && !this.fields.get(last).row.hidden) return last;
      if (/signal|amplitude|frequency/.test(where)) {
        if (this.kind.value === "written") return "signal";
        return / Hz\b/.test(message) && !this.fields.get("frequency").row.hidden ? "frequency" : "amplitude";
      }
      return last;
    }

    take(head, arrays, question) {
      this.shown = arrays;
      const moved = Object.keys(question.changes).length > 0;
      const key = keyOf(question, head);
      if (this.key !== key || !moved) this.loaded = moved ? null : arrays;
      this.notes.replaceChildren(...head.findings.map((text) => make("li", {}, text)));
      if (head.assumed_hold)
        this.notes.append(make("li", {}, "The run does not say when its output changed: each row is taken as read just before it."));
      if (head.stamps[0] !== this.options.stamp)
        this.notes.append(make("li", {}, "The file of the actuator was changed: Load it again, for the sliders are of what it said before."));
      this.key = key;
      this.asked = question;
      this.drawResponse();
      this.drawFrequency();
      this.strip.take(head.shape, arrays);
      this.host.dataset.answers = String(Number(this.host.dataset.answers ?? 0) + 1);
      if (!moved) this.askBands(question);
    }

    drawResponse() {
      const { shown: arrays, asked: question } = this;
      const over = question.run !== "";
      const series = [{ key: "now", label: "now", colour: 0 }];
      const before = this.loaded && this.loaded !== arrays && !over;
      if (before) series.push({ key: "loaded", label: "as loaded", colour: 7, style: "dashed" });
      const sure = this.sure?.key === this.key && (before || this.loaded === arrays) ? this.sure : null;
      this.tellSureness(sure, Object.keys(question.changes).length > 0);
      const band = (name) => (sure?.arrays.has(`${name}.low`) ? ["low", "high"] : []).map((style) => (
        { key: style, style, label: `${sure.head.label}${before ? ", as loaded" : ""}`, colour: before ? 7 : 0 }));
      const panels = [{ key: "voltage", label: "voltage", unit: "V", factor: 1, least: 0.2, series: [{ key: "v", label: "voltage", colour: 6 }] }];
      for (const [name, { label, unit, factor }] of Object.entries(OUTPUTS)) {
        if (!arrays.has(name) || name === "applied_voltage") continue;
        const measured = arrays.has(`measured.${name}`) ? [{ key: "measured", label: "measured", colour: 1, style: "dashed" }] : [];
        const own = [...band(name), ...measured, ...series];
        panels.push({ key: name, label, unit, factor, series: own });
      }
      this.stack.setPanels(panels);
      const curve = (from, name, factor) => [
        // Answers to one voltage have the same rows, and one array for them is drawn without joining.
        from.get(`${name}.time`) ?? arrays.get("time"), (from.get(name) ?? new Float64Array()).map((value) => value * factor),
      ];
      for (const panel of panels)
        this.stack.show(panel.key, panel.series.map((one) => {
          if (one.key === "v") return curve(arrays, "voltage", 1);
          if (one.key === "low" || one.key === "high") return curve(sure.arrays, `${panel.key}.${one.key}`, panel.factor);
          if (one.key === "measured") return curve(arrays, `measured.${panel.key}`, panel.factor);
          return curve(one.key === "loaded" ? this.loaded : arrays, panel.key, panel.factor);
        }));
      this.stack.draw(...(this.stack.zoom ?? this.stack.extent()));
    }

    // How sure the fit is of the values as loaded: asked after they are drawn, and answered beside the sliders.
    async askBands(question) {
      const { key } = this;
      if (!this.options.fitted || this.sure?.key === key || this.sureAsked === key) return;
      this.sureAsked = key;
      try {
        const body = JSON.stringify({ ...question, bands: true });
        const answer = await fetch("/simulate", { method: "POST", headers: { "content-type": "application/json" }, body });
        if (answer.status === 204 || this.gone || this.sureAsked !== key) return;
        if (answer.ok) {
          const { head, arrays } = LabPlot.unpack(await answer.arrayBuffer());
          if (keyOf(question, head) !== key) return void this.ask(); // a file was changed between the two
          this.sure = { key, head, arrays };
        } else {
          const { message = `the server answered ${answer.status}` } = await answer.json().catch(() => ({}));
          this.sure = { key, head: { label: "", sentences: [`No band: ${message}.`] }, arrays: new Map() };
        }
        this.drawResponse();
      } catch {
        return; // the curve itself says that the link is lost
      } finally {
        if (this.sureAsked === key) this.sureAsked = null;
      }
    }

    // What the band holds for, and that it does not hold for a slider that was moved.
    tellSureness(sure, moved) {
      const isDrawn = Boolean(sure?.head.label);
      const known = this.sure?.key === this.key;
      const told = known ? [...this.sure.head.sentences] : [];
      if (moved && isDrawn) told.unshift("The band lies around the values as loaded: it does not hold for the sliders.");
      else if (moved && this.sure?.head.label) told.splice(0, told.length, "No band: it holds for the values as loaded alone.");
      const [first = "", ...more] = told;
      const text = more.length ? `${first} ${more.length} more to know` : first;
      this.sureness.hidden = !told.length;
      this.sureness.classList.toggle("lab-alone", !more.length);
      if (this.sureSays.textContent === text) return; // a slider that is moved leaves it alone
      this.sureSays.textContent = text;
      this.sureMore.replaceChildren(...more.map((one) => make("li", {}, one)));
    }

    drawFrequency() {
      if (!this.shown) return;
      const name = this.output.value;
      const { factor } = OUTPUTS[name];
      const of = (arrays) => {
        if (!arrays) return { gain: [new Float64Array(), new Float64Array()], phase: [new Float64Array(), new Float64Array()] };
        const x = arrays.get("frequency").map(Math.log10);
        return { gain: [x, arrays.get(`gain.${name}`).map((value) => 20 * Math.log10(factor * value))], phase: [x, arrays.get(`phase.${name}`)] };
      };
      const [now, loaded] = [of(this.shown), of(this.loaded)];
      this.frequency.show("gain", [now.gain, loaded.gain]);
      this.frequency.show("phase", [now.phase, loaded.phase]);
      this.frequency.draw(...(this.frequency.zoom ?? this.frequency.extent()));
    }
  }

  return { View };
})();
window.LabSimulate = LabSimulate;
