// The occupancy grid, unpacked beside the page's own thread: compressed cells -> a bitmap of the free floor, black where
// that is and fainter where no way leads from what was driven: a sonar's fan that reached through a wall.
// 0 unknown, 1 free, 2 wall; row 0 lies at the smallest y.

const FREE = 1, WALL = 2;
const WALL_REACH = 0.12; // metres: wall points are up to 0.1 m apart, and what lies between two is wall too
const SOLID = 255, FAINT = 70; // opacity

onmessage = async ({ data: { body, rows, columns, cell, driven } }) => {
  const cells = await unpacked(body, rows * columns);
  const reached = reachedFrom(driven, cells, columns, Math.ceil(WALL_REACH / cell));
  const image = new ImageData(columns, rows);
  const pixels = new Uint32Array(image.data.buffer);
  for (let k = 0; k < pixels.length; k++) {
    if (cells[k] !== 0) pixels[k] = (cells[k] === WALL || reached[k] ? SOLID : FAINT) << 24;
  }
  const bitmap = await createImageBitmap(image);
  postMessage({ bitmap }, [bitmap]);
};

async function unpacked(body, length) {
  const stream = new Blob([body]).stream().pipeThrough(new DecompressionStream("deflate"));
  const cells = new Uint8Array(length);
  const reader = stream.getReader();
  for (let at = 0; at < length; ) {
    const { done, value } = await reader.read();
    if (done) break;
    cells.set(value.subarray(0, length - at), at);
    at += value.length;
  }
  reader.cancel(); // what lies beyond the floor, however much that is
  return cells;
}

// Which free cells can be reached from the cells `driven` without passing a wall; `reach`: half of a wall's width in cells
function reachedFrom(driven, cells, columns, reach) {
  const blocked = grownWalls(cells, columns, reach);
  const reached = new Uint8Array(cells.length), queue = new Int32Array(cells.length);
  let length = 0;
  const visit = (k) => {
    if (k < 0 || k >= cells.length || reached[k] || cells[k] !== FREE) return;
    reached[k] = 1;
    queue[length++] = k;
  };
  const around = (k, go) => {
    const column = k % columns;
    if (column > 0) go(k - 1);
    if (column < columns - 1) go(k + 1);
    go(k - columns);
    go(k + columns);
  };
  driven.forEach(visit);
  for (let at = 0; at < length; at++) around(queue[at], (k) => blocked[k] || visit(k));
  // Up to the middle of each wall
  for (let from = 0, round = 0; round < reach; round++) {
    const end = length;
    for (let at = from; at < end; at++) around(queue[at], visit);
    from = end;
  }
  return reached;
}

function grownWalls(cells, columns, reach) {
  const rows = cells.length / columns, blocked = new Uint8Array(cells.length);
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      if (cells[row * columns + column] !== WALL) continue;
      const left = Math.max(0, column - reach), right = Math.min(columns, column + reach + 1);
      for (let r = Math.max(0, row - reach); r <= Math.min(rows - 1, row + reach); r++) {
        blocked.fill(1, r * columns + left, r * columns + right);
      }
    }
  }
  return blocked;
}
