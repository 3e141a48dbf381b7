// Points of interest on the map: real buttons over the canvas, so that a click, a finger and the Tab key all find them.

import { spoken } from "./poi_text.js";

const LABEL_FROM = 14; // CSS pixels per metre: below it there is no room for numbers
const LABEL_HEIGHT = 18;
const LETTER = 8;

export class Markers {
  constructor(host, onOpen) {
    this.host = host;
    this.onOpen = onOpen;
    this.template = document.getElementById("marker");
    this.buttons = new Map();
    this.pois = [];
  }

  set(pois) {
    this.pois = pois;
    const gone = new Set(this.buttons.keys());
    for (const poi of pois) {
      gone.delete(poi.poi_id);
      this.#update(this.buttons.get(poi.poi_id) ?? this.#make(poi.poi_id), poi);
    }
    for (const id of gone) {
      this.buttons.get(id).remove();
      this.buttons.delete(id);
    }
  }

  #make(id) {
    const button = this.template.content.firstElementChild.cloneNode(true);
    button.dataset.poi = id;
    button.onclick = () => this.onOpen(id);
    this.host.append(button);
    this.buttons.set(id, button);
    return button;
  }

  #update(button, poi) {
    button.dataset.state = poi.state;
    button.setAttribute("aria-label", spoken(poi));
    button.title = spoken(poi);
    button.querySelector("span").textContent = poi.number ? (poi.state === "read" ? poi.number : `${poi.number}?`) : "?";
  }

  place(view, selected) {
    this.host.classList.toggle("labelled", view.scale >= LABEL_FROM);
    const taken = []; // [x, y, width] of the labels so far: one that would cover another is left out
    for (const poi of this.pois) {
      const button = this.buttons.get(poi.poi_id);
      const [x, y] = view.toScreen(poi.x_m, poi.y_m);
      const width = LETTER * (poi.number.length + 2);
      const free = taken.every(([a, b, w]) => Math.abs(a - x) > (w + width) / 2 || Math.abs(b - y) > LABEL_HEIGHT);
      if (free) taken.push([x, y, width]);
      button.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
      button.classList.toggle("selected", poi.poi_id === selected);
      button.classList.toggle("crowded", !free);
    }
  }
}
