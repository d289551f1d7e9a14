// The page: what it follows, the time that it shows, and when it draws. Drawing waits for the browser, and images are asked
// for one after another, so a slow page leaves out what it cannot show.
import { drawChannels, drawTimeline, rowAt, timeAt, watchSizes } from "./charts.js";
import { offer } from "./commands.js";
import { drawHead, listen } from "./head.js";
import { countedPieces, markPieces } from "./pieces.js";
import { number, of, show } from "./tables.js";

const MOST = 6000;
const SPANS = [["30 s", 30], ["1 min", 60], ["10 min", 600], ["all", Infinity]];
let about = null;
let rows = [];
let log = [];
// The time that is shown, s; none: the newest.
let chosen = null;
let points = new Float32Array(0);
// The pieces of the reference: [column, row], [x, y, z] or null, movement over its limit, state.
let pieces = [];
let image = 0;
let images = [];
let note = "";
let isOver = false;

const newest = () => rows.length ? rows[rows.length - 1].t : 0;
const now = () => chosen ?? newest();
const range = () => {
  const span = Number(of("span").value);
  const last = about.follows ? newest() : Math.max(newest(), about.seconds ?? 0);
  if (span === Infinity) return [rows.length ? Math.min(rows[0].t, 0) : 0, last];
  const to = chosen === null ? last : Math.min(last, chosen + span / 2);
  return [to - span, to];
};

// The head is drawn with each image; the charts, which cost ten times as much, every 250 ms.
const CHARTS = 250;
let isDirty = false;
let areChartsOld = false;
let charted = -Infinity;
let timer = null;
const draw = () => {
  if (isDirty) return;
  isDirty = true;
  requestAnimationFrame(() => {
    isDirty = false;
    const row = rows[rowAt(rows, now())] ?? rows[0];
    drawHead(of("head"), row, points, pieces, about.camera);
    if (!areChartsOld) return;
    [areChartsOld, charted] = [false, performance.now()];
    drawChannels(of("channels"), rows, range(), now());
    drawTimeline(of("timeline"), rows, log, range(), now(), about.words);
    of("image-note").textContent = note;
    marks(row);
  });
};
const drawAll = () => {
  clearTimeout(timer);
  timer = setTimeout(() => {
    areChartsOld = true;
    draw();
  }, charted + CHARTS - performance.now());
};

const words = (all, bits) => all.filter(([, bit]) => bits & bit).map(([word]) => word);
const code = (all, value) => all.find(([, known]) => known === value)?.[0] ?? "-";
const mark = (id, text, kind) => {
  of(id).textContent = text;
  of(id).className = `mark ${kind}`;
};
const marks = row => {
  const first = rows.length ? Math.min(0, rows[0].t) : 0;
  of("time").min = first;
  of("time").max = Math.max(newest(), about.follows ? 0 : about.seconds ?? 0, first + 0.01);
  of("time").value = now();
  of("clock").textContent = `${number(now(), 1)} s`;
  of("follow").disabled = chosen === null;
  if (!row) return;
  const state = code(about.words.states, row.valves);
  mark("beam", `beam ${row.beam === null ? "-" : row.beam ? "on" : "off"}`, row.beam ? "good" : "");
  mark("valves", `valves ${state}`, { armed: "good", fault: "bad" }[state] ?? "");
  const why = row.unproven ? ` (${code(about.words.unproven, row.unproven)})` : "";
  mark("tracker", `tracker ${code(about.words.tracker, row.tracker)}, reference ${code(about.words.proof, row.proof)}${why}`, "");
  const parts = [];
  const against = words(about.words.beam, row.reasons);
  const valves = words(about.words.valves, row.valves_reasons);
  const fault = words(about.words.valves, row.fault);
  if (row.beam === false && against.length) parts.push(`beam off: ${against.join(", ")}`);
  if (valves.length) parts.push(`valves: ${valves.join(", ")}`);
  if (fault.length) parts.push(`fault: ${fault.join(", ")}`);
  of("reasons").textContent = parts.join("; ");
};

const paint = buffer => {
  const view = new DataView(buffer);
  const length = view.getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const palette = new Uint8Array(buffer, 4 + length, 3 * head.colours);
  const count = head.width * head.height;
  const pixels = new Uint8Array(buffer, 4 + length + palette.length, count);
  const canvas = of("image");
  if (canvas.width !== head.width || canvas.height !== head.height) {
    [canvas.width, canvas.height] = [head.width, head.height];
    canvas.style.aspectRatio = `${head.width} / ${head.height}`;
  }
  const context = canvas.getContext("2d");
  const shown = context.createImageData(head.width, head.height);
  const whole = new Uint32Array(shown.data.buffer);
  const colour = new Uint32Array(head.colours);
  for (let i = 0; i < head.colours; i++) {
    colour[i] = 0xff000000 | palette[3 * i + 2] << 16 | palette[3 * i + 1] << 8 | palette[3 * i];
  }
  for (let i = 0; i < count; i++) whole[i] = colour[pixels[i]];
  context.putImageData(shown, 0, 0);
  const begin = 4 + length + palette.length + count;
  points = new Float32Array(buffer.slice(begin, begin + 12 * head.points));
  pieces = head.pieces;
  markPieces(context, pieces);
  image = head.number;
  const at = performance.now();
  images = [...images.filter(time => at - time < 2000), at];
  const rate = about.follows ? `${number(images.length / 2, 0)} images a second` : about.images;
  note = `${number(head.t, 2)} s, ${head.face ? "face" : "no face"}, ${rate}${countedPieces(pieces)}`;
  canvas.dataset.images = Number(canvas.dataset.images ?? 0) + 1;
  if (about.follows) draw(); else drawAll();
  return head;
};

const pause = ms => new Promise(done => setTimeout(done, ms));
const followImages = async () => {
  if (!about.image) {
    note = "the pipeline has no image of a face";
    drawAll();
    return;
  }
  let shown = null;
  while (!isOver) {
    const t = chosen ?? newest();
    if (document.hidden || (!about.follows && t === shown)) {
      await pause(50);
      continue;
    }
    try {
      const response = await fetch(about.follows ? `image?after=${image}` : `image?at=${t}`);
      if (response.status === 200) {
        const head = paint(await response.arrayBuffer());
        if (head.final) shown = t;
        else if (!about.follows) await pause(300);
      } else if (response.status !== 204) {
        note = await response.text();
        drawAll();
        await pause(1000);
      } else {
        if (!about.follows) note = `no image yet, ${about.images}`;
        drawAll();
        await pause(about.follows ? 20 : 500);
      }
    } catch {
      await pause(1000);
    }
  }
};

let asked = 0;
let sought = null;
// The figures and the graph of a time of a session; of a run, of now.
const seek = () => {
  charted = -Infinity;
  drawAll();
  if (about.follows) return;
  clearTimeout(sought);
  sought = setTimeout(async () => {
    const at = chosen === null ? "" : `?at=${chosen}`;
    const mine = ++asked;
    const state = await (await fetch(`state.json${at}`)).json();
    if (mine !== asked) return;
    take(state);
    of("graph").src = `graph.svg${at || `?whole=${mine}`}`;
  }, 150);
};
const choose = t => {
  chosen = t;
  seek();
};

let drawn = 0;
const take = state => {
  log = state.log;
  show(state);
  const of_what = about.of.session ? `session ${about.of.session}` : `run ${about.of.run}`;
  of("about").textContent = `${of_what}, figures over ${number(state.seconds, 1)} s${isOver ? ", the run has ended" : ""}`;
  if (about.follows && drawn++ % 4 === 0) of("graph").src = `graph.svg?n=${drawn}`;
  drawAll();
};

const begin = async () => {
  about = await (await fetch("about.json")).json();
  const spans = about.follows ? SPANS : [["all", Infinity], ...SPANS.slice(0, 3)];
  of("span").replaceChildren(...spans.map(([text, value]) => new Option(text, value)));
  if (about.follows) of("span").value = "60";
  of("span").addEventListener("change", drawAll);
  of("time").addEventListener("input", () => choose(Number(of("time").value)));
  of("follow").textContent = about.follows ? "follow" : "whole";
  of("follow").addEventListener("click", () => choose(null));
  of("timeline").addEventListener("pointerdown", event => choose(timeAt(of("timeline"), event.offsetX, range())));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  watchSizes([of("channels"), of("timeline"), of("head")], drawAll);
  listen(of("head"), draw);
  offer(about);
  const events = new EventSource("events");
  // A stream that begins again has all rows.
  events.onopen = () => { rows = []; };
  events.onmessage = message => take(JSON.parse(message.data));
  events.addEventListener("rows", message => {
    rows.push(...JSON.parse(message.data));
    if (about.follows && rows.length > MOST) rows.splice(0, rows.length - MOST);
    drawAll();
  });
  events.addEventListener("end", () => {
    events.close();
    isOver = about.follows;
    if (!of("about").textContent.includes("ended")) of("about").textContent += ", the run has ended";
    drawAll();
  });
  events.onerror = () => { if (!isOver) of("about").textContent = "no connection"; };
  followImages();
};
begin();
