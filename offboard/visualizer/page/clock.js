// Two clocks: this page's own, and what the server's shows. All ages are counted with them.

const SLEEP_S = 0.5; // by so much the time of day has to run ahead of the browser's counter to count as sleep
const DRIFT = 1e-3; // of two clocks, in seconds per second, widely
const SLACK_S = 0.05;

let own = 0, counter = performance.now(), time = Date.now();

// Seconds since the page was opened. A machine that sleeps stops the browser's counter, but not the time of day.
export function seconds() {
  const passed = (performance.now() - counter) / 1000, slept = (Date.now() - time) / 1000 - passed;
  [counter, time] = [performance.now(), Date.now()];
  own += passed + (slept > SLEEP_S ? slept : 0);
  return own;
}

// The difference is known to half a round trip, so the shortest counts until the clocks may have drifted by more.
export class ServerClock {
  constructor() {
    this.ahead = null; // of this page's, in seconds
    this.doubt = 0;
    this.at = 0;
  }

  // A message left here at `left`, lay at the server for `held`, and its answer was written there at `written`
  take(left, held, written) {
    const now = seconds();
    const doubt = Math.max(0, now - left - held) / 2;
    const ahead = written - (now - doubt);
    const grown = this.doubt + (now - this.at) * DRIFT;
    const moved = Math.abs(ahead - this.ahead) > doubt + grown + SLACK_S; // one of the clocks was set
    if (this.ahead === null || doubt <= grown || moved) [this.ahead, this.doubt, this.at] = [ahead, doubt, now];
  }

  // When that was on this page's clock
  here(serverSeconds) {
    return serverSeconds - this.ahead;
  }
}
