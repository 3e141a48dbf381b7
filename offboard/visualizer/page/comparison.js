// Another run over the one that is shown (offboard/visualizer/run_overlay.py): walls by which of the two has them.

import { Walls } from "./walls.js";

// What the server names -> its colour on the map; later ones lie above
const LAYERS = { unseen: "inferred", common: "wall", there: "there", here: "here" };

export async function comparison() {
  const answer = await fetch("comparison");
  if (!answer.ok) return { text: await answer.text(), layers: [] };
  const { text, layers } = await answer.json();
  return { text, layers: Object.entries(LAYERS).map(([key, name]) => ({ name, walls: walls(layers[key], key === "there") })) };
}

// Dashed are those of the other run alone: a colour is no sign by itself
function walls(points, dashed) {
  const made = new Walls();
  made.add(points, new Uint8Array(points.length / 2).fill(dashed ? 1 : 0));
  return made;
}
