// A recorded run's timeline (offboard/visualizer/playback.py): play, pause, speed, jump, and the moments worth a look.

const $ = (id) => document.getElementById(id);

export const clock = (s) => `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, "0")}`;

export class Timeline {
  // `send(message)` to the server
  constructor(model, send) {
    Object.assign(this, { model, send });
    this.held = false; // the slider is in somebody's hand
    $("play").onclick = () => this.toggle();
    $("speed").onchange = () => this.model.playback?.speed && this.#show(null, this.speed);
    $("at").oninput = () => {
      this.held = true;
      this.#label(Number($("at").value));
    };
    $("at").onchange = () => {
      this.held = false;
      this.jump(Number($("at").value));
    };
    $("moments").onclick = ({ target }) => target.dataset.at && this.jump(Number(target.dataset.at));
  }

  get speed() {
    return Number($("speed").value);
  }

  toggle() {
    if (this.model.playback) this.#show(null, this.model.playback.speed ? 0 : this.speed);
  }

  jump(at_s) {
    this.#show(at_s, this.model.playback.speed);
  }

  #show(at_s, speed) {
    this.send({ replay: { at_s, speed } });
  }

  show() {
    const { playback } = this.model;
    $("timeline").hidden = !playback;
    if (!playback) return;
    $("play").setAttribute("aria-label", playback.speed ? "Pause" : "Play");
    $("play").querySelector("use").setAttribute("href", playback.speed ? "#i-pause" : "#i-play");
    $("at").max = playback.duration_s;
    if (this.held) return;
    $("at").value = playback.at_s;
    this.#label(playback.at_s);
  }

  #label(at_s) {
    const text = `${clock(at_s)} / ${clock(this.model.playback.duration_s)}`;
    $("clock").value = text;
    $("at").setAttribute("aria-valuetext", text);
  }

  showMoments() {
    const { moments, playback } = this.model;
    const end = playback?.duration_s || Math.max(1, ...moments.map(({ at_s }) => at_s));
    $("moments").replaceChildren(
      ...moments.map(({ at_s, kind, text }) => {
        const mark = document.createElement("button");
        mark.type = "button";
        mark.tabIndex = -1;
        mark.className = kind;
        mark.dataset.at = at_s;
        mark.title = text;
        mark.setAttribute("aria-label", text);
        mark.style.left = `${(100 * Math.min(at_s, end)) / end}%`;
        return mark;
      }),
    );
  }
}
