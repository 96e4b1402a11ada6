// The figure of a plot as SVG: as it is shown, in the light colours, for it is going to stand on paper.
"use strict";

const LabFigure = (() => {
  function svg(stack, palette, dashes, number) {
    const width = 800;
    const left = 70;
    const right = 15;
    const high = 150;
    const gap = 14;
    const parts = [];
    const escape = (text) => String(text).replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);
    const text = (x, y, body, more = "") => parts.push(`<text x="${x}" y="${y}" ${more}>${escape(body)}</text>`);
    const count = stack.plots.length;
    stack.plots.forEach((plot, place) => {
      const panel = stack.options.panels[place];
      const top = 20 + place * (high + gap);
      const x = plot.scales.x;
      const y = plot.scales.y;
      const toX = (value) => left + ((value - x.min) / (x.max - x.min)) * (width - left - right);
      const toY = (value) => top + high - ((value - y.min) / (y.max - y.min)) * high;
      const frame = `<rect x="${left}" y="${top}" width="${width - left - right}" height="${high}"`;
      parts.push(`<clipPath id="p${place}">${frame}/></clipPath>`);
      for (const value of ticks(y.min, y.max, 5)) {
        parts.push(`<path d="M${left} ${toY(value).toFixed(1)}H${width - right}" stroke="#d5dadf"/>`);
        text(left - 6, toY(value) + 3.5, number(value), 'text-anchor="end"');
      }
      const { power } = stack.options.x;
      for (const value of power ? ticks(x.min, x.max, 9).filter(Number.isInteger) : ticks(x.min, x.max, 9)) {
        parts.push(`<path d="M${toX(value).toFixed(1)} ${top}V${top + high}" stroke="#d5dadf"/>`);
        if (place === count - 1) text(toX(value), top + high + 15, number(power ? 10 ** value : value, 6), 'text-anchor="middle"');
      }
      parts.push(`${frame} fill="none" stroke="#5f6973"/>`);
      const label = stack.titleOf(panel);
      text(0, 0, label, `transform="translate(14 ${top + high / 2}) rotate(-90)" text-anchor="middle"`);
      stack.data.get(panel.key).forEach(([time, values], which) => {
        const one = panel.series[which];
        const stroke = palette[one.colour % 8];
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
        const look = one.style === "points" ? 'stroke-width="3" stroke-linecap="round"' : 'stroke-width="1.3"';
        const dash = dashes[one.style]?.length ? `stroke-dasharray="${dashes[one.style].join(" ")}"` : "";
        parts.push(`<path clip-path="url(#p${place})" d="${marks.join("")}" fill="none" stroke="${stroke}" ${look} ${dash}/>`);
        if (panel.series.length > 1)
          text(left + 8 + 150 * which, top - 5, one.label, `fill="${stroke}"`);
      });
    });
    const height = 20 + count * (high + gap) + 25;
    text((width + left) / 2, height - 4, `${stack.options.x.label} [${stack.options.x.unit}]`, 'text-anchor="middle"');
    return (
      `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" ` +
      `font-family="system-ui, sans-serif" font-size="11" fill="#1c2126"><title>${escape(stack.options.name)}</title>` +
      `<rect width="${width}" height="${height}" fill="#ffffff"/>${parts.join("\n")}</svg>\n`
    );
  }

  function ticks(low, high, most) {
    const raw = (high - low) / most;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((one) => one >= raw);
    const found = [];
    for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    return found;
  }

  return { svg };
})();
window.LabFigure = LabFigure;
