// No-go lines and areas, and areas to stay in: shown on the map, drawn by clicks on it, removed in a list. What
// counts is what the planner reports (common/zones.py).

const CORNERS_MIN = { "no-go-line": 2, "no-go-area": 3, "only-here": 3 };
const DASH = { "only-here": [10, 5] };
const $ = (id) => document.getElementById(id);

export class Zones {
  // `picking(onPick)`: every click on the map goes to it, until it is called with null
  constructor(map, orders, picking) {
    Object.assign(this, { map, orders, picking });
    this.drawing = null; // {kind, corners_m} while a person draws
    this.buttons = document.querySelectorAll("[data-draw]");
    for (const button of this.buttons) button.onclick = () => this.#begin(button.dataset.draw);
    $("drawn").onclick = () => this.#finish();
    $("zones").onclick = ({ target }) => {
      const number = target.closest("[data-zone]")?.dataset.zone;
      if (number) this.orders.give({ order: "remove-zone", zone: Number(number) });
    };
    map.layers.push((context, view, colours) => this.#draw(context, view, colours));
    orders.prompt = () => this.#prompt();
  }

  leave() {
    if (!this.drawing) return;
    this.drawing = null;
    this.picking(null);
    this.#changed();
  }

  show() {
    const { zones } = this.map.model;
    const { allowed } = this.orders;
    if (this.drawing && !allowed) this.leave();
    for (const button of this.buttons) {
      button.disabled = !allowed;
      button.setAttribute("aria-pressed", this.drawing?.kind === button.dataset.draw);
    }
    $("drawn").hidden = !this.drawing;
    $("drawn").disabled = !this.#complete;
    const text = JSON.stringify([zones, allowed]);
    if (text === this.listed) return;
    this.listed = text;
    $("zones").replaceChildren(...zones.map((zone) => this.#item(zone, allowed)));
  }

  get #complete() {
    return Boolean(this.drawing) && this.drawing.corners_m.length >= CORNERS_MIN[this.drawing.kind];
  }

  #item({ number, title }, allowed) {
    const item = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.dataset.zone = number;
    button.disabled = !allowed;
    button.textContent = "Remove";
    button.setAttribute("aria-label", `Remove ${title}`);
    item.append(title, button);
    return item;
  }

  #begin(kind) {
    const again = this.drawing?.kind === kind;
    this.leave();
    if (again) return;
    this.orders.leave();
    this.drawing = { kind, corners_m: [] };
    this.picking((corner) => {
      this.drawing.corners_m.push(corner);
      this.#changed();
    });
    this.#changed();
  }

  #finish() {
    const { kind, corners_m } = this.drawing;
    this.leave();
    this.orders.give({ order: kind, corners_m });
  }

  #changed() {
    this.orders.show();
    this.show();
    this.map.draw(false);
  }

  #prompt() {
    if (!this.drawing) return "";
    const count = this.drawing.corners_m.length;
    return `Click on its corners, then Done; ${count} so far. Esc ends.`;
  }

  #draw(context, view, colours) {
    const drawn = this.drawing ? [{ ...this.drawing, title: "" }] : [];
    for (const { kind, title, corners_m } of [...this.map.model.zones, ...drawn]) {
      if (!corners_m.length) continue;
      const places = corners_m.map(([x, y]) => view.toScreen(x, y));
      context.beginPath();
      for (const [x, y] of places) context.lineTo(x, y);
      if (kind !== "no-go-line") context.closePath();
      context.strokeStyle = context.fillStyle = colours.zone;
      context.lineWidth = 3;
      context.setLineDash(DASH[kind] ?? []);
      context.stroke();
      context.setLineDash([]);
      if (kind === "no-go-area") {
        context.globalAlpha = 0.18;
        context.fill();
        context.globalAlpha = 1;
      }
      for (const [x, y] of title ? [] : places) context.fillRect(x - 4, y - 4, 8, 8);
      context.font = "600 12px system-ui, sans-serif";
      context.textAlign = "left";
      context.textBaseline = "bottom";
      context.fillText(title, places[0][0] + 5, places[0][1] - 4);
    }
  }
}
