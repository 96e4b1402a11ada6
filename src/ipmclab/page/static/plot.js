// Plots against time, or another x: one panel a quantity, a shared cursor, zoom by drag and keys, SVG and CSV.
// Data come either from the live link or, thinned by the server, from a source that is asked again at every zoom.
"use strict";

const LabPlot = (() => {
  const PALETTES = {
    light: ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1c2126", "#7a8691"],
    dark: ["#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442", "#d55e00", "#e6eaee", "#8b97a2"],
  };
  // How a unit is written on a plot; files and their headings keep the word that can be read back.
  const UNITS = { degC: "°C", percent: "%" };
  // The least span of an axis: what a sensor does not resolve must not fill it.
  const LEAST = { degC: 0.5, percent: 1 };
  const unitOf = (panel) => UNITS[panel.unit] ?? panel.unit;
  // What the numbers of an axis have to its left edge and from its ticks [px], and what they have at least altogether.
  const BESIDE = 18;
  const LEAST_ROOM = 52;
  const roomOf = (widths) => Math.max(LEAST_ROOM, Math.ceil(Math.max(0, ...widths)) + BESIDE);
  const DASHES = { line: [], dashed: [8, 4], dotted: [2, 4] };
  const theme = () => (document.documentElement.dataset.theme === "dark" ? "dark" : "light");
  const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--lab-${name}`).trim();
  const colour = (series) => PALETTES[theme()][series.colour % 8];
  const number = (value, digits = 4) => {
    if (value === null || value === undefined || !Number.isFinite(value)) return "–";
    const text = value.toPrecision(digits);
    return Math.abs(value) >= 1e6 || (value !== 0 && Math.abs(value) < 1e-4) ? text : String(Number(text));
  };

  // One binary message of wire.py: {head, arrays: Map name -> Float64Array}.
  function unpack(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    let at = 4 + length;
    const arrays = new Map();
    for (const [name, count] of head.arrays) {
      arrays.set(name, new Float64Array(buffer, at, count));
      at += 8 * count;
    }
    return { head, arrays };
  }

  // A column that grows at its end and is cut at its beginning.
  class Column {
    constructor() {
      this.held = new Float64Array(8192);
      this.begin = this.end = 0;
    }
    get view() {
      return this.held.subarray(this.begin, this.end);
    }
    push(values, factor = 1) {
      if (this.end + values.length > this.held.length) {
        const live = this.view;
        const larger = live.length + values.length > this.held.length / 2 ? 2 * (live.length + values.length) : this.held.length;
        const held = larger === this.held.length ? this.held : new Float64Array(larger);
        held.set(live, 0); // set() copies as if from a clone, also within one array
        this.held = held;
        this.end = live.length;
        this.begin = 0;
      }
      for (let k = 0; k < values.length; k++) this.held[this.end + k] = values[k] * factor;
      this.end += values.length;
    }
    drop(count) {
      this.begin = Math.min(this.end, this.begin + count);
    }
    clear() {
      this.begin = this.end = 0;
    }
  }

  // Numbers of an axis with as many decimals as tell neighbours apart; what is large or small has its power of ten behind it.
  function distinct(splits) {
    const largest = Math.max(...splits.map(Math.abs));
    if (largest >= 1e-3 && largest < 1e6) return decimal(splits);
    if (!(largest > 0) || !Number.isFinite(largest)) return splits.map(String);
    const power = 3 * Math.floor(Math.log10(largest) / 3 + 1e-9);
    return decimal(splits.map((value) => value / 10 ** power)).map((text) => (Number(text) === 0 ? "0" : `${text}e${power}`));
  }

  function decimal(splits) {
    const step = Math.abs(splits[1] - splits[0]);
    if (!(step > 0)) return splits.map((value) => String(Number(value.toPrecision(9))));
    const decimals = Math.min(9, Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
    const shown = (digits) => splits.map((value) => value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1"));
    const texts = shown(decimals);
    // A step such as 0.25 needs one more.
    return splits.every((value, k) => Math.abs(Number(texts[k]) - value) < 1e-3 * step) ? texts : shown(decimals + 1);
  }

  // NaN is no reading: uPlot leaves a gap at null only.
  const gaps = (values) => {
    let any = false;
    for (let k = 0; k < values.length && !any; k++) any = values[k] !== values[k];
    return any ? Array.from(values, (value) => (value === value ? value : null)) : values;
  };

  // Of each half of a pixel's width the lowest and the highest point, in their order, and every gap: nobody sees more. What stays
  // the same is kept from its begin to its end: a jump stays upright. The halves are counted from time 0, so that they stay while a
  // curve runs. across: pixels a unit of time.
  function seen(time, values, [first, last], across) {
    const kept = [];
    let begin = first, low = first, high = first, half = null;
    const keep = () => {
      if (half === null) return;
      const [one, other] = low === high ? [begin, low] : low < high ? [low, high] : [high, low];
      kept.push(one);
      if (other > one) kept.push(other);
    };
    for (let k = first; k <= last; k++) {
      const value = values[k];
      const now = value === null ? null : Math.floor(2 * across * time[k]);
      if (now === null || now !== half) {
        keep();
        if (now !== null && now - half > 1 && k - 1 > (kept.at(-1) ?? k)) kept.push(k - 1); // before a pause: where it was
        if (now === null) kept.push(k);
        begin = low = high = k;
        half = now;
      } else if (value < values[low]) low = k;
      else if (value > values[high]) high = k;
      else if (low === high) low = high = k;
    }
    keep();
    return kept;
  }

  // What is drawn on it next stays within the axes, until it is restored.
  function inside({ ctx, bbox }) {
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    return ctx;
  }

  // A curve in pieces: without a graphics card a browser takes three times as long for one path of thousands of points that go up
  // and down. Each begins where the one before ends; round ends join them. uPlot's own thinning needs whole pixels.
  const PIECE = 100; // points
  const LONGEST_FRAME = 250; // ms that drawing may take at most
  function piecesOf(plot, place, first, last) {
    const { bbox, data: [time], scales: { x, y } } = plot;
    const values = plot.data[place];
    const across = bbox.width / (x.max - x.min);
    const up = bbox.height / (y.max - y.min);
    const pieces = [];
    const put = (k) => pieces.at(-1).lineTo(bbox.left + (time[k] - x.min) * across, bbox.top + (y.max - values[k]) * up);
    let count = 0; // points of the last piece; 0 behind a gap
    seen(time, values, [first, last], across).forEach((k, at, kept) => {
      if (values[k] === null) count = 0;
      else {
        if (count % PIECE === 0) {
          pieces.push(new Path2D());
          if (count) put(kept[at - 1]);
        }
        put(k);
        count++;
      }
    });
    return pieces;
  }

  // Of the two ends of an area: one line of the legend names both.
  const nameOf = (one) => (one.style === "low" || one.style === "high" ? `${one.label}, ${one.style}` : one.label);

  class Stack {
    // A series of the style "low" and the next one, "high", are the ends of an area.
    // options: name, panels [{key, label, unit, factor, series: [{key, label, colour, style}]}], source, live, bands, height,
    // x {label, symbol, unit, power}; with power the x of curves is a decimal logarithm. Without live and source: show() and draw().
    constructor(host, options) {
      this.host = host;
      this.options = { height: 130, bands: [], x: { label: "time", symbol: "t", unit: "s" }, ...options };
      this.zoom = null;
      this.plots = [];
      this.asked = 0;
      this.shown = 0;
      this.frame = 0;
      this.rest = 0;
      this.turn = 0;
      this.lastDrawn = null;
      this.build();
      this.observer = new ResizeObserver(() => this.resize());
      this.observer.observe(this.panels);
      this.themed = new MutationObserver(() => this.plots.forEach((plot) => plot.redraw(false, true)));
      this.themed.observe(document.documentElement, { attributes: true, attributeFilter: ["data-theme"] });
      if (this.options.live) window.lab.follow(this);
      else if (this.options.source) this.refresh();
    }

    destroy() {
      if (this.options.live) window.lab?.unfollow(this);
      this.observer.disconnect();
      this.themed.disconnect();
      cancelAnimationFrame(this.frame);
      this.plots.forEach((plot) => plot.destroy());
      this.plots = [];
    }

    build() {
      const { name } = this.options;
      this.host.classList.add("lab-stack");
      this.host.classList.toggle("lab-live", Boolean(this.options.live));
      this.bar = document.createElement("div");
      this.bar.className = "lab-stack-bar";
      this.panels = document.createElement("div");
      this.panels.className = "lab-stack-panels";
      this.panels.tabIndex = 0;
      this.panels.setAttribute("role", "img");
      this.panels.addEventListener("keydown", (event) => this.key(event));
      this.panels.addEventListener("mousemove", () => (this.isKeyed = false), true);
      this.readout = document.createElement("output");
      this.readout.className = "lab-stack-readout";
      const button = (text, title, act) => {
        const made = document.createElement("button");
        Object.assign(made, { type: "button", textContent: text, title });
        made.setAttribute("aria-label", `${title}: ${name}`);
        made.addEventListener("click", act);
        return made;
      };
      this.all = button("Whole", "Show all of the time", () => this.setZoom(null));
      this.all.hidden = true;
      if (this.options.live) this.bar.append(this.windowChoice());
      this.bar.append(
        this.readout,
        this.all,
        button("SVG", "Save the figure as it is shown", () => this.saveSvg()),
        button("CSV", "Save the data, all rows", () => this.saveCsv()),
      );
      this.host.replaceChildren(this.bar, this.panels);
      this.makePlots();
    }

    windowChoice() {
      const choice = document.createElement("select");
      choice.setAttribute("aria-label", `Time shown: ${this.options.name}`);
      for (const [value, text] of [["30", "last 30 s"], ["60", "last 60 s"], ["whole", "whole run"]])
        choice.add(new Option(text, value));
      choice.value = this.options.window ?? "60";
      choice.addEventListener("change", () => {
        this.zoom = null;
        this.all.hidden = true;
        window.lab.view(this.view());
      });
      this.choice = choice;
      return choice;
    }

    // What a live stack wants to be sent.
    view() {
      if (this.zoom || this.choice.value === "whole")
        return { view: "whole", begin: this.zoom?.[0] ?? null, end: this.zoom?.[1] ?? null, points: this.points() };
      return { view: "window", seconds: Number(this.choice.value) };
    }

    points() {
      return Math.max(400, Math.min(4000, 2 * Math.round(this.panels.clientWidth)));
    }

    describe() {
      const quantities = this.options.panels.map((panel) => panel.label).join(", ");
      this.panels.setAttribute(
        "aria-label",
        `${this.options.name}: ${quantities || "no quantity"} against ${this.options.x.label}. ` +
          "Left and right move the cursor, plus and minus zoom, 0 shows all.",
      );
    }

    makePlots() {
      this.plots.forEach((plot) => plot.destroy());
      this.panels.replaceChildren();
      this.turn = 0;
      this.room = LEAST_ROOM;
      this.data = new Map();
      const sync = { key: `lab-${Math.random()}`, setSeries: false, scales: ["x", null] };
      const count = this.options.panels.length;
      this.plots = this.options.panels.map((panel, place) => {
        const last = place === count - 1;
        this.data.set(panel.key, panel.series.map(() => [new Float64Array(), new Float64Array()]));
        const grid = { stroke: () => ink("rule"), width: 1 };
        const axis = { stroke: () => ink("muted"), grid, ticks: grid, font: "11px system-ui", labelFont: "12px system-ui" };
        const options = {
          width: Math.max(this.panels.clientWidth, 200),
          height: this.heightOf(place),
          legend: { show: false },
          padding: [18, 12, 0, 0],
          cursor: { sync, drag: { x: true, y: false, setScale: false }, points: { size: 5 }, y: false },
          scales: { x: { time: false }, y: { range: (_, low, high) => this.range(panel, low, high) } },
          axes: [
            { ...axis, size: last ? 24 : 8, values: (plot, splits) => this.xValues(plot, splits, last), incrs: this.options.x.power ? [1] : undefined,
              label: last ? `${this.options.x.label} [${this.options.x.unit}]` : undefined, labelSize: 18, ticks: { ...grid, size: last ? 5 : 0 } },
            { ...axis, size: (plot, texts) => this.roomFor(plot, texts), space: 20, values: (_, splits) => distinct(splits) },
          ],
          series: [{}, ...panel.series.map((one) => this.seriesOptions(one))],
          bands: this.areas(panel).map(([low, high]) => ({ series: [high + 1, low + 1], fill: () => `${colour(panel.series[low])}40` })),
          hooks: {
            setSelect: [(plot) => this.selected(plot)],
            setCursor: [(plot) => this.moved(plot)],
            draw: [(plot) => this.pin(plot)],
            drawAxes: [(plot) => this.drawBands(plot), (plot) => this.drawName(plot, panel)],
            drawSeries: this.options.live ? [(plot, place) => this.drawPieces(plot, place)] : [],
          },
        };
        const plot = new uPlot(options, [[], ...panel.series.map(() => [])], this.panels);
        plot.over.addEventListener("dblclick", () => this.setZoom(null));
        return plot;
      });
      this.describe();
      this.legend();
    }

    // Room [px] for the numbers beside an axis: that of the longest, and the same on all panels, for they share their x.
    roomFor(plot, texts) {
      plot.ctx.save();
      plot.ctx.font = `${11 * devicePixelRatio}px system-ui`;
      const needed = roomOf((texts ?? []).map((text) => plot.ctx.measureText(text).width / devicePixelRatio));
      plot.ctx.restore();
      if (needed > this.room) {
        this.room = needed; // it stays: curves that run would jump to and fro
        // With its paths: they are of where the axis was before.
        queueMicrotask(() => this.plots.forEach((one) => one !== plot && one.redraw(true, true)));
      }
      return this.room;
    }

    // Places of the series between which an area lies.
    areas(panel) {
      return panel.series.flatMap((one, place) => (one.style === "low" ? [[place, place + 1]] : []));
    }

    seriesOptions(one) {
      const points = one.style === "points";
      const end = one.style === "low" || one.style === "high";
      return {
        label: one.label,
        stroke: () => (end ? `${colour(one)}90` : colour(one)),
        width: points ? 0 : end ? 1 : 1.5,
        dash: DASHES[one.style] ?? [],
        pxAlign: 0, // a slow drift on whole pixels would look like steps of a converter
        paths: points ? () => null : this.options.live ? (...asked) => ({ pieces: piecesOf(...asked) }) : undefined,
        points: { show: points, size: 3, fill: () => colour(one) },
        spanGaps: false,
      };
    }

    // The curves that a legend has to tell apart, by their names.
    named() {
      const names = new Map();
      for (const panel of this.options.panels)
        for (const one of panel.series) if (panel.series.length > 1 || one.named) names.set(one.label, one);
      return names;
    }

    bandsOf(panel) {
      return this.options.bands.filter((band) => !band.channel || band.channel === panel?.key);
    }

    legend() {
      const names = this.named();
      this.host.querySelector(".lab-stack-legend")?.remove();
      if (!names.size) return;
      const list = document.createElement("ul");
      list.className = "lab-stack-legend";
      list.setAttribute("aria-label", "Curves");
      for (const one of names.values()) {
        const item = document.createElement("li");
        item.dataset.colour = one.colour % 8;
        item.dataset.style = one.style ?? "line";
        item.textContent = one.label;
        list.append(item);
      }
      this.bar.after(list);
    }

    range(panel, low, high) {
      if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
      const least = panel.least ?? LEAST[panel.unit] ?? 0;
      const span = Math.max(high - low, least, Math.abs(high) * 1e-6, 1e-12);
      const middle = (low + high) / 2;
      return [middle - 0.56 * span, middle + 0.56 * span];
    }

    resize() {
      const width = Math.max(this.panels.clientWidth, 200);
      this.plots.forEach((plot, place) => {
        const height = this.heightOf(place);
        if (plot.width !== width || plot.height !== height) plot.setSize({ width, height });
      });
      // What was fetched while it was hidden, or narrow, has too few points for this width.
      if (this.options.source && !this.options.live && this.fetched && this.points() > 1.2 * this.fetched) this.refresh();
    }

    // ---- data

    setPanels(panels) {
      if (JSON.stringify(panels) === JSON.stringify(this.options.panels)) return;
      this.options.panels = panels;
      this.makePlots();
    }

    // Other curves; the zoom stays where the panels do.
    change({ panels, source, bands }) {
      if (JSON.stringify(panels) !== JSON.stringify(this.options.panels)) {
        this.zoom = null;
        this.all.hidden = true;
        this.setPanels(panels);
      }
      Object.assign(this.options, { source, bands });
      if (source) this.refresh();
      else this.plots.forEach((plot) => plot.setData([[], ...plot.series.slice(1).map(() => [])]));
    }

    // curves: of each panel, of each series, [time, values] in display units
    show(key, curves) {
      this.data.set(key, curves);
    }

    draw(begin, end) {
      const before = performance.now();
      this.plots.forEach((_, place) => this.drawPanel(place, begin, end));
      // Behind this frame: the browser itself draws what was asked only then, and that takes the most of it.
      // What else keeps the page busy behind it for longer is no drawing.
      setTimeout(() => (this.rest = performance.now() + 3 * Math.min(performance.now() - before, LONGEST_FRAME)));
    }

    drawPanel(place, begin, end) {
      const plot = this.plots[place];
      const curves = this.data.get(this.options.panels[place].key);
      const same = curves.every(([time]) => time === curves[0][0]);
      const data = same
        ? [curves[0][0], ...curves.map(([, values]) => gaps(values))]
        : uPlot.join(curves.map(([time, values]) => [time, gaps(values)]), curves.map(() => [2]));
      plot.batch(() => {
        plot.setData(data, false);
        plot.setScale("x", { min: begin, max: end });
      });
    }

    xValues(plot, splits, last) {
      if (!last) return splits.map(() => "");
      return splits.map((value) => (this.options.x.power ? String(Number((10 ** value).toPrecision(3))) : String(Number(value.toPrecision(9)))));
    }

    // The first and the last time of all curves.
    extent() {
      let begin = Infinity;
      let end = -Infinity;
      for (const curves of this.data.values())
        for (const [time] of curves)
          if (time.length) {
            begin = Math.min(begin, time[0]);
            end = Math.max(end, time[time.length - 1]);
          }
      return begin < end ? [begin, end] : Number.isFinite(begin) ? [begin, begin + 1] : [0, 1];
    }

    // From where to where there is anything at all, also while less is shown.
    whole() {
      if (!this.options.live) return (this.options.source && this.source?.whole) || this.extent();
      return [0, Math.max((this.wholeRun ? this.end : this.time?.held[this.time.end - 1]) ?? 0, 1)];
    }

    // A zoom as near as there is something to see; null where that is all of it.
    within(zoom) {
      const [first, last] = this.whole();
      if (!zoom || zoom[1] - zoom[0] >= last - first) return null;
      const by = Math.max(first - zoom[0], 0) - Math.max(zoom[1] - last, 0);
      return zoom.map((end) => end + by);
    }

    // Ask the source; what was asked last is shown, never an older answer.
    async refresh() {
      const asked = ++this.asked;
      this.fetched = this.points();
      const query = new URLSearchParams({ points: this.fetched });
      if (this.zoom) {
        query.set("begin", this.zoom[0]);
        query.set("end", this.zoom[1]);
      }
      let answer;
      try {
        answer = await fetch(`${this.options.source}?${query}`);
        if (!answer.ok) throw new Error((await answer.text()).slice(0, 300));
      } catch (error) {
        if (asked === this.asked) this.say(`the curves could not be read: ${error.message}`);
        return;
      }
      const { head, arrays } = unpack(await answer.arrayBuffer());
      if (asked < this.shown) return;
      this.shown = asked;
      this.source = head;
      for (const panel of this.options.panels)
        this.show(
          panel.key,
          panel.series.map((one) => [
            arrays.get(`${one.key}.time`) ?? new Float64Array(),
            (arrays.get(`${one.key}.value`) ?? new Float64Array()).map((value) => value * panel.factor),
          ]),
        );
      const [begin, end] = this.zoom ?? this.extent();
      this.draw(begin, end);
      this.host.dataset.shown = String(asked);
    }

    // ---- live: the link hands frames on

    taken(frame) {
      const { head, arrays } = frame;
      const panels = head.panels;
      if (panels) this.setPanels(panels);
      if (head.kind === "rows") {
        if (head.fresh || head.generation !== this.generation || head.first !== this.next) {
          this.columns = new Map(head.channels.map((name) => [name, new Column()]));
          this.time = new Column();
          this.generation = head.generation;
        }
        this.next = head.first + head.count;
        this.time.push(arrays.get("time"));
        for (const panel of this.options.panels) this.columns.get(panel.key)?.push(arrays.get(panel.key), panel.factor);
        const seconds = Number(this.choice.value) || 60;
        const now = this.time.held[this.time.end - 1];
        let old = 0;
        const times = this.time.view;
        while (old < times.length && times[old] < now - seconds - 1) old++;
        this.time.drop(old);
        this.columns.forEach((column) => column.drop(old));
        this.wholeRun = false;
      } else {
        this.next = -1;
        this.wholeRun = true;
        for (const panel of this.options.panels) {
          const values = arrays.get(`${panel.key}.value`);
          if (values) this.show(panel.key, [[arrays.get(`${panel.key}.time`), values.map((value) => value * panel.factor)]]);
        }
        this.end = head.end;
      }
      this.now = head.now;
      this.dirty = true;
      if (!this.frame) this.frame = requestAnimationFrame(() => this.animate());
    }

    // At most one redraw a frame, and three parts of rest for one of work, so that buttons stay quick.
    animate() {
      this.frame = 0;
      if (!this.dirty) return;
      if (performance.now() < this.rest || document.hidden) {
        this.frame = requestAnimationFrame(() => this.animate());
        return;
      }
      this.dirty = false;
      if (this.wholeRun) {
        // One panel a frame: the cursor stays at the pace of the screen.
        const [begin, end] = this.zoom ?? [0, Math.max(this.end, 1)];
        this.drawPanel(this.turn, begin, end);
        this.turn = (this.turn + 1) % this.plots.length;
        if (this.turn) {
          this.dirty = true;
          this.frame = requestAnimationFrame(() => this.animate());
          return;
        }
      } else if (this.time) {
        const time = this.time.view;
        for (const panel of this.options.panels) this.show(panel.key, [[time, this.columns.get(panel.key).view]]);
        const seconds = Number(this.choice.value) || 60;
        const end = time.length ? time[time.length - 1] : 0;
        this.draw(Math.max(0, end - seconds), Math.max(end, seconds));
      }
      this.lastDrawn = this.now;
      this.host.dataset.drawn = String(this.now);
    }

    // ---- cursor, zoom, keys

    selected(plot) {
      const { left, width } = plot.select;
      if (width < 4) return;
      const zoom = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
      plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      this.setZoom(zoom);
    }

    setZoom(wanted) {
      const zoom = (this.zoom = this.within(wanted));
      this.all.hidden = zoom === null;
      if (this.options.live) window.lab.view(this.view());
      else if (this.options.source) {
        if (zoom) this.draw(...zoom); // at once with what is here, then with what the server has
        this.refresh();
      } else this.draw(...(zoom ?? this.extent()));
    }

    // Whether the keys put the cursor at a time: there it stays when curves are drawn anew, until the mouse moves it.
    get isPinned() {
      return this.isKeyed && !(this.options.live && !this.zoom);
    }

    pin(plot) {
      if (this.isPinned) plot.setCursor({ left: plot.valToPos(this.at, "x"), top: 10 }, false);
    }

    moved(plot) {
      if (this.isPinned || plot !== this.plots.find((one) => one.cursor.left >= 0)) return;
      this.at = plot.posToVal(plot.cursor.left, "x");
      this.tell();
    }

    tell() {
      if (this.at === undefined) return;
      const { symbol, unit, power } = this.options.x;
      const parts = [`${symbol} = ${number(power ? 10 ** this.at : this.at, power ? 4 : 6)} ${unit}`];
      this.options.panels.forEach((panel) => {
        this.data.get(panel.key).forEach(([time, values], place) => {
          if (!time.length || this.at < time[0] || this.at > time[time.length - 1]) return;
          const name = panel.series.length > 1 ? `${panel.label} (${nameOf(panel.series[place])})` : panel.label;
          parts.push(`${name} ${number(values[nearest(time, this.at)])} ${unitOf(panel)}`.trim());
        });
      });
      for (const band of this.options.bands) if (this.at >= band.begin && this.at <= band.end) parts.push(band.label);
      this.say(parts.join("  ·  "));
    }

    say(text) {
      this.readout.textContent = text;
    }

    key(event) {
      const plot = this.plots[0];
      if (!plot) return;
      const { min, max } = plot.scales.x;
      const at = Math.min(Math.max(this.at ?? Math.min(this.extent()[1], max), min), max);
      const span = max - min;
      const steps = { ArrowLeft: -span / 100, ArrowRight: span / 100, PageDown: -span / 10, PageUp: span / 10 };
      if (!(event.key in steps || ["Home", "End", "+", "=", "-", "0"].includes(event.key))) return;
      event.preventDefault();
      this.isKeyed = true;
      this.at = at;
      if (event.key in steps) this.at = Math.min(Math.max(at + steps[event.key], min), max);
      else if (event.key === "Home") this.at = min;
      else if (event.key === "End") this.at = max;
      else if (event.key === "-") this.setZoom([at - span, at + span]);
      else if (event.key === "0") this.setZoom(null);
      else this.setZoom([at - span / 4, at + span / 4]);
      const left = plot.valToPos(this.at, "x");
      this.plots.forEach((one) => one.setCursor({ left, top: 10 }, false));
      this.tell();
    }

    heightOf(place) {
      const own = this.options.panels[place].small ? Math.min(76, this.options.height) : this.options.height;
      return own + (place === this.options.panels.length - 1 ? 34 : 0);
    }

    // Above the panel: beside the axis a long name would not fit a low one.
    titleOf(panel) {
      return panel.unit ? `${panel.label} [${unitOf(panel)}]` : panel.label;
    }

    drawName(plot, panel) {
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.font = `600 ${11 * devicePixelRatio}px system-ui`;
      ctx.fillStyle = ink("muted");
      ctx.textAlign = "left";
      ctx.textBaseline = "bottom";
      ctx.fillText(this.titleOf(panel), bbox.left, bbox.top - 4 * devicePixelRatio);
      ctx.restore();
    }

    drawPieces(plot, place) {
      const ctx = inside(plot);
      const { stroke, width, dash, _paths } = plot.series[place];
      ctx.strokeStyle = stroke(plot, place);
      ctx.lineWidth = width * devicePixelRatio;
      ctx.lineJoin = ctx.lineCap = "round";
      ctx.setLineDash(dash ?? []);
      for (const piece of _paths?.pieces ?? []) ctx.stroke(piece);
      ctx.restore();
    }

    drawBands(plot) {
      const { bbox } = plot;
      const ctx = inside(plot);
      for (const band of this.bandsOf(this.options.panels[this.plots.indexOf(plot)])) {
        const left = plot.valToPos(band.begin, "x", true);
        const width = Math.max(plot.valToPos(band.end, "x", true) - left, 2 * devicePixelRatio);
        ctx.globalAlpha = 0.2;
        ctx.fillStyle = ink(band.severity === "error" ? "danger" : band.severity === "warning" ? "warning" : "accent");
        ctx.fillRect(left, bbox.top, width, bbox.height);
        ctx.globalAlpha = 1;
        ctx.fillRect(left, bbox.top, width, 3 * devicePixelRatio);
      }
      ctx.restore();
    }

    // ---- saving

    saveSvg() {
      save(new Blob([LabFigure.svg(this, PALETTES.light, DASHES, distinct, roomOf)], { type: "image/svg+xml" }), `${fileName(this.options.name)}.svg`);
    }

    saveCsv() {
      if (!this.options.live && !this.options.source) {
        save(new Blob([this.csv()], { type: "text/csv" }), `${fileName(this.options.name)}.csv`);
        return;
      }
      const source = this.options.live ? "/live/readings" : this.options.source;
      const link = document.createElement("a");
      link.href = `${source}?csv=${encodeURIComponent(fileName(this.options.name))}`;
      link.download = `${fileName(this.options.name)}.csv`;
      link.click();
    }

    // What is here: curves over the same x share a table.
    csv() {
      const { label, unit, power } = this.options.x;
      const tables = new Map();
      for (const panel of this.options.panels)
        this.data.get(panel.key).forEach(([x, values], place) => {
          if (!tables.has(x)) tables.set(x, []);
          const name = panel.series.length > 1 ? `${panel.label} ${nameOf(panel.series[place])}` : panel.label;
          tables.get(x).push([`${name} [${panel.unit}]`, values]);
        });
      const cell = (value) => (Number.isFinite(value) ? String(Number(value.toPrecision(10))) : "");
      return [...tables]
        .filter(([x]) => x.length)
        .map(([x, columns]) => {
          const rows = [[`${label} [${unit}]`, ...columns.map(([name]) => (name.includes(",") ? `"${name}"` : name))]];
          for (let k = 0; k < x.length; k++)
            rows.push([cell(power ? 10 ** x[k] : x[k]), ...columns.map(([, values]) => cell(values[k]))]);
          return rows.map((row) => row.join(",")).join("\n") + "\n";
        })
        .join("\n");
    }
  }

  function nearest(time, at) {
    let low = 0;
    let high = time.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (time[middle] < at) low = middle;
      else high = middle;
    }
    return at - time[low] < time[high] - at ? low : high;
  }

  // With its ending no longer than 80 characters, whatever is compared.
  const fileName = (name) => LabFigure.shortened(name.replace(/[^\w.+-]+/g, "_"), 75).replace("…", "__") || "plot";

  function save(blob, name) {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  return { Stack, unpack, number, save };
})();
window.LabPlot = LabPlot;
