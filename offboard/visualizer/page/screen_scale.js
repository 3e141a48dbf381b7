// How many CSS pixels are a centimetre on this very screen. A browser takes 96 for an inch, and most screens differ:
// a bank card held against the screen tells.

const CSS_PIXELS_PER_CM = 96 / 2.54;
const CARD_CM = 8.56;
const KEY = "css-pixels-per-cm";
const BAR_PX = 110; // the bar is at most that long, and a round number of metres

export class ScreenScale {
  constructor(onChange) {
    this.pixelsPerCm = Number(localStorage.getItem(KEY)) || CSS_PIXELS_PER_CM;
    this.onPaper = false; // where an inch is an inch
    this.dialog = document.getElementById("screen");
    this.slider = document.getElementById("card-size");
    this.outline = document.getElementById("card-outline");
    this.slider.oninput = () => this.#set(Number(this.slider.value) / CARD_CM, onChange);
    this.dialog.onclick = ({ target }) => {
      if (target.dataset.do === "reset") this.#set(CSS_PIXELS_PER_CM, onChange);
      if (target.dataset.do === "close" || target === this.dialog) this.dialog.close();
    };
    this.#show();
  }

  // 1 cm for 1 m on this screen stays that on paper
  get toPaper() {
    return CSS_PIXELS_PER_CM / this.pixelsPerCm;
  }

  open() {
    this.dialog.showModal();
  }

  #set(pixelsPerCm, onChange) {
    this.pixelsPerCm = pixelsPerCm;
    localStorage.setItem(KEY, pixelsPerCm);
    this.#show();
    onChange();
  }

  #show() {
    this.slider.value = Math.round(this.pixelsPerCm * CARD_CM);
    this.outline.style.width = `${this.pixelsPerCm * CARD_CM}px`;
  }

  showBar(bar, scale) {
    const metres = [50, 20, 10, 5, 2, 1, 0.5, 0.2, 0.1].find((m) => m * scale <= BAR_PX) ?? 0.05;
    bar.querySelector("i").style.width = `${metres * scale}px`;
    const ratio = Math.round((100 * (this.onPaper ? CSS_PIXELS_PER_CM : this.pixelsPerCm)) / scale);
    bar.querySelector("span").textContent = `${metres} m · 1 : ${ratio}`;
  }
}
