// The WebSocket to the server (offboard/visualizer/protocol.py): messages -> `onMessage(channel, message)`. It confirms
// what it has received (offboard/visualizer/outbound.py), and connects again by itself: the server then goes on with the
// map where this page has it. Whether the data are fresh is judged by their age alone.

import { seconds } from "./clock.js";

const RETRY_FIRST_S = 0.3;
const RETRY_MAX_S = 2;
const SILENT_S = 3; // a socket without a message for so long counts as lost, even while the browser shows it as open
const CONFIRM_BYTES = 2000;
const LEFT = [1001, 1012]; // the server ended as it should: by its own word, or by its library's

function decode(data) {
  if (typeof data === "string") return JSON.parse(data);
  const length = new DataView(data).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  message.body = data.slice(4 + length);
  return message;
}

export class Link {
  // `held()`: what this page has of the map, for a server that it comes back to
  constructor({ onMessage, onState, held }) {
    Object.assign(this, { onMessage, onState, held });
    this.retryS = RETRY_FIRST_S;
    this.receivedS = 0;
    this.everOpened = false;
    setInterval(() => this.#watch(), 500);
    this.#connect();
  }

  #connect() {
    const url = new URL("live", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    url.hash = "";
    url.search = new URLSearchParams({ held: this.held() });
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.bytes = this.confirmed = 0;
    this.parts = {};
    this.receivedS = seconds();
    socket.onopen = () => this.#confirm();
    socket.onmessage = ({ data }) => this.socket === socket && this.#receive(data);
    socket.onclose = ({ code }) => this.#lost(socket, code);
  }

  #receive(data) {
    this.receivedS = seconds();
    this.retryS = RETRY_FIRST_S;
    this.bytes += typeof data === "string" ? data.length : data.byteLength;
    let message = decode(data);
    if (message.channel === "heartbeat" || this.bytes - this.confirmed >= CONFIRM_BYTES) this.#confirm();
    if (message.channel === "part") message = this.#joined(message);
    if (message?.channel === "hello") {
      this.everOpened = true;
      this.onState(true);
    }
    if (message) this.onMessage(message.channel, message);
  }

  // An order; false where nobody is there to take it
  send(message) {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  #confirm() {
    if (this.socket.readyState !== WebSocket.OPEN) return;
    this.confirmed = this.bytes;
    this.socket.send(JSON.stringify({ received: this.bytes, at: seconds() }));
  }

  // The whole message once its last part is there
  #joined({ of, start, total, text, body }) {
    if (start === 0) this.parts[of] = new Uint8Array(total);
    this.parts[of].set(new Uint8Array(body), start);
    if (start + body.byteLength < total) return null;
    const whole = this.parts[of];
    delete this.parts[of];
    return decode(text ? new TextDecoder().decode(whole) : whole.buffer);
  }

  #lost(socket, code) {
    if (this.socket !== socket) return;
    this.socket = null;
    this.onState(false, LEFT.includes(code));
    setTimeout(() => this.#connect(), 1000 * this.retryS);
    this.retryS = Math.min(2 * this.retryS, RETRY_MAX_S);
    if (!this.everOpened) this.#askWhy();
  }

  // A browser does not tell a page why its socket was refused
  async #askWhy() {
    try {
      const answer = await fetch(`refusal?${new URLSearchParams({ origin: location.origin })}`);
      if (answer.ok && !this.everOpened) this.onState(false, false, await answer.text());
    } catch {
      // Nobody is there: the page shows that already
    }
  }

  #watch() {
    const socket = this.socket;
    if (socket && seconds() - this.receivedS > SILENT_S) {
      this.#lost(socket);
      socket.close();
    }
  }
}
