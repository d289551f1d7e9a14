// The head in the couch's frame, seen from a place that the pointer chooses: the points of the face, the same points where
// the target has them, the pieces of the reference, the axes of estimate and target, the camera, and the couch.
import { colours, fitted } from "./charts.js";
import { colourOf } from "./pieces.js";

const LENGTH = 0.06;
let [turn, tilt] = [-0.6, 0.5];

export const listen = (canvas, changed) => {
  let from = null;
  canvas.addEventListener("pointerdown", event => {
    from = [event.clientX, event.clientY, turn, tilt];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", event => {
    if (!from) return;
    turn = from[2] + (event.clientX - from[0]) * 0.01;
    tilt = Math.min(1.55, Math.max(-0.2, from[3] + (event.clientY - from[1]) * 0.01));
    changed();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { from = null; });
};

// R = Rz(yaw) Ry(roll) Rx(pitch), row by row.
export const rotation = ([pitch, roll, yaw]) => {
  const [sx, cx, sy, cy, sz, cz] = [pitch, roll, yaw].flatMap(a => [Math.sin(a), Math.cos(a)]);
  return [
    cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx,
    sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx,
    -sy, cy * sx, cy * cx];
};
const times = (m, [x, y, z]) =>
  [m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z];
const sum = (a, b) => a.map((value, i) => value + b[i]);
const less = (a, b) => a.map((value, i) => value - b[i]);
const product = (a, b) => [0, 1, 2].flatMap(row => [0, 1, 2].map(column =>
  a[3 * row] * b[column] + a[3 * row + 1] * b[3 + column] + a[3 * row + 2] * b[6 + column]));
const transposed = m => [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];

// A pose of six numbers; those of `other` where it has none. None where a number is not known.
const pose = (six, other) => {
  const all = six.map((value, i) => value ?? other?.[i] ?? null);
  return all.includes(null) ? null : { at: all.slice(0, 3), m: rotation(all.slice(3)) };
};

export const drawHead = (canvas, row, points, pieces, camera) => {
  const [context, w, h] = fitted(canvas);
  const c = colours();
  const estimate = row && pose(row.estimate);
  const target = row && row.target.some(value => value !== null) && pose(row.target, row.estimate);
  const middle = estimate ? estimate.at : centre(points) ?? [0, 0, 0.1];
  // The couch and a part of the way to the camera are in the picture.
  const scale = Math.min(w, h) / 0.42;
  const [st, ct, si, ci] = [Math.sin(turn), Math.cos(turn), Math.sin(tilt), Math.cos(tilt)];
  // Across, down (CSS pixels) and away from the eye (m). From above at a tilt of a quarter turn; z is up.
  const view = [scale * ct, -scale * st, 0, -scale * si * st, -scale * si * ct, -scale * ci, ci * st, ci * ct, -si];
  const origin = less([w / 2, h / 2, 0], times(view, middle));
  const seen = p => sum(times(view, p), origin);
  const draw = (a, b, style, width = 1, dash = []) => {
    const [p, q] = [seen(a), seen(b)];
    context.strokeStyle = style;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.beginPath();
    context.moveTo(p[0], p[1]);
    context.lineTo(q[0], q[1]);
    context.stroke();
    context.setLineDash([]);
  };
  const axes = ({ at, m }, width, dash) => [c.bad, c.good, c.line].forEach((style, axis) => {
    const tip = [0, 0, 0];
    tip[axis] = LENGTH;
    draw(at, sum(at, times(m, tip)), style, width, dash);
  });
  const grid = 0.05;
  const floor = [Math.round(middle[0] / grid) * grid, Math.round(middle[1] / grid) * grid];
  for (let i = -4; i <= 4; i++) {
    draw([floor[0] + i * grid, floor[1] - 4 * grid, 0], [floor[0] + i * grid, floor[1] + 4 * grid, 0], c.rule);
    draw([floor[0] - 4 * grid, floor[1] + i * grid, 0], [floor[0] + 4 * grid, floor[1] + i * grid, 0], c.rule);
  }
  if (points.length) {
    const clouds = [[view, origin, c.ink, 191]];
    if (estimate && target) {
      const m = product(target.m, transposed(estimate.m));
      const moved = sum(times(view, less(target.at, times(m, estimate.at))), origin);
      clouds.unshift([product(view, m), moved, c.warm, 64]);
    }
    dots(context, points, clouds);
  } else {
    if (estimate) wire(draw, estimate, c.ink);
    if (target) wire(draw, target, c.warm);
  }
  for (const piece of pieces.filter(([, place]) => place)) {
    const [x, y] = seen(piece[1]);
    context.fillStyle = colourOf(piece);
    context.fillRect(x - 1.5, y - 1.5, 3, 3);
  }
  if (target) axes(target, 1.5, [5, 4]);
  if (estimate) axes(estimate, 3, []);
  if (camera) frustum(draw, camera, middle, c.quiet, seen, context);
  context.fillStyle = c.quiet;
  const text = !estimate ? "no estimate" : points.length ? "" : "no face: an ellipsoid stands for the head";
  context.fillText(text, 10, h - 10);
  canvas.dataset.points = points.length / 3;
};

const centre = points => {
  if (!points.length) return null;
  const all = [0, 0, 0];
  for (let i = 0; i < points.length; i++) all[i % 3] += points[i];
  return all.map(value => value * 3 / points.length);
};

// Points as each cloud places them, the last on top; nearer ones are larger. They are set pixel by pixel: thousands of
// rectangles a picture are more than a browser without a graphics card draws in time.
const layer = document.createElement("canvas");
const dots = (context, points, clouds) => {
  const { width, height } = context.canvas;
  const { a: scale } = context.getTransform();
  if (layer.width !== width || layer.height !== height) [layer.width, layer.height] = [width, height];
  const own = layer.getContext("2d");
  const picture = own.createImageData(width, height);
  const pixels = new Uint32Array(picture.data.buffer);
  for (const [m, at, style, alpha] of clouds) {
    const [red, green, blue] = style.match(/[\d.]+/g).map(Number);
    const colour = (alpha << 24 | blue << 16 | green << 8 | red) >>> 0;
    for (let i = 0; i < points.length; i += 3) {
      const [x, y, z] = [points[i], points[i + 1], points[i + 2]];
      const far = m[6] * x + m[7] * y + m[8] * z + at[2];
      const size = Math.round(scale * Math.min(2.6, Math.max(1, 1.6 - 8 * far)));
      const left = Math.round(scale * (m[0] * x + m[1] * y + m[2] * z + at[0]));
      const top = Math.round(scale * (m[3] * x + m[4] * y + m[5] * z + at[1]));
      for (let down = Math.max(0, top); down < Math.min(height, top + size); down++) {
        pixels.fill(colour, down * width + Math.max(0, left), down * width + Math.max(0, Math.min(width, left + size)));
      }
    }
  }
  own.putImageData(picture, 0, 0);
  context.drawImage(layer, 0, 0, width / scale, height / scale);
};

const wire = (draw, { at, m }, style) => {
  const [a, b, e] = [0.075, 0.1, 0.09];
  const ring = place => {
    for (let i = 0; i < 32; i++) {
      const [p, q] = [i, i + 1].map(k => sum(at, times(m, place(k * Math.PI / 16))));
      draw(p, q, style);
    }
  };
  ring(s => [a * Math.cos(s), b * Math.sin(s), 0]);
  ring(s => [0, b * Math.cos(s), e * Math.sin(s)]);
  ring(s => [a * Math.cos(s), 0, e * Math.sin(s)]);
};

// The camera where it is; where it is outside of the picture, its sightline leads there.
const frustum = (draw, camera, middle, style, seen, context) => {
  const along = (axis, length) => camera[axis].map(value => value * length);
  const corner = (x, y) => sum(camera.at, sum(along("z", 0.06), sum(along("x", 0.035 * x), along("y", 0.026 * y))));
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => corner(x, y));
  corners.forEach((place, i) => {
    draw(camera.at, place, style);
    draw(place, corners[(i + 1) % 4], style);
  });
  draw(camera.at, middle, style, 1, [2, 6]);
  const [x, y] = seen(corners[0]);
  context.fillStyle = style;
  context.fillText("camera", x + 6, y);
};
