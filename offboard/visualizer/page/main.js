// Joins the parts of the page: link -> model -> map, markers, list, dialog, panel.

import { Alerts } from "./alerts.js";
import { comparison } from "./comparison.js";
import { DoorForm } from "./door_form.js";
import { Gestures } from "./gestures.js";
import { Link } from "./link.js";
import { LogList } from "./log_list.js";
import { MapView } from "./map_view.js";
import { Markers } from "./markers.js";
import { Model } from "./model.js";
import { Panel } from "./panel.js";
import { PoiDialog } from "./poi_dialog.js";
import { PoiList } from "./poi_list.js";
import { Orders } from "./orders.js";
import { ReleaseForm } from "./release_form.js";
import { place } from "./poi_text.js";
import { Paper } from "./paper.js";
import { ScreenScale } from "./screen_scale.js";
import { Timeline } from "./timeline.js";
import { Zones } from "./zones.js";

const AGE_PERIOD_MS = 200;
const CLOSE_UP = 34; // CSS pixels per metre, to look at a point of interest
// Where a channel changes the map. A grid is drawn when it is unpacked, and the trail grows below the robot
const DRAWN = { zones: "above", ranges: "above", pose: "below", map: "below", trail: "below", pois: "below", plan: "above", mission: "above" };
const $ = (id) => document.getElementById(id);

export const model = new Model();
const panel = new Panel(model);
const alerts = new Alerts(model);
const screenScale = new ScreenScale(() => showTools());
let selected = null;

const open = (id) => dialog.open(id);
const markers = new Markers($("markers"), open);
const list = new PoiList(open);
export const map = new MapView($("stage"), model, () => {
  markers.place(map.view, selected);
  showTools();
});
const gestures = new Gestures(map, showTools);
const orders = new Orders(model, {
  send: (message) => link.send(message),
  picking: (onPick) => {
    if (onPick) zones.leave();
    gestures.pick(onPick);
  },
});
const releaseForm = new ReleaseForm(orders);
const zones = new Zones(map, orders, (onPick) => gestures.pick(onPick));
const timeline = new Timeline(model, (message) => link.send(message));
const log = new LogList(model, (at_s) => timeline.jump(at_s));
const paper = new Paper(map, model, screenScale);
const doorForm = new DoorForm(orders);
const dialog = new PoiDialog({
  find: (id) => model.pois.find((poi) => poi.poi_id === id),
  neighbours: () => list.shown,
  place: (poi) => `${place(poi)} from the start`,
  show: centre,
  drive: (poi) => orders.goto(poi.x_m, poi.y_m),
  mayDrive: () => orders.allowed,
  onShow: (poi) => doorForm.show(poi),
  onSelect: (id) => {
    selected = id ?? selected;
    list.select(selected);
    map.draw(false);
  },
});

function centre(poi, focus = false) {
  map.mode = "free";
  [map.view.x, map.view.y] = [poi.x_m, poi.y_m];
  map.view.scale = Math.max(map.view.scale, CLOSE_UP);
  map.draw();
  if (!focus) return;
  $("stage").scrollIntoView({ block: "nearest" });
  document.querySelector(`.marker[data-poi="${poi.poi_id}"]`)?.focus();
}

function take(channel, message) {
  model.take(channel, message);
  if (channel === "hello") offer(message.exports);
  if (channel === "hello" && message.over && !model.comparison) compare();
  if (channel === "pois") {
    markers.set(model.pois);
    list.set(model.pois);
    dialog.refresh();
    dialog.followAddress();
  }
  if (channel === "grid") map.redecode();
  if (channel === "playback") timeline.show();
  if (channel === "log") log.show();
  if (channel === "playback") log.mark();
  if (channel === "playback" || channel === "moments") timeline.showMoments();
  if (channel === "alerts" || channel === "hello") alerts.show();
  if (channel === "operator" || channel === "hello") orders.show();
  if (["operator", "hello", "zones"].includes(channel)) {
    zones.show();
    releaseForm.show();
  }
  const drawn = DRAWN[channel];
  if (drawn) map.draw(drawn === "below");
}

async function compare() {
  model.comparison = await comparison();
  const [title, text, here, there] = $("over").children;
  title.textContent = `${model.over} over ${model.robot}`;
  text.textContent = model.comparison.text;
  here.querySelector("span").textContent = `only in ${model.robot}`;
  there.querySelector("span").textContent = `only in ${model.over}`;
  $("over").hidden = false;
  map.draw();
}

function offer(exports) {
  const links = exports.map(({ form, title }) => {
    const link = document.createElement("a");
    link.href = `export/map.${form}`;
    link.download = "";
    const name = document.createElement("b");
    name.textContent = form.toUpperCase();
    link.append(name, ` ${title}`);
    return link;
  });
  $("print").parentElement.replaceChildren(...links, $("print"), $("print-note"));
  const pdf = exports.some(({ form }) => form === "pdf");
  $("print-note").textContent = `For 1 cm on paper for 1 m ${pdf ? "print the PDF" : "print with another program"}:
    a browser prints only the first 19 cm of a wide SVG, and ignores a PNG's resolution.`;
}

function showTools() {
  const pressed = {
    fit: map.mode === "fit",
    follow: map.mode === "follow",
    ruler: gestures.measuring,
    scale: Math.abs(map.view.scale / screenScale.pixelsPerCm - 1) < 1e-3,
  };
  for (const [name, on] of Object.entries(pressed)) {
    document.querySelector(`[data-act="${name}"]`).setAttribute("aria-pressed", on);
  }
  $("stage").classList.toggle("measuring", pressed.ruler);
  screenScale.showBar($("scale-bar"), map.view.scale);
  const cursor = gestures.cursor;
  const [x_m, y_m] = cursor ? map.view.toMap(...cursor) : [];
  $("where").value = cursor ? place({ x_m, y_m }) : "";
}

function act(name) {
  if (name === "scale") {
    map.mode = map.mode === "follow" ? "follow" : "free";
    map.view.scale = screenScale.pixelsPerCm;
    map.draw();
  } else gestures.act(name);
}

const KEYS = { "+": "in", "=": "in", "-": "out", 0: "fit", f: "follow", 1: "scale", "[": "left", "]": "right", r: "ruler" };

function key(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
  if (event.target.matches("input, select")) return;
  if (event.key === "Escape") $("export").open = false;
  if (event.key === " " && event.target.matches("body, canvas")) {
    event.preventDefault();
    if (model.playback) timeline.toggle();
    else orders.stop();
  }
  if (event.key === "Escape" && orders.going) orders.leave();
  if (event.key === "Escape" && zones.drawing) zones.leave();
  if (event.key === "/") {
    event.preventDefault();
    $("search").focus();
  } else if (event.key === "Escape" && gestures.measuring) act("ruler");
  else if (KEYS[event.key.toLowerCase()]) act(KEYS[event.key.toLowerCase()]);
}

document.querySelector(".tools").onclick = ({ target }) => {
  const button = target.closest("[data-act]");
  if (button) act(button.dataset.act);
};
for (const part of document.querySelectorAll("details.modules")) {
  part.ontoggle = () => part.open && part.scrollIntoView({ block: "nearest" });
}
addEventListener("keydown", key);
addEventListener("beforeprint", () => paper.begin());
addEventListener("afterprint", () => paper.end());
$("print").onclick = () => print();
$("scale-bar").onclick = () => screenScale.open();
addEventListener("click", ({ target }) => {
  if (!$("export").contains(target) || target.closest(".menu-list")) $("export").open = false;
});

const link = new Link({
  onMessage: take,
  onState: (...state) => {
    model.link(...state);
    panel.show();
    orders.show();
    zones.show();
    releaseForm.show();
    map.draw(false);
  },
  held: () => model.held,
});
let state = "";
setInterval(() => {
  panel.show();
  alerts.show();
  if (state !== model.state) map.draw(false);
  state = model.state;
}, AGE_PERIOD_MS);
panel.show();
