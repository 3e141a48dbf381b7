// Draws the model: what changes rarely (floor, walls, trail) on the canvas below; above.js draws on the one above.

import { drawAbove } from "./above.js";
import { View } from "./view.js";

const WALL = 0.09; // metres
const MARGIN = { top: 56, right: 76, bottom: 64, left: 32 };
const TIMELINE_PX = 58;
const GRID_STEPS = [1, 5, 10, 50]; // metres between two lines
const GRID_MIN_PX = 48;

export class MapView {
  constructor(stage, model, onView) {
    this.stage = stage;
    this.model = model;
    this.onView = onView;
    this.view = new View();
    this.mode = "fit"; // fit, follow, free
    this.measured = null; // {from: [x, y], to: [x, y]} in metres
    this.base = stage.querySelector("#base");
    this.overlay = stage.querySelector("#overlay");
    this.floor = null; // {bitmap, grid, tinted}
    this.paper = false; // it is being printed
    this.layers = []; // (context, view, colours) each, above walls and below the robot
    this.worker = new Worker("floor_worker.js");
    this.worker.onmessage = ({ data }) => this.#floorReady(data);
    this.decoding = null;
    this.pending = false;
    this.stained = true; // the lower canvas must be drawn again
    new ResizeObserver(() => this.#resize()).observe(stage);
    for (const query of ["(prefers-color-scheme: dark)", "print"]) {
      matchMedia(query).addEventListener("change", () => this.recolour());
    }
    this.recolour();
  }

  // Between `beforeprint` and `afterprint` no frame comes: all is drawn at once
  onPaper({ width, height }, ratio, zoom) {
    this.kept = { ...this.view };
    this.paper = true;
    this.view.scale *= zoom;
    this.#setSize(width, height, ratio);
  }

  onScreen() {
    Object.assign(this.view, this.kept);
    this.paper = false;
    this.#resize();
  }

  recolour() {
    const style = getComputedStyle(document.documentElement);
    const names = ["unknown", "lines", "free", "wall", "inferred", "trail", "plan", "robot", "sonar", "ink", "paper", "start", "zone", "here", "there"];
    this.colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--map-${name}`).trim()]));
    this.stained = true;
    if (this.floor) this.#tintFloor();
    if (this.paper) this.#frame();
    else this.draw();
  }

  // Keeps the present grid when the next one is requested before it is done
  redecode() {
    const grid = this.model.grid;
    if (!grid || this.decoding) return;
    this.decoding = grid;
    const { body, rows, columns, cell_m: cell } = grid;
    this.worker.postMessage({ body, rows, columns, cell, driven: this.#drivenCells(grid) });
  }

  // Cells of the grid, by their number, that the robot drove over
  #drivenCells({ origin: [x0, y0], cell_m, rows, columns }) {
    const { trail } = this.model;
    const driven = [];
    for (let k = 0; k < trail.length; k += 2) {
      const column = Math.floor((trail[k] - x0) / cell_m), row = Math.floor((trail[k + 1] - y0) / cell_m);
      if (column >= 0 && column < columns && row >= 0 && row < rows) driven.push(row * columns + column);
    }
    return driven;
  }

  #floorReady({ bitmap }) {
    const grid = this.decoding;
    this.decoding = null;
    this.floor?.bitmap.close();
    this.floor = { bitmap, grid };
    this.#tintFloor();
    if (this.model.grid !== grid) this.redecode();
    this.draw();
  }

  #tintFloor() {
    const { bitmap } = this.floor;
    const tinted = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = tinted.getContext("2d");
    context.drawImage(bitmap, 0, 0);
    context.globalCompositeOperation = "source-in";
    context.fillStyle = this.colours.free;
    context.fillRect(0, 0, bitmap.width, bitmap.height);
    this.floor.tinted = tinted;
  }

  #resize() {
    if (this.paper) return;
    this.#setSize(this.stage.clientWidth, this.stage.clientHeight, window.devicePixelRatio || 1);
  }

  #setSize(width, height, ratio) {
    this.ratio = ratio;
    this.view.width = Math.max(1, width);
    this.view.height = Math.max(1, height);
    for (const canvas of [this.base, this.overlay]) {
      canvas.width = Math.round(width * this.ratio);
      canvas.height = Math.round(height * this.ratio);
    }
    this.stained = true;
    this.#frame();
  }

  // `below`: whether the lower canvas changes too
  draw(below = true) {
    this.stained ||= below;
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => this.#frame());
  }

  setMode(mode) {
    this.mode = mode;
    this.draw();
  }

  #frame() {
    this.pending = false;
    const { model, view } = this;
    const before = [view.x, view.y, view.scale, view.angle].join();
    if (this.mode === "fit" && model.box) view.fit(model.box, this.#margin());
    if (this.mode === "follow" && model.pose) [view.x, view.y] = [model.pose.x_m, model.pose.y_m];
    const moved = before !== [view.x, view.y, view.scale, view.angle].join();
    if (this.paper) this.#drawPaper();
    else if (this.stained || moved || this.drawn !== before) this.#drawBelow(this.base.getContext("2d"));
    this.stained = false;
    this.drawn = [view.x, view.y, view.scale, view.angle].join();
    drawAbove(this.overlay.getContext("2d"), this);
    this.onView();
    this.stage.dispatchEvent(new CustomEvent("drawn"));
  }

  #margin() {
    const margin = this.view.width < 560 ? { top: 44, right: 60, bottom: 52, left: 16 } : MARGIN;
    return this.model.playback && !this.paper ? { ...margin, bottom: margin.bottom + TIMELINE_PX } : margin;
  }

  // All on the lower canvas, by way of a picture: Chromium prints what is drawn on a canvas as strokes, and a second one with
  // what is clear above it as a mask; not every reader shows such a PDF as it was
  #drawPaper() {
    const { width, height } = this.base;
    const [below, above] = [new OffscreenCanvas(width, height), new OffscreenCanvas(width, height)];
    this.#drawBelow(below.getContext("2d"));
    drawAbove(above.getContext("2d"), this);
    const context = this.base.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.drawImage(below, 0, 0);
    context.drawImage(above, 0, 0);
  }

  #drawBelow(context) {
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = this.colours.unknown;
    context.fillRect(0, 0, context.canvas.width, context.canvas.height);
    this.view.apply(context, this.ratio);
    this.#drawFloor(context);
    this.#drawLines(context);
    this.#drawTrail(context);
    this.#drawWalls(context);
    this.#drawStart(context);
  }

  #drawFloor(context) {
    if (!this.floor || !this.model.atEnd) return;
    const { tinted, grid } = this.floor;
    context.imageSmoothingEnabled = this.view.scale * grid.cell_m < 6;
    context.drawImage(tinted, ...grid.origin, grid.columns * grid.cell_m, grid.rows * grid.cell_m);
  }

  // The part of the map that is seen, as a box along the axes
  #seen() {
    const { view } = this;
    const corners = [[0, 0], [view.width, 0], [view.width, view.height], [0, view.height]].map((p) => view.toMap(...p));
    const xs = corners.map((p) => p[0]), ys = corners.map((p) => p[1]);
    return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
  }

  // Counted from the start, as the coordinates are
  #drawLines(context) {
    const [x0, y0, x1, y1] = this.#seen();
    const step = GRID_STEPS.find((s) => s * this.view.scale >= GRID_MIN_PX) ?? 100;
    const lines = new Path2D();
    for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step) {
      lines.moveTo(x, y0);
      lines.lineTo(x, y1);
    }
    for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step) {
      lines.moveTo(x0, y);
      lines.lineTo(x1, y);
    }
    context.strokeStyle = this.colours.lines;
    context.lineWidth = 1 / this.view.scale;
    context.stroke(lines);
  }

  #drawTrail(context) {
    const trail = this.model.trail;
    if (trail.length < 4) return;
    context.beginPath();
    context.moveTo(trail[0], trail[1]);
    for (let k = 2; k < trail.length; k += 2) context.lineTo(trail[k], trail[k + 1]);
    context.strokeStyle = this.colours.trail;
    context.lineWidth = Math.max(0.05, 1.4 / this.view.scale);
    context.lineJoin = context.lineCap = "round";
    context.stroke();
  }

  #drawWalls(context) {
    const [x0, y0, x1, y1] = this.#seen();
    context.lineCap = "round";
    context.lineWidth = Math.max(WALL, 2 / this.view.scale);
    for (const { name, walls } of this.#wallLayers) {
      for (const chunk of walls.chunks) {
        const [a, b, c, d] = chunk.box;
        if (c < x0 || a > x1 || d < y0 || b > y1) continue;
        context.strokeStyle = this.colours[name ?? (chunk.inferred ? "inferred" : "wall")];
        context.stroke(chunk.path);
      }
    }
  }

  // With another run over this one each kind of walls has its colour
  get #wallLayers() {
    const { comparison, walls, atEnd } = this.model;
    return comparison?.layers.length && atEnd ? comparison.layers : [{ walls }];
  }

  #drawStart(context) {
    if (!this.model.trail.length) return;
    const size = Math.max(0.3, 9 / this.view.scale);
    context.beginPath();
    context.arc(0, 0, size * 0.72, 0, 2 * Math.PI);
    context.fillStyle = this.colours.paper;
    context.fill();
    // A house that stands upright however the map is turned
    const c = Math.cos(-this.view.angle) * size, s = Math.sin(-this.view.angle) * size;
    const corners = [[-0.5, 0.02], [0, 0.5], [0.5, 0.02], [0.34, 0.02], [0.34, -0.42], [-0.34, -0.42], [-0.34, 0.02]];
    context.beginPath();
    for (const [u, v] of corners) context.lineTo(c * u - s * v, s * u + c * v);
    context.closePath();
    context.fillStyle = this.colours.start;
    context.fill();
  }
}
