// The occupancy grid, unpacked beside the page's own thread: compressed cells -> a bitmap of the free floor, black where
// that is. 0 unknown, 1 free, 2 wall; row 0 lies at the smallest y.

onmessage = async ({ data: { body, rows, columns } }) => {
  const stream = new Blob([body]).stream().pipeThrough(new DecompressionStream("deflate"));
  const cells = new Uint8Array(rows * columns);
  const reader = stream.getReader();
  for (let at = 0; at < cells.length; ) {
    const { done, value } = await reader.read();
    if (done) break;
    cells.set(value.subarray(0, cells.length - at), at);
    at += value.length;
  }
  reader.cancel(); // what lies beyond the floor, however much that is
  const image = new ImageData(columns, rows);
  const pixels = new Uint32Array(image.data.buffer);
  for (let k = 0; k < pixels.length; k++) if (cells[k] !== 0) pixels[k] = 255 << 24;
  const bitmap = await createImageBitmap(image);
  postMessage({ bitmap }, [bitmap]);
};
