// The pieces of the reference: whether each still moves with the rest.
import { colours } from "./charts.js";

const isApart = ([, , over, state]) => state === "against" || over > 1;
const kind = piece => isApart(piece) ? "apart" : piece[3] === "with" ? "with" : "open";
export const colourOf = piece => {
  const c = colours();
  return { apart: c.bad, with: c.good, open: c.line }[kind(piece)];
};

// Dots on the image at the middles of the pieces, larger where one moves by itself. The relief is the same in light and dark.
const ON_RELIEF = { apart: "#ff2050", with: "#00e08a", open: "#fff" };
export const markPieces = (context, pieces) => {
  const dot = context.canvas.width / 240;
  for (const piece of pieces) {
    context.fillStyle = ON_RELIEF[kind(piece)];
    context.beginPath();
    context.arc(...piece[0], isApart(piece) ? 2 * dot : dot, 0, 2 * Math.PI);
    context.fill();
  }
};

export const countedPieces = pieces => {
  const of = name => pieces.filter(piece => kind(piece) === name).length;
  return pieces.length ? `; of ${pieces.length} pieces ${of("with")} move along, ${of("apart")} apart` : "";
};
