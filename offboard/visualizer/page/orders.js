// What a person orders here: the stop, and everything else where this page may (offboard/visualizer/operator.py). The
// server repeats it until the robot confirms; what is shown of it is what the robot reports.

const $ = (id) => document.getElementById(id);

// By the states of the stop in offboard/operate/software_stop.py: word, and what it means
const STOPS = {
  IDLE: ["Stop", "Software stop. The button on the robot is the emergency stop."],
  SENT: ["Stop sent", "Not confirmed yet: use the button on the robot."],
  LATCHED: ["Stopped", "The robot holds the stop and stands. Release it here, in the Command Center, or by the verb release; then resume."],
  UNKNOWN: ["Stop", "The robot does not know yet which stop its board holds."],
  RELEASED: ["Stop", "The stop is released; nothing moves before a resume."],
  LINK_LOST: ["Stop", "The robot is not received: use the button on the robot."],
};

export class Orders {
  // `send(message)` to the server; `picking(onPick)` takes the next click on the map, null takes none
  constructor(model, { send, picking }) {
    Object.assign(this, { model, send, picking });
    this.going = false; // the next click is where to drive
    this.prompt = () => ""; // what else waits for clicks, in words
    this.stops = document.querySelectorAll(".stop"); // one in every dialog too: those cover the rest of the page
    for (const button of this.stops) button.onclick = () => this.stop();
    $("orders").onclick = ({ target }) => this.#order(target.closest("[data-order]")?.dataset.order);
  }

  stop() {
    this.send({ order: "stop" });
  }

  goto(x_m, y_m) {
    this.#go(false);
    this.give({ order: "goto", x_m, y_m });
  }

  give(message) {
    this.send({ ...message, token: this.model.token });
  }

  leave() {
    this.#go(false);
  }

  get allowed() {
    const { operator, state, token } = this.model;
    return Boolean(token && operator && !operator.hindrance && state !== "lost" && state !== "ended");
  }

  get hindrance() {
    const { operator, token } = this.model;
    if (!operator) return "";
    return operator.hindrance || (token ? "" : "Orders are given on the machine that serves this page; a stop everywhere.");
  }

  #order(name) {
    if (name === "goto") this.#go(!this.going);
    else if (name) this.give({ order: name });
  }

  #go(on) {
    this.going = on;
    this.picking(on ? ([x_m, y_m]) => this.goto(x_m, y_m) : null);
    this.show();
  }

  show() {
    const { operator } = this.model;
    const here = Boolean(operator) && !this.model.recorded;
    $("orders").hidden = !here;
    for (const button of this.stops) button.hidden = !here;
    if (!here) return;
    const [word, meaning] = STOPS[operator.stop] ?? STOPS.LINK_LOST;
    for (const button of this.stops) {
      button.dataset.stop = operator.stop;
      button.title = meaning;
      button.querySelector("span").textContent = word;
    }
    for (const button of $("orders").querySelectorAll("button")) button.disabled = !this.allowed;
    $("orders").querySelector('[data-order="goto"]').setAttribute("aria-pressed", this.going);
    const asked = this.prompt() || (this.going ? "Click on the floor or on a door: the robot drives there. Esc ends." : "");
    const stopped = ["SENT", "LATCHED", "RELEASED"].includes(operator.stop) ? meaning : "";
    const text = asked || this.hindrance || stopped || operator.answer;
    if ($("answer").textContent !== text) $("answer").textContent = text;
  }
}
