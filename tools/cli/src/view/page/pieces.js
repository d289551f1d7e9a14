// The pieces of the reference: whether each still moves with the rest.
import { colours } from "./charts.js";

const isApart = ([, , over, state]) => state === "against" || over > 1;
export const colourOf = piece => {
  const c = colours();
  return isApart(piece) ? c.bad : piece[3] === "with" ? c.good : c.warm;
};

// Dots on the image at the middles of the pieces, larger where one moves by itself.
export const markPieces = (context, pieces) => {
  const dot = context.canvas.width / 200;
  for (const piece of pieces) {
    context.fillStyle = colourOf(piece);
    context.beginPath();
    context.arc(...piece[0], isApart(piece) ? 2 * dot : dot, 0, 2 * Math.PI);
    context.fill();
  }
};

export const countedPieces = pieces => {
  if (!pieces.length) return "";
  const apart = pieces.filter(isApart).length;
  const held = pieces.filter(piece => !isApart(piece) && piece[3] === "with").length;
  return `; of ${pieces.length} pieces ${held} move with the rest, ${apart} by themselves`;
};
