// The map as it is shown, on one sheet: the stage takes the sheet's size, and all of it is drawn anew for that.

import { place } from "./poi_text.js";

// CSS pixels, of which a printer takes 96 for an inch whatever the screen's size: A4 across without its margins of 1 cm
// and the lines above and below the map (style.css)
const SIZE = { width: 1046, height: 640 };
const RATIO = 4; // pixels of the canvas per CSS pixel; Chromium rounds what it divides a printed canvas by to 64ths

export class Paper {
  constructor(map, model, screenScale) {
    Object.assign(this, { map, model, screenScale });
    this.sheet = document.getElementById("sheet");
  }

  begin() {
    const { robot, recorded, pose } = this.model;
    const now = new Date();
    const when = recorded || `${now.toLocaleDateString()} ${now.toLocaleTimeString()}`;
    const state = { live: "", recorded: "", waiting: "" }[this.model.state] ?? ", OLD DATA";
    const at = pose ? `; the robot at ${place(pose)} from its start` : "";
    this.sheet.textContent = `Indoor Mapping ${robot}, ${when}${state}${at}`;
    this.screenScale.onPaper = true;
    this.map.onPaper(SIZE, RATIO, this.screenScale.toPaper);
  }

  end() {
    this.screenScale.onPaper = false;
    this.map.onScreen();
  }
}
