// Everything in words beside the map: link, mission, figures, modules. Ages are updated several times a second.

import { STALE_S } from "./model.js";
import { place } from "./poi_text.js";
import { showHealth, showVitals } from "./vitals.js";

const $ = (id) => document.getElementById(id);

// Sign and word of the link, and what is read out when it comes to that
const LINKS = {
  connecting: ["ring", "Connecting", ""],
  waiting: ["ring", "Waiting for the robot", ""],
  live: ["dot", "Live", "Live again."],
  recorded: ["record", "Recorded run", ""],
  stale: ["warning", "STALE", "Stale: the mapping unit is silent."],
  silent: ["warning", "STALE", "Stale: nothing from the robot."],
  ended: ["stop", "Ended", "The server of this page has ended."],
  lost: ["cross", "No connection", "No connection to this page's server."],
};

const MEMORY_KB = 1024;

function since(age) {
  if (age === null) return "never";
  if (age < 10) return `${age.toFixed(1)} s`;
  if (age < 120) return `${Math.round(age)} s`;
  return age < 7200 ? `${Math.round(age / 60)} min` : `${Math.round(age / 3600)} h`;
}

function set(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function icon(element, name) {
  const href = `#i-${name}`;
  const use = element.querySelector("use");
  if (use.getAttribute("href") !== href) use.setAttribute("href", href);
}

export class Panel {
  constructor(model) {
    this.model = model;
    this.rows = new Map();
  }

  show() {
    this.#showLink();
    this.#showMission();
    showVitals(this.model);
    this.#showModules();
  }

  #showLink() {
    const { model } = this;
    const state = model.state;
    const [sign, word, said] = LINKS[state];
    if (said !== LINKS.live[2] || $("said").textContent) set($("said"), said);
    document.body.dataset.link = state;
    icon($("link"), sign);
    set($("link").querySelector("span"), state === "recorded" ? `${word}, ${model.recorded}` : word);
    const text = this.#warning(state);
    $("banner").hidden = !text;
    set($("banner").querySelector("span"), text);
    $("empty").hidden = Boolean(model.box);
    const missing = ["lost", "ended", "connecting"].includes(state) ? "Waiting for the server" : "Waiting for the first map";
    set($("empty").querySelector("p"), missing);
    const { progress } = this.model;
    $("progress").hidden = progress === 1;
    $("progress").querySelector("progress").value = progress;
    set($("progress").querySelector("span"), `Receiving the map: ${Math.floor(100 * progress)} %`);
    set($("robot-name"), model.robot);
  }

  #warning(state) {
    const age = since(this.model.age("pose"));
    const last = this.model.pose ? ` Last known position and map, ${age} old.` : "";
    if (this.model.refusal) return `The server refuses this page. ${this.model.refusal}`;
    if (state === "ended") {
      const again = this.model.run ? ` To see the run again: indoor-mapping view ${this.model.run}` : "";
      return `The server of this page has ended.${again || last}`;
    }
    if (state === "lost") return `No connection to this page's server; trying again.${last}`;
    if (state === "silent") return `STALE: nothing from the robot for ${since(this.model.age("robot"))}.${last}`;
    if (state === "stale") return `STALE: the mapping unit is silent.${last}`;
    if (state === "live" && !this.model.pose.valid) return "The robot is not sure where it is.";
    return "";
  }

  #showMission() {
    const { plan, mission, pose, driven, state } = this.model;
    const live = state === "live" || state === "recorded";
    const phase = mission ? mission.stage : "wait";
    const text = mission?.text ?? (state === "recorded" ? "recorded run" : "waiting for the robot");
    const known = live || !mission ? text : `last known: ${text}`;
    set($("mission-state"), known.charAt(0).toUpperCase() + known.slice(1));
    const items = [...$("phases").children];
    const at = items.findIndex((item) => item.dataset.phase === phase);
    items.forEach((item, k) => {
      item.className = k < at || phase === "done" ? "past" : k === at ? "now" : "";
      if (k === at) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
    });
    this.#showMotion(mission, state === "live");
    set($("area"), plan && plan.area_m2 !== null ? `${plan.area_m2.toFixed(0)} m²` : "–");
    set($("driven"), this.model.trail.length ? `${driven.toFixed(driven < 100 ? 1 : 0)} m` : "–");
    set($("halls"), mission ? mission.halls : "–");
    set($("position"), pose ? place(pose) + (live ? "" : ` (${since(this.model.age("pose"))} ago)`) : "–");
  }

  #showMotion(mission, live) {
    const element = $("permit");
    element.dataset.known = Boolean(mission && live);
    if (!mission) return;
    element.dataset.granted = !mission.standing;
    icon(element, mission.standing ? "stop" : "check");
    set(element.querySelector("span"), mission.standing ? `Stands still: ${mission.standing}` : "May move");
  }

  #showModules() {
    const { modules, state } = this.model;
    let healthy = 0;
    for (const module of modules) {
      const recorded = state === "recorded" && module.state; // as it ended: nothing is silent since
      const age = recorded ? 0 : this.model.age(module.name);
      const health = age === null ? "absent" : age > STALE_S ? "silent" : !module.ready || module.error ? "fault" : "well";
      if (health === "well") healthy++;
      this.#showModule(module, health, age);
    }
    const sum = modules.length ? `${healthy} of ${modules.length} well` : "";
    set($("modules-sum"), sum);
    const { skipped } = this.model;
    set($("skipped"), skipped ? `This browser was too slow for ${skipped} positions; it skipped them.` : "");
  }

  #showModule(module, health, age) {
    let row = this.rows.get(module.name);
    if (!row) {
      row = document.createElement("li");
      row.innerHTML = `<svg aria-hidden="true"><use></use></svg><b></b><span></span><small></small><p hidden></p>`;
      this.rows.set(module.name, row);
      $("module-list").append(row);
    }
    row.dataset.health = health;
    icon(row, { well: "check", fault: "warning", silent: "cross", absent: "ring" }[health]);
    set(row.querySelector("b"), module.title);
    const memory = module.memory_kb ? ` · ${(module.memory_kb / MEMORY_KB).toFixed(module.memory_kb < 10240 ? 1 : 0)} MB` : "";
    const cpu = module.cpu_share ? ` · ${Math.max(1, Math.round(100 * module.cpu_share))} % cpu` : "";
    const said = { absent: "not there", silent: `silent for ${since(age)}` }[health] ?? module.state + memory + cpu;
    set(row.querySelector("span"), said);
    set(row.querySelector("small"), module.error ? `${module.error}: ${module.meaning}; ${module.action}` : "");
    showHealth(row.querySelector("p"), this.model.health.modules[module.name], this.model.health.sample_s);
    row.title = module.detail || "";
  }
}
