// A point of interest opened: photo, name, number, room type. `#poi=ID` in the address opens it too, also when it is
// only found later.

import { headline, judgementOf, stateOf } from "./poi_text.js";

export class PoiDialog {
  constructor({ find, neighbours, place, show, drive, mayDrive, onSelect, onShow }) {
    this.find = find; // id -> point of interest
    this.neighbours = neighbours; // () -> the list to walk along
    this.place = place; // point of interest -> words
    this.drive = drive; // orders the robot there
    this.mayDrive = mayDrive;
    this.show = show; // brings it into the middle of the map
    this.onSelect = onSelect;
    this.onShow = onShow; // what else the dialog has of it
    this.dialog = document.getElementById("poi");
    this.image = this.dialog.querySelector("img");
    this.id = null;
    this.shown = "";
    this.dialog.addEventListener("close", () => this.#closed());
    this.dialog.addEventListener("click", (event) => this.#click(event));
    this.dialog.addEventListener("keydown", (event) => this.#key(event));
    this.image.onerror = () => this.dialog.classList.add("no-photo");
    addEventListener("hashchange", () => this.followAddress());
  }

  followAddress() {
    const match = /^#poi=(\d+)$/.exec(location.hash);
    const id = match ? Number(match[1]) : null;
    if (id !== null && id !== this.id && this.find(id)) this.open(id);
    else if (id === null && this.dialog.open) this.dialog.close();
  }

  open(id) {
    this.id = id;
    history.replaceState(null, "", `#poi=${id}`);
    this.refresh();
    if (!this.dialog.open) this.dialog.showModal();
    this.onSelect(id);
    this.show(this.find(id));
  }

  // What is known of it may grow while it is open
  refresh() {
    const poi = this.find(this.id);
    if (!poi) return;
    const text = JSON.stringify(poi) + this.place(poi);
    if (text === this.shown) return;
    this.shown = text;
    this.dialog.querySelector('[data-do="drive"]').hidden = !this.mayDrive();
    const { sign, text: reading } = stateOf(poi);
    const values = {
      name: poi.name,
      number: poi.number || "none read",
      room_type: poi.room_type || "none read",
      state: poi.judged ? judgementOf(poi) : `${sign} ${reading}, ${Math.round(100 * poi.confidence)} % sure`,
      place: this.place(poi),
    };
    for (const [field, value] of Object.entries(values)) {
      this.dialog.querySelector(`[data-field="${field}"]`).textContent = value;
    }
    this.dialog.querySelector("h2").textContent = headline(poi);
    this.#showPhoto(poi);
    this.onShow(poi);
  }

  #showPhoto(poi) {
    const url = poi.has_photo ? `photos/${poi.poi_id}.jpg?t=${poi.t_s}` : "";
    this.dialog.classList.toggle("no-photo", !url);
    if (this.image.getAttribute("src") === url) return;
    this.image.alt = url ? `Photo of ${headline(poi)}` : "";
    if (url) this.image.src = url;
    else this.image.removeAttribute("src");
  }

  #step(by) {
    const list = this.neighbours();
    const next = list[list.findIndex((poi) => poi.poi_id === this.id) + by];
    if (next) this.open(next.poi_id);
  }

  #click({ target }) {
    if (target === this.dialog) this.dialog.close(); // beside it
    const button = target.closest("[data-do]");
    const acts = {
      close: () => this.dialog.close(),
      previous: () => this.#step(-1),
      next: () => this.#step(1),
      show: () => {
        const poi = this.find(this.id);
        this.dialog.close();
        this.show(poi, true);
      },
      drive: () => {
        this.drive(this.find(this.id));
        this.dialog.close();
      },
      link: () => this.#copy(button),
    };
    if (button) acts[button.dataset.do]();
  }

  async #copy(button) {
    try {
      await navigator.clipboard.writeText(location.href);
      button.textContent = "Copied";
    } catch {
      button.textContent = "It is in the address bar";
    }
    setTimeout(() => (button.textContent = "Copy link"), 1500);
  }

  #key(event) {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step && !event.target.matches("input")) this.#step(step);
  }

  #closed() {
    this.id = null;
    this.shown = "";
    history.replaceState(null, "", location.pathname + location.search);
    this.onSelect(null);
  }
}
