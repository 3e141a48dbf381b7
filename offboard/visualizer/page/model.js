// The page's copy of what the server knows: messages -> values, and how old they are.

import { Walls, grown } from "./walls.js";

export const STALE_S = 1.0;

const seconds = () => performance.now() / 1000;

export class Model {
  constructor() {
    this.connected = null; // null before the first connection
    this.robot = "";
    this.pose = null;
    this.plan = null;
    this.mission = null; // in the server's words
    this.pois = [];
    this.modules = [];
    this.modulesAt = 0;
    this.skipped = 0;
    this.walls = new Walls();
    this.base = [0, 0]; // lower left corner of the drawing, in map coordinates
    this.grid = null;
    this.trail = []; // x, y, x, y ...
    this.driven = 0; // metres
    this.since = {}; // when "pose" and "robot" were fresh, on this page's clock
  }

  take(channel, message) {
    const taker = this[`_${channel}`];
    if (taker) taker.call(this, message);
  }

  age(name) {
    return this.since[name] === undefined ? null : seconds() - this.since[name];
  }

  // connecting, lost: no server. waiting: no robot yet. silent, stale: no data from it, or no pose. live.
  get state() {
    const pose = this.age("pose");
    if (this.connected === null) return "connecting";
    if (!this.connected) return "lost";
    if (pose === null) return "waiting";
    if (pose <= STALE_S) return "live";
    return this.age("robot") > STALE_S ? "silent" : "stale";
  }

  // Everything that is drawn, or null
  get box() {
    let box = this.walls.box;
    for (let k = 0; k < this.trail.length; k += 2) box = grown(box, this.trail[k], this.trail[k + 1]);
    for (const poi of this.pois) box = grown(box, poi.x_m, poi.y_m);
    if (this.pose) box = grown(box, this.pose.x_m, this.pose.y_m);
    return box;
  }

  // A restarted server may not have received it yet, while this page has
  #fresh(name, age) {
    if (age !== null) this.since[name] = seconds() - age;
  }

  _hello(message) {
    this.robot = message.robot;
  }

  _heartbeat(message) {
    for (const [name, age] of Object.entries(message.age_s)) this.#fresh(name, age);
    this.modules = message.modules;
    this.modulesAt = seconds();
    this.skipped = message.skipped;
  }

  _pose(message) {
    this.pose = message;
    this.#fresh("pose", message.age_s);
    this.#drive(message.x_m, message.y_m);
  }

  _map(message) {
    const points = new Float32Array(message.body, 0, 2 * message.count);
    const inferred = new Uint8Array(message.body, 8 * message.count, message.count);
    if (message.start === 0) this.walls = new Walls();
    this.walls.add(points, inferred);
    this.base = message.base;
  }

  _trail(message) {
    const points = new Float32Array(message.body);
    this.trail = [];
    this.driven = 0;
    for (let k = 0; k < points.length; k += 2) this.#drive(points[k], points[k + 1]);
    if (this.pose) this.#drive(this.pose.x_m, this.pose.y_m);
  }

  #drive(x, y) {
    const trail = this.trail;
    const step = trail.length ? Math.hypot(x - trail[trail.length - 2], y - trail[trail.length - 1]) : Infinity;
    if (step < 0.05) return;
    if (step < Infinity) this.driven += step;
    trail.push(x, y);
  }

  _grid(message) {
    this.grid = message;
  }

  _plan(message) {
    this.plan = message;
  }

  _mission(message) {
    this.mission = message;
  }

  _pois(message) {
    this.pois = message.pois;
  }
}
