// Channels against targets, and the timeline of beam, valves, tracker and log, on plain canvases.
const NAMES = ["x", "y", "z", "pitch", "roll", "yaw"];
const LANES = ["beam", "valves", "tracker", "log"];
const LEFT = 62;

// The colours of the page, which change with light and dark.
let known = null;
export const colours = () => {
  if (known) return known;
  const style = getComputedStyle(document.documentElement);
  const probe = document.createElement("span");
  document.body.append(probe);
  known = {};
  for (const name of ["ink", "quiet", "paper", "wash", "bad", "good", "line", "warm", "rule"]) {
    probe.style.color = `var(--${name})`;
    known[name] = getComputedStyle(probe).color || style.color;
  }
  probe.remove();
  return known;
};
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { known = null; });

// The sizes of canvases in CSS pixels. Asked for at each drawing, they would lay the page out each time.
const sizes = new Map();
export const watchSizes = (canvases, changed) => {
  const observer = new ResizeObserver(entries => {
    for (const { target, contentRect } of entries) sizes.set(target, [contentRect.width, contentRect.height]);
    changed();
  });
  for (const canvas of canvases) observer.observe(canvas);
};
const sizeOf = canvas => sizes.get(canvas) ?? [canvas.clientWidth, canvas.clientHeight];

// A canvas at the resolution of the screen; its context counts in CSS pixels.
export const fitted = (canvas, height) => {
  const scale = window.devicePixelRatio || 1;
  if (height) canvas.style.height = `${height}px`;
  const [w, h] = [sizeOf(canvas)[0], height ?? sizeOf(canvas)[1]];
  if (canvas.width !== Math.round(w * scale) || canvas.height !== Math.round(h * scale)) {
    canvas.width = Math.round(w * scale);
    canvas.height = Math.round(h * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, w, h);
  context.font = "12px system-ui, sans-serif";
  return [context, w, h];
};

// A round step of about this size.
const round = size => {
  const power = 10 ** Math.floor(Math.log10(size));
  return power * ([1, 2, 5, 10].find(part => part * power >= size) ?? 10);
};

// The number of the last row up to a time; -1 before the first.
export const rowAt = (rows, t) => {
  let [low, high] = [0, rows.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rows[middle].t <= t) low = middle + 1; else high = middle;
  }
  return low - 1;
};
const visible = (rows, from, to) => rows.slice(Math.max(0, rowAt(rows, from)), rowAt(rows, to) + 1);

const line = (context, points, style, dash) => {
  context.beginPath();
  context.strokeStyle = style;
  context.lineWidth = 1.5;
  context.setLineDash(dash);
  let isDown = false;
  for (const [x, y] of points) {
    if (y === null) { isDown = false; continue; }
    if (isDown) context.lineTo(x, y); else context.moveTo(x, y);
    isDown = true;
  }
  context.stroke();
  context.setLineDash([]);
};

// The channels that a target holds, or else all that are known.
const channelsOf = rows => {
  const has = key => NAMES.map((_, place) => place).filter(place => rows.some(row => row[key][place] !== null));
  const held = has("target");
  return held.length ? held : has("estimate");
};

export const drawChannels = (canvas, rows, [from, to], now) => {
  const shown = visible(rows, from, to);
  const channels = channelsOf(shown);
  const columns = sizeOf(canvas)[0] < 640 ? 1 : Math.min(3, Math.max(1, channels.length));
  const lines = Math.max(1, Math.ceil(channels.length / columns));
  const [context, w, h] = fitted(canvas, 150 * lines);
  const c = colours();
  context.fillStyle = c.quiet;
  if (!channels.length) context.fillText("no estimate of a head", 12, 24);
  channels.forEach((place, number) => {
    const [width, height] = [w / columns, h / lines];
    const [left, top] = [(number % columns) * width + LEFT, Math.floor(number / columns) * height + 22];
    const [inner, tall] = [width - LEFT - 12, height - 40];
    const scale = place < 3 ? 1e3 : 180 / Math.PI;
    const of = key => shown.map(row => row[key][place] === null ? null : row[key][place] * scale);
    const [estimate, target] = [of("estimate"), of("target")];
    const all = [...estimate, ...target].filter(value => value !== null);
    let [least, most] = [Math.min(...all), Math.max(...all)];
    const margin = Math.max((most - least) * 0.1, place < 3 ? 0.5 : 0.1);
    [least, most] = [least - margin, most + margin];
    const x = t => left + inner * (t - from) / Math.max(to - from, 1e-9);
    const y = value => value === null ? null : top + tall * (most - value) / (most - least);
    context.fillStyle = c.ink;
    context.textAlign = "left";
    context.fillText(`${NAMES[place]}, ${place < 3 ? "mm" : "deg"}`, left, top - 8);
    context.textAlign = "right";
    const step = round((most - least) / 5);
    for (let value = Math.ceil(least / step) * step; value <= most; value += step) {
      context.strokeStyle = c.rule;
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(left, y(value));
      context.lineTo(left + inner, y(value));
      context.stroke();
      context.fillStyle = c.quiet;
      context.fillText(value.toFixed(Math.max(0, -Math.floor(Math.log10(step)))), left - 6, y(value) + 4);
    }
    line(context, shown.map((row, i) => [x(row.t), y(target[i])]), c.warm, [6, 4]);
    line(context, shown.map((row, i) => [x(row.t), y(estimate[i])]), c.line, []);
    context.fillStyle = c.quiet;
    context.fillText(`${to.toFixed(0)} s`, left + inner, top + tall + 15);
    context.textAlign = "left";
    context.fillText(`${from.toFixed(0)} s`, left, top + tall + 15);
    mark(context, x(now), top, tall, left, inner);
  });
  canvas.dataset.channels = channels.map(place => NAMES[place]).join(" ");
};

// Where the time of the page is.
const mark = (context, x, top, tall, left, inner) => {
  if (x < left || x > left + inner) return;
  context.strokeStyle = colours().quiet;
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(x, top);
  context.lineTo(x, top + tall);
  context.stroke();
};

const word = (words, value) => words.find(([, code]) => code === value)?.[0];

export const drawTimeline = (canvas, rows, log, [from, to], now, words) => {
  const [context, w, h] = fitted(canvas);
  const c = colours();
  const shown = visible(rows, from, to);
  const x = t => LEFT + (w - LEFT - 12) * (t - from) / Math.max(to - from, 1e-9);
  const tall = (h - 20) / LANES.length;
  const kinds = { armed: c.good, holding: c.warm, venting: c.warm, fault: c.bad, disarmed: c.rule };
  const tracked = { captured: c.line, tracked: c.good, found: c.good };
  const colour = [
    row => row.beam === null ? null : row.beam ? c.good : c.rule,
    row => row.valves === null ? null : kinds[word(words.states, row.valves)] ?? c.rule,
    row => row.tracker === null ? null : tracked[word(words.tracker, row.tracker)] ?? c.warm,
  ];
  LANES.forEach((name, lane) => {
    const top = 6 + lane * tall;
    context.fillStyle = c.quiet;
    context.textAlign = "right";
    context.fillText(name, LEFT - 8, top + tall / 2 + 3);
    if (lane === 3) {
      for (const entry of log.filter(l => l.t >= from && l.t <= to)) {
        context.fillStyle = { error: c.bad, warn: c.warm }[entry.level] ?? c.quiet;
        context.fillRect(x(entry.t) - 1, top + 3, entry.level === "info" ? 1 : 3, tall - 6);
      }
      return;
    }
    shown.forEach((row, i) => {
      const fill = colour[lane](row);
      if (!fill) return;
      context.fillStyle = fill;
      const [begin, end] = [x(Math.max(row.t, from)), x(shown[i + 1]?.t ?? row.t)];
      context.fillRect(begin, top + 3, Math.max(end - begin, 1) + 0.5, tall - 6);
    });
  });
  context.fillStyle = c.quiet;
  context.textAlign = "left";
  context.fillText(`${from.toFixed(0)} s`, LEFT, h - 4);
  context.textAlign = "right";
  context.fillText(`${to.toFixed(0)} s`, w - 12, h - 4);
  mark(context, x(now), 6, h - 24, LEFT, w - LEFT - 12);
};

// The time under a place of the timeline.
export const timeAt = (canvas, place, [from, to]) => {
  const inner = sizeOf(canvas)[0] - LEFT - 12;
  return from + (to - from) * Math.min(1, Math.max(0, (place - LEFT) / inner));
};
