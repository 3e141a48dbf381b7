// The list of points of interest, with search and filters. Arrow keys walk through it, Enter opens.

import { byNumber, headline, spoken, stateOf } from "./poi_text.js";

const KEEPS = {
  all: () => true,
  read: (poi) => poi.state === "read",
  check: (poi) => poi.state !== "read",
};

export class PoiList {
  constructor(onOpen) {
    this.onOpen = onOpen;
    this.pois = [];
    this.filter = "all";
    this.list = document.getElementById("poi-list");
    this.search = document.getElementById("search");
    this.kind = document.getElementById("kind");
    this.none = document.getElementById("poi-none");
    this.count = document.getElementById("poi-count");
    this.search.oninput = () => this.#show();
    this.kind.onchange = () => this.#show();
    document.getElementById("filters").onclick = ({ target }) => target.dataset.filter && this.#choose(target.dataset.filter);
    this.search.onkeydown = (event) => this.#searchKey(event);
    this.list.onkeydown = (event) => this.#listKey(event);
    this.#show();
  }

  set(pois) {
    this.pois = [...pois].sort(byNumber);
    const kinds = [...new Set(pois.map((poi) => poi.room_type).filter(Boolean))].sort();
    const chosen = this.kind.value;
    this.kind.replaceChildren(new Option("All types", ""), ...kinds.map((kind) => new Option(kind)));
    this.kind.value = kinds.includes(chosen) ? chosen : "";
    this.#show();
  }

  // What the list shows now, in its order: the dialog walks along it
  get shown() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    return this.pois.filter((poi) => {
      const text = `${spoken(poi)} ${poi.description}`.toLowerCase();
      const kind = !this.kind.value || poi.room_type === this.kind.value;
      return kind && KEEPS[this.filter](poi) && words.every((word) => text.includes(word));
    });
  }

  select(id) {
    for (const button of this.list.querySelectorAll("button")) {
      const chosen = Number(button.dataset.poi) === id;
      button.setAttribute("aria-current", chosen);
      if (chosen) button.scrollIntoView({ block: "nearest" });
    }
  }

  #choose(filter) {
    this.filter = filter;
    for (const chip of document.querySelectorAll("[data-filter]")) {
      chip.setAttribute("aria-pressed", chip.dataset.filter === filter);
    }
    this.#show();
  }

  #show() {
    const shown = this.shown;
    const focused = this.list.contains(document.activeElement) ? document.activeElement.dataset.poi : null;
    this.list.replaceChildren(...shown.map((poi) => this.#row(poi)));
    if (focused) this.list.querySelector(`[data-poi="${focused}"]`)?.focus();
    const all = this.pois.length;
    this.count.textContent = shown.length === all ? all : `${shown.length} of ${all}`;
    this.none.textContent = shown.length ? "" : all ? "None fits. Clear the search or choose All." : "None found yet.";
  }

  #row(poi) {
    const row = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    button.dataset.poi = poi.poi_id;
    button.onclick = () => this.onOpen(poi.poi_id);
    const { sign, text } = stateOf(poi);
    const part = (name, content) => Object.assign(document.createElement("span"), { className: name, textContent: content });
    button.append(part("plate", poi.number || "?"), part("what", poi.room_type || poi.name), part(`sign ${poi.state}`, sign));
    button.setAttribute("aria-label", `${headline(poi)}, ${text}`);
    row.append(button);
    return row;
  }

  #searchKey(event) {
    if (event.key === "ArrowDown" || event.key === "Enter") {
      event.preventDefault();
      const first = this.list.querySelector("button");
      if (event.key === "Enter") first?.click();
      else first?.focus();
    } else if (event.key === "Escape") {
      this.search.value = "";
      this.search.blur();
      this.#show();
    }
  }

  #listKey(event) {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const buttons = [...this.list.querySelectorAll("button")];
    const next = buttons[buttons.indexOf(document.activeElement) + step];
    (next ?? (step < 0 ? this.search : null))?.focus();
  }
}
