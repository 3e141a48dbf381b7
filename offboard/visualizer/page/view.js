// Which part of the map is seen: map metres (y up) <-> CSS pixels of the stage (y down). Pure.

const SCALE_MIN = 1.5; // CSS pixels per metre
const SCALE_MAX = 600;

export class View {
  constructor() {
    this.x = 0; // middle of the stage, in the map
    this.y = 0;
    this.scale = 40;
    this.angle = 0; // the map is turned counter-clockwise by it
    this.width = 1;
    this.height = 1;
  }

  toScreen(x, y) {
    const c = Math.cos(this.angle), s = Math.sin(this.angle);
    const dx = x - this.x, dy = y - this.y;
    return [this.width / 2 + this.scale * (c * dx - s * dy), this.height / 2 - this.scale * (s * dx + c * dy)];
  }

  toMap(sx, sy) {
    const c = Math.cos(this.angle), s = Math.sin(this.angle);
    const u = (sx - this.width / 2) / this.scale, v = -(sy - this.height / 2) / this.scale;
    return [this.x + c * u + s * v, this.y - s * u + c * v];
  }

  // Lets a canvas be drawn on in metres
  apply(context, ratio) {
    const c = Math.cos(this.angle) * this.scale * ratio, s = Math.sin(this.angle) * this.scale * ratio;
    const e = ratio * this.width / 2 - c * this.x + s * this.y;
    const f = ratio * this.height / 2 + s * this.x + c * this.y;
    context.setTransform(c, -s, -s, -c, e, f);
  }

  panBy(dx, dy) {
    const [x, y] = this.toMap(this.width / 2 - dx, this.height / 2 - dy);
    this.x = x;
    this.y = y;
  }

  // What lies under (sx, sy) stays there
  zoomBy(factor, sx = this.width / 2, sy = this.height / 2) {
    this.#around(sx, sy, () => {
      this.scale = Math.min(SCALE_MAX, Math.max(SCALE_MIN, this.scale * factor));
    });
  }

  rotateBy(angle, sx = this.width / 2, sy = this.height / 2) {
    this.#around(sx, sy, () => {
      this.angle = Math.atan2(Math.sin(this.angle + angle), Math.cos(this.angle + angle));
    });
  }

  #around(sx, sy, change) {
    const [x, y] = this.toMap(sx, sy);
    change();
    const [nx, ny] = this.toMap(sx, sy);
    this.x += x - nx;
    this.y += y - ny;
  }

  // Shows the box [x0, y0, x1, y1] whole, with a margin in CSS pixels: {top, right, bottom, left}
  fit(box, margin, scaleMax = 70) {
    const [x0, y0, x1, y1] = box;
    const c = Math.cos(this.angle), s = Math.sin(this.angle);
    const corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(([x, y]) => [c * x - s * y, s * x + c * y]);
    const us = corners.map((p) => p[0]), vs = corners.map((p) => p[1]);
    const u0 = Math.min(...us), u1 = Math.max(...us), v0 = Math.min(...vs), v1 = Math.max(...vs);
    const width = Math.max(50, this.width - margin.left - margin.right);
    const height = Math.max(50, this.height - margin.top - margin.bottom);
    this.scale = Math.max(SCALE_MIN, Math.min(scaleMax, width / (u1 - u0 || 1), height / (v1 - v0 || 1)));
    const u = (u0 + u1) / 2 + (margin.right - margin.left) / 2 / this.scale;
    const v = (v0 + v1) / 2 + (margin.top - margin.bottom) / 2 / this.scale;
    this.x = c * u + s * v;
    this.y = -s * u + c * v;
  }
}
