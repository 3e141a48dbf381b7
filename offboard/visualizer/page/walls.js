// Wall points -> wall lines. Of the points in a square of THIN one is kept, and each is joined to the nearest one
// before it that is nearer than JOIN: as few strokes as keep a wall together, and each new point costs the same. Inferred
// walls are dashed: strokes that short have no dashes of their own, so those that lie in a gap are left out.

const THIN = 0.06; // metres; both as in the exports
const JOIN = 0.25;
const DASH = 0.3;
const CHUNK = 400; // strokes per path: what is out of sight is not drawn

// Along either axis, and along nearly every slanting line, every other DASH is a gap
const inGap = (x, y) => Math.floor((x + 0.8 * y) / DASH) % 2 === 0;
const key = (i, j) => i * 1000003 + j;

export class Walls {
  constructor() {
    this.chunks = [];
    this.box = null; // [x0, y0, x1, y1] of all points
    this.length = 0; // points taken, those left out included
    this.thin = new Set();
    this.cells = new Map();
  }

  add(points, inferred) {
    for (let k = 0; k < inferred.length; k++) this.#addPoint(points[2 * k], points[2 * k + 1], inferred[k] === 1);
    this.length += inferred.length;
  }

  #addPoint(x, y, inferred) {
    const square = key(Math.floor(x / THIN), Math.floor(y / THIN));
    if (this.thin.has(square)) return;
    this.thin.add(square);
    if (!inferred || !inGap(x, y)) this.#stroke(x, y, inferred);
    this.box = grown(this.box, x, y);
    const cell = key(Math.floor(x / JOIN), Math.floor(y / JOIN));
    const inside = this.cells.get(cell);
    if (inside) inside.push(x, y);
    else this.cells.set(cell, [x, y]);
  }

  #stroke(x, y, inferred) {
    const [nx, ny] = this.#nearest(x, y) ?? [x, y];
    const chunk = this.#chunk(inferred);
    if (inferred && inGap(nx, ny)) chunk.path.moveTo(x, y);
    else chunk.path.moveTo(nx, ny);
    chunk.path.lineTo(x, y);
    chunk.strokes++;
    chunk.box = grown(chunk.box, x, y);
  }

  #nearest(x, y) {
    const i = Math.floor(x / JOIN), j = Math.floor(y / JOIN);
    let best = null, bestSquare = JOIN * JOIN;
    for (let di = -1; di <= 1; di++) {
      for (let dj = -1; dj <= 1; dj++) {
        const cell = this.cells.get(key(i + di, j + dj));
        if (!cell) continue;
        for (let k = 0; k < cell.length; k += 2) {
          const square = (cell[k] - x) ** 2 + (cell[k + 1] - y) ** 2;
          if (square < bestSquare) {
            bestSquare = square;
            best = [cell[k], cell[k + 1]];
          }
        }
      }
    }
    return best;
  }

  #chunk(inferred) {
    for (let k = this.chunks.length - 1; k >= Math.max(0, this.chunks.length - 2); k--) {
      const chunk = this.chunks[k];
      if (chunk.inferred === inferred && chunk.strokes < CHUNK) return chunk;
    }
    const chunk = { path: new Path2D(), strokes: 0, box: null, inferred };
    this.chunks.push(chunk);
    return chunk;
  }
}

export function grown(box, x, y) {
  if (!box) return [x, y, x, y];
  return [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y)];
}
