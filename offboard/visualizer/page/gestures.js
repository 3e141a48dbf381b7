// Mouse, touch and keys on the map -> the view. Wheel and pinch zoom, two fingers turn, dragging moves; with the ruler
// in hand, dragging measures. `MapView.mode`: "fit" and "follow" move the view by themselves, "free" does not.

const WHEEL = 0.0015; // per pixel of wheel
const TURN = Math.PI / 12;
const CLICK_PX = 6; // a pointer that moved farther dragged
const SNAP_PX = 15; // half of an asterisk's button

export class Gestures {
  constructor(map, onChange) {
    this.map = map;
    this.onChange = onChange;
    this.measuring = false;
    this.pointers = new Map();
    this.onPick = null; // takes the next place that is clicked on
    this.pressed = null; // where the only pointer went down
    this.cursor = null; // where the pointer is, in CSS pixels of the stage
    const { overlay, stage } = map;
    overlay.addEventListener("pointerdown", (event) => this.#down(event));
    overlay.addEventListener("pointermove", (event) => this.#move(event));
    for (const name of ["pointerup", "pointercancel"]) overlay.addEventListener(name, (event) => this.#up(event));
    overlay.addEventListener("pointerleave", () => this.#hover(null));
    stage.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    overlay.addEventListener("keydown", (event) => this.#arrow(event));
  }

  // The next click on the map goes to `onPick(place)` instead; null ends that
  pick(onPick) {
    this.onPick = onPick;
    this.map.stage.classList.toggle("picking", Boolean(onPick));
  }

  act(name) {
    const { map } = this;
    const { view } = map;
    if (name === "fit" || name === "follow") {
      if (name === "follow" && view.scale < 30) view.scale = 50;
      map.setMode(map.mode === name ? "free" : name);
    } else if (name === "ruler") {
      this.measuring = !this.measuring;
      map.measured = null;
    } else if (name === "in" || name === "out") {
      this.#zoom(name === "in" ? 1.4 : 1 / 1.4);
    } else if (name === "left" || name === "right") {
      view.rotateBy(name === "left" ? TURN : -TURN);
    }
    map.draw();
    this.onChange();
  }

  #zoom(factor, x, y) {
    const { map } = this;
    if (map.mode === "follow") map.view.zoomBy(factor);
    else {
      map.mode = "free";
      map.view.zoomBy(factor, x, y);
    }
  }

  #place(event) {
    const box = this.map.stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  // The point of interest there, or the place itself
  #measuredPlace([sx, sy]) {
    const { view, model } = this.map;
    const distance = (poi) => Math.hypot(...view.toScreen(poi.x_m, poi.y_m).map((s, k) => s - [sx, sy][k]));
    const near = model.pois.filter((poi) => distance(poi) <= SNAP_PX).sort((a, b) => distance(a) - distance(b));
    return near.length ? [near[0].x_m, near[0].y_m] : view.toMap(sx, sy);
  }

  #down(event) {
    if (event.button !== 0) return;
    this.map.overlay.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, this.#place(event));
    this.pressed = this.pointers.size === 1 ? this.#place(event) : null;
    if (this.measuring && this.pointers.size === 1) {
      const at = this.#measuredPlace(this.#place(event));
      this.map.measured = { from: at, to: at };
      this.map.draw(false);
    }
  }

  #move(event) {
    const now = this.#place(event);
    this.#hover(now);
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const { map } = this;
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    this.pointers.set(event.pointerId, now);
    if (others.length) this.#pinch(before, now, others[0]);
    else if (this.measuring) map.measured = { ...map.measured, to: this.#measuredPlace(now) };
    else {
      map.mode = "free";
      map.view.panBy(now[0] - before[0], now[1] - before[1]);
    }
    map.draw(!this.measuring || others.length > 0);
    this.onChange();
  }

  #pinch(before, now, still) {
    const from = [before[0] - still[0], before[1] - still[1]], to = [now[0] - still[0], now[1] - still[1]];
    const middle = [(now[0] + still[0]) / 2, (now[1] + still[1]) / 2];
    const factor = Math.hypot(...to) / (Math.hypot(...from) || 1);
    this.#zoom(factor, ...middle);
    if (this.map.mode === "free") this.map.view.panBy((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    this.map.view.rotateBy(Math.atan2(from[1], from[0]) - Math.atan2(to[1], to[0]), ...middle);
  }

  #up(event) {
    this.pointers.delete(event.pointerId);
    const at = this.#place(event);
    const clicked = this.pressed && Math.hypot(at[0] - this.pressed[0], at[1] - this.pressed[1]) < CLICK_PX;
    if (clicked && this.onPick && event.type === "pointerup") this.onPick(this.#measuredPlace(at));
  }

  #hover(place) {
    this.cursor = place;
    this.onChange();
  }

  #wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    this.#zoom(Math.exp(-event.deltaY * lines * WHEEL * (event.ctrlKey ? 4 : 1)), ...this.#place(event));
    this.map.draw();
    this.onChange();
  }

  #arrow(event) {
    const step = event.shiftKey ? 200 : 60;
    const way = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] }[event.key];
    if (!way) return;
    event.preventDefault();
    this.map.mode = "free";
    this.map.view.panBy(...way);
    this.map.draw();
    this.onChange();
  }
}
