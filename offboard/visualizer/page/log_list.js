// The log of a recorded run: searched, and from each line to its moment.

import { clock } from "./timeline.js";

const SHOWN_MAX = 300; // rows: more are found by searching
const SERIOUS = ["WARNING", "ERROR", "CRITICAL"];
const SIGNS = { WARNING: "!", ERROR: "✕", CRITICAL: "✕" };
const $ = (id) => document.getElementById(id);

export class LogList {
  // `jump(at_s)`: the run is shown from there on
  constructor(model, jump) {
    this.model = model;
    $("log-search").oninput = $("log-level").onchange = () => this.show();
    $("log-list").onclick = ({ target }) => {
      const at = target.closest("button")?.dataset.at;
      if (at) jump(Number(at));
    };
  }

  show() {
    const { log } = this.model;
    $("log").hidden = !log.length;
    const words = $("log-search").value.toLowerCase().split(/\s+/).filter(Boolean);
    const serious = $("log-level").value === "serious";
    const fitting = log.filter(({ level, module, text }) => {
      const all = `${level} ${module} ${text}`.toLowerCase();
      return (!serious || SERIOUS.includes(level)) && words.every((word) => all.includes(word));
    });
    const shown = fitting.slice(0, SHOWN_MAX);
    $("log-list").replaceChildren(...shown.map((line) => this.#row(line)));
    $("log-sum").textContent = shown.length < fitting.length ? `${shown.length} of ${fitting.length}` : `${shown.length} lines`;
    this.mark();
  }

  #row({ at_s, level, module, text }) {
    const row = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.dataset.at = at_s;
    button.className = level.toLowerCase();
    const time = Object.assign(document.createElement("time"), { textContent: clock(at_s) });
    const name = Object.assign(document.createElement("b"), { textContent: `${SIGNS[level] ?? ""} ${module}`.trim() });
    button.append(time, name, ` ${text}`);
    row.append(button);
    return row;
  }

  // The last line before the moment that is shown
  mark() {
    const at = this.model.playback?.at_s ?? 0;
    let current = null;
    for (const button of $("log-list").querySelectorAll("button")) {
      if (Number(button.dataset.at) <= at + 0.05) current = button;
      if (button.hasAttribute("aria-current")) button.removeAttribute("aria-current");
    }
    current?.setAttribute("aria-current", "true");
  }
}
