// Calls a person who looks elsewhere (offboard/operate/alerts.py): by the page's title, a notice, and a sound where that
// was switched on. What is so when the page is opened is no news.

import { seconds } from "./clock.js";

const QUIET_S = 30; // as in the terminal: what was over for less than that and is there again is nothing new
const KEY = "sound";
const TONES = [[660, 0], [880, 0.18], [660, 0.36]]; // Hz, from that second on
const TONE_S = 0.16;
const $ = (id) => document.getElementById(id);

export class Alerts {
  constructor(model) {
    this.model = model;
    this.seen = null; // when each was so last
    this.calling = ""; // a sentence that nobody has taken notice of
    this.audio = null;
    this.#setSound(localStorage.getItem(KEY) === "on");
    $("sound").onclick = () => this.#setSound(!this.sound, true);
    $("notice").querySelector("button").onclick = () => ($("notice").hidden = true);
    for (const name of ["pointerdown", "keydown"]) addEventListener(name, () => this.#call(""));
  }

  show() {
    const { alerts, robot, recorded } = this.model;
    if (!this.calling) document.title = robot ? `${robot} · Indoor Mapping` : "Indoor Mapping";
    $("sound").hidden = Boolean(recorded); // of what is over nobody is called
    if (recorded || !alerts) return;
    const now = seconds();
    const news = Object.keys(alerts).filter((key) => this.seen && now - (this.seen[key] ?? -Infinity) > QUIET_S);
    this.seen ??= {};
    for (const key of Object.keys(alerts)) this.seen[key] = now;
    if (news.length) this.#tell(news.map((key) => alerts[key]).join(" "));
    if (!Object.keys(alerts).length) $("notice").hidden = true;
  }

  #tell(text) {
    $("notice").querySelector("span").textContent = text;
    $("notice").hidden = false;
    this.#call(text);
    if (this.sound) this.#ring();
  }

  #call(text) {
    if (this.calling === text) return;
    this.calling = text;
    if (text) document.title = `(!) ${text}`;
    else this.show();
  }

  #setSound(on, chosen = false) {
    this.sound = on;
    localStorage.setItem(KEY, on ? "on" : "off");
    $("sound").setAttribute("aria-pressed", on);
    $("sound").querySelector("use").setAttribute("href", on ? "#i-bell" : "#i-bell-off");
    if (on && chosen) this.#ring(); // a browser lets a page sound from a click on
  }

  #ring() {
    this.audio ??= new AudioContext();
    this.audio.resume();
    for (const [hertz, from] of TONES) {
      const tone = new OscillatorNode(this.audio, { frequency: hertz });
      const level = new GainNode(this.audio, { gain: 0.12 });
      tone.connect(level).connect(this.audio.destination);
      tone.start(this.audio.currentTime + from);
      tone.stop(this.audio.currentTime + from + TONE_S);
    }
  }
}
