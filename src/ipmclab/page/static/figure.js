// The figure of a plot as SVG: as it is shown, in the light colours, for it is going to stand on paper.
"use strict";

const LabFigure = (() => {
  // Of what is marked, as --lab-danger, --lab-warning and --lab-accent of the light theme.
  const MARKS = { error: "#b3261e", warning: "#8a5a00", info: "#00619a" };

  // Left of the numbers: the name of their panel, upright.
  const NAME = 18;
  const LEAST_RIGHT = 15;

  // numbers: the texts of ticks; roomOf: the room that texts of some widths have to the left of a plot. As on the screen.
  function svg(stack, palette, dashes, numbers, roomOf) {
    const width = 800;
    const beside = stack.plots.map(({ scales: { y } }) => ticksOf(y, 5, numbers));
    const left = NAME + roomOf(beside.flat().map(([, text]) => widthOf(text)));
    const { power } = stack.options.x;
    const whole = (values) => (power ? values.filter(Number.isInteger) : values);
    const below = stack.plots.length ? ticksOf(stack.plots[0].scales.x, 9, (values) => stack.xValues(null, values, true), whole) : [];
    const right = Math.max(LEAST_RIGHT, ...below.map(([, text]) => Math.ceil(widthOf(text) / 2) + 2));
    const high = 150;
    const gap = 14;
    const parts = [];
    const escape = (text) => String(text).replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);
    const text = (x, y, body, more = "") => parts.push(`<text x="${x}" y="${y}" ${more}>${escape(body)}</text>`);
    const count = stack.plots.length;
    const isEnd = (one) => one.style === "low" || one.style === "high";
    const lookOf = (one) => {
      if (isEnd(one)) return `fill="none" stroke="${palette[one.colour % 8]}" stroke-width="0.6"`;
      const dash = dashes[one.style]?.length ? ` stroke-dasharray="${dashes[one.style].join(" ")}"` : "";
      const pen = one.style === "points" ? 'stroke-width="3" stroke-linecap="round"' : `stroke-width="1.3"${dash}`;
      return `fill="none" stroke="${palette[one.colour % 8]}" ${pen}`;
    };
    const areaOf = (one) => `fill="${palette[one.colour % 8]}" fill-opacity="0.25"`;
    // A row a curve: names of runs are long, and begin where they have room beside the widest numbers too.
    const legend = NAME + roomOf([]);
    const named = [...stack.named().values()];
    named.forEach((one, row) => {
      const y = 14 + 16 * row;
      const sample = one.style === "points" ? `M${legend + 15} ${y}h0` : `M${legend} ${y}h30`;
      if (isEnd(one)) parts.push(`<rect x="${legend}" y="${y - 5}" width="30" height="10" ${areaOf(one)}/>`);
      else parts.push(`<path d="${sample}" ${lookOf(one)}/>`);
      text(legend + 38, y + 3.5, shortened(one.label, 105));
    });
    const head = 20 + 16 * named.length;
    stack.plots.forEach((plot, place) => {
      const panel = stack.options.panels[place];
      const top = head + place * (high + gap);
      const x = plot.scales.x;
      const y = plot.scales.y;
      const toX = (value) => left + ((value - x.min) / (x.max - x.min)) * (width - left - right);
      const toY = (value) => top + high - ((value - y.min) / (y.max - y.min)) * high;
      const frame = `<rect x="${left}" y="${top}" width="${width - left - right}" height="${high}"`;
      parts.push(`<clipPath id="p${place}">${frame}/></clipPath>`);
      for (const band of stack.bandsOf(panel)) {
        const begin = toX(band.begin);
        const rect = `<rect x="${begin.toFixed(1)}" y="${top}" width="${Math.max(toX(band.end) - begin, 2).toFixed(1)}"`;
        parts.push(
          `<g clip-path="url(#p${place})" fill="${MARKS[band.severity] ?? MARKS.info}"><title>${escape(band.label)}</title>` +
            `${rect} height="${high}" opacity="0.2"/>${rect} height="3"/></g>`,
        );
      }
      for (const [value, words] of beside[place]) {
        parts.push(`<path d="M${left} ${toY(value).toFixed(1)}H${width - right}" stroke="#d5dadf"/>`);
        text(left - 6, toY(value) + 3.5, words, 'text-anchor="end"');
      }
      for (const [value, words] of below) {
        parts.push(`<path d="M${toX(value).toFixed(1)} ${top}V${top + high}" stroke="#d5dadf"/>`);
        if (place === count - 1) text(toX(value), top + high + 15, words, 'text-anchor="middle"');
      }
      parts.push(`${frame} fill="none" stroke="#5f6973"/>`);
      const label = stack.titleOf(panel);
      text(0, 0, label, `transform="translate(14 ${top + high / 2}) rotate(-90)" text-anchor="middle"`);
      const curves = stack.data.get(panel.key);
      for (const [low, high] of stack.areas(panel)) {
        for (const points of outlines(curves[low], curves[high])) {
          const outline = points.map(([time, value]) => `${toX(time).toFixed(1)} ${toY(value).toFixed(1)}`);
          parts.push(`<path clip-path="url(#p${place})" d="M${outline.join("L")}Z" ${areaOf(panel.series[low])}/>`);
        }
      }
      curves.forEach(([time, values], which) => {
        const one = panel.series[which];
        const marks = [];
        let pen = false;
        for (let k = 0; k < time.length; k++) {
          if (!Number.isFinite(values[k])) {
            pen = false;
            continue;
          }
          const [px, py] = [toX(time[k]).toFixed(1), toY(values[k]).toFixed(1)];
          if (one.style === "points") marks.push(`M${px} ${py}h0`);
          else marks.push(`${pen ? "L" : "M"}${px} ${py}`);
          pen = true;
        }
        parts.push(`<path clip-path="url(#p${place})" d="${marks.join("")}" ${lookOf(one)}/>`);
      });
    });
    const height = head + count * (high + gap) + 25;
    text((width + left) / 2, height - 4, `${stack.options.x.label} [${stack.options.x.unit}]`, 'text-anchor="middle"');
    return (
      `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" ` +
      `font-family="system-ui, sans-serif" font-size="11" fill="#1c2126"><title>${escape(stack.options.name)}</title>` +
      `<rect width="${width}" height="${height}" fill="#ffffff"/>${parts.join("\n")}</svg>\n`
    );
  }

  // An area between its ends: along the upper one, and back along the lower; where there is no value, another begins.
  function outlines([lowTime, low], [highTime, high]) {
    const stretches = (time, values) => {
      const found = [[]];
      for (let k = 0; k < time.length; k++)
        if (Number.isFinite(values[k])) found.at(-1).push([time[k], values[k]]);
        else if (found.at(-1).length) found.push([]);
      return found.filter((one) => one.length);
    };
    const below = stretches(lowTime, low);
    return stretches(highTime, high).map((above, k) => [...above, ...(below[k] ?? []).toReversed()]);
  }

  const ruler = document.createElement("canvas").getContext("2d");

  // Of a text as the figure has it [px].
  function widthOf(text) {
    ruler.font = "11px system-ui, sans-serif";
    return ruler.measureText(text).width;
  }

  // Where an axis has its ticks, each with what is written there.
  function ticksOf({ min, max }, most, textsOf, chosen = (values) => values) {
    const values = chosen(ticks(min, max, most));
    const texts = textsOf(values);
    return values.map((value, k) => [value, texts[k]]);
  }

  function ticks(low, high, most) {
    const raw = (high - low) / most;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= raw);
    const found = [];
    for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    return found;
  }

  // A long text by its beginning and its end: that is where names of runs differ.
  function shortened(text, most) {
    if (text.length <= most) return text;
    const end = Math.floor((most - 1) / 3);
    return `${text.slice(0, most - 1 - end)}…${text.slice(-end)}`;
  }

  return { svg, shortened };
})();
window.LabFigure = LabFigure;
