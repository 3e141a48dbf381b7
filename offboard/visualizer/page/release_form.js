// The release of a latched stop: a typed word, and only while the robot's other sources are clear. It names the stop that was
// shown: one that somebody pressed since stays.

const WORD = "release";

export class ReleaseForm {
  constructor(orders) {
    this.orders = orders;
    this.form = document.getElementById("release");
    this.wrong = "";
    this.form.onsubmit = (event) => {
      event.preventDefault();
      this.#send();
    };
  }

  show() {
    const { operator } = this.orders.model;
    const latched = this.orders.allowed && operator.stop === "LATCHED";
    if (!latched || operator.epoch !== this.epoch) this.#clear();
    this.epoch = operator?.epoch;
    this.form.hidden = !latched;
    this.form.querySelector("button").disabled = Boolean(operator?.latched);
    this.form.querySelector("output").textContent = operator?.latched || this.wrong;
  }

  #clear() {
    this.form.reset();
    this.wrong = "";
  }

  #send() {
    const typed = this.form.elements.word.value.trim().toLowerCase();
    if (typed === WORD) this.orders.give({ order: "release", epoch: this.epoch });
    this.wrong = typed === WORD ? "" : `Nothing was released: the word is ${WORD}.`;
    this.show();
  }
}
