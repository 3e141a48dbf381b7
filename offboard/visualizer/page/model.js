// The page's copy of what the server knows: messages -> values, and how old they are.

import { ServerClock, seconds } from "./clock.js";
import { Walls, grown } from "./walls.js";

export const STALE_S = 1.0;

export class Model {
  constructor() {
    this.connected = null; // null before the first connection
    this.ended = false; // the server left as it should
    this.refusal = ""; // why it lets this page not in
    this.clock = new ServerClock();
    this.source = ""; // which model of the server the map comes from, and how often that was begun anew
    this.epoch = 0;
    this.robot = "";
    this.run = ""; // its folder, where it is recorded
    this.token = ""; // with which this page may give orders
    this.bearings = []; // of the sonars, left positive
    this.ranges = null; // their newest echoes
    this.vitals = null; // figures of battery, speed, time left, reception
    this.health = { sample_s: 1, modules: {} }; // memory and processor by module
    this.alerts = null; // sentence by what it is about
    this.operator = null; // {stop, answer, hindrance} of the robot's operator; null where only a run is shown
    this.playback = null; // of a recorded run: {at_s, duration_s, speed}
    this.moments = [];
    this.log = []; // its lines: {at_s, level, module, text}
    this.over = ""; // the run whose walls are shown too
    this.comparison = null; // {text, layers: [{name, walls}]} of both
    this.recorded = ""; // when that was; empty while the run goes on
    this.pose = null;
    this.plan = null;
    this.mission = null; // in the server's words
    this.pois = [];
    this.modules = [];
    this.skipped = 0;
    this.walls = new Walls();
    this.coming = this.walls; // the corrected map, of which not all has arrived yet
    this.total = 0; // points of it
    this.grid = null;
    this.zones = []; // no-go lines and areas: {number, kind, title, corners_m}
    this.trail = []; // x, y, x, y ...
    this.driven = 0; // metres
    this.since = {}; // when the last pose, anything from the "robot", a module's status arrived, on this page's clock
  }

  take(channel, message) {
    const taker = this[`_${channel}`];
    if (taker) taker.call(this, message);
  }

  age(name) {
    return this.since[name] === undefined ? null : Math.max(0, seconds() - this.since[name]);
  }

  // For a server that this page comes back to
  get held() {
    return `${this.source},${this.epoch},${this.coming.length}`;
  }

  // How much of the map has arrived, of 1
  get progress() {
    return this.total ? this.coming.length / this.total : 1;
  }

  link(connected, ended = false, refusal = "") {
    this.ended = !connected && (ended || this.ended);
    this.connected = connected;
    this.refusal = refusal;
  }

  // connecting, lost: no server. ended: it left as it should. recorded: no robot is meant. waiting: no robot yet.
  // silent, stale: no data from it, or no pose. live.
  get state() {
    const pose = this.age("pose");
    if (this.connected === null) return "connecting";
    if (!this.connected) return this.ended ? "ended" : "lost";
    if (this.recorded) return "recorded";
    if (this.clock.ahead === null) return "connecting";
    if (pose === null) return "waiting";
    if (pose <= STALE_S) return "live";
    return this.age("robot") > STALE_S ? "silent" : "stale";
  }

  // Echoes that are shown: of a run that is played those of that moment, else of the last second
  get freshRanges() {
    const fresh = this.recorded || (this.age("ranges") ?? Infinity) <= STALE_S;
    return this.ranges?.valid && fresh ? this.ranges.range_m : [];
  }

  // What a recorded run's files hold is shown at its end
  get atEnd() {
    return !this.playback || this.playback.at_s >= this.playback.duration_s;
  }

  // Everything that is drawn, or null
  get box() {
    let box = this.walls.box;
    for (const { walls } of this.comparison?.layers ?? []) {
      if (walls.box) box = grown(grown(box, walls.box[0], walls.box[1]), walls.box[2], walls.box[3]);
    }
    for (let k = 0; k < this.trail.length; k += 2) box = grown(box, this.trail[k], this.trail[k + 1]);
    for (const poi of this.pois) box = grown(box, poi.x_m, poi.y_m);
    if (this.pose) box = grown(box, this.pose.x_m, this.pose.y_m);
    return box;
  }

  // A restarted server may not have received it yet, while this page has
  #fresh(name, arrived) {
    if (this.clock.ahead !== null) this.since[name] = this.clock.here(arrived);
  }

  _hello(message) {
    for (const name of ["robot", "run", "recorded", "token", "over"]) this[name] = message[name];
    this.bearings = message.sonar_bearings_rad;
    if (message.model !== this.source) this.epoch = -1; // its map begins at its beginning
    this.source = message.model;
  }

  _heartbeat({ echo, now_s, arrived_s, skipped }) {
    if (echo) this.clock.take(...echo, now_s);
    for (const [name, arrived] of Object.entries(arrived_s)) this.#fresh(name, arrived);
    this.skipped = skipped;
  }

  _modules({ modules }) {
    this.modules = modules;
  }

  _pose(message) {
    this.pose = message;
    this.#fresh("pose", message.arrived_s);
    this.#drive(message.x_m, message.y_m);
  }

  _ranges(message) {
    this.ranges = message;
    this.#fresh("ranges", message.arrived_s);
  }

  _vitals(message) {
    this.vitals = message;
  }

  _health(message) {
    this.health = message;
  }

  _alerts({ alerts }) {
    this.alerts = alerts;
  }

  // A corrected map takes the old one's place once it is as complete
  _map({ epoch, start, count, total, body }) {
    if (start === 0) this.coming = new Walls();
    this.coming.add(new Float32Array(body, 0, 2 * count), new Uint8Array(body, 8 * count, count));
    [this.epoch, this.total] = [epoch, total];
    if (this.coming.length === total || !this.walls.length) this.walls = this.coming;
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

  _zones({ zones }) {
    this.zones = zones;
  }

  _operator(message) {
    this.operator = message;
  }

  _playback(message) {
    this.playback = message;
  }

  _moments({ moments }) {
    this.moments = moments;
  }

  _log({ lines }) {
    this.log = lines;
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
