// The WebSocket to the server (offboard/visualizer/protocol.py): messages -> `onMessage(channel, message)`. It connects
// again by itself; the server then sends everything anew. Whether the data are fresh is judged by their age alone.

const RETRY_FIRST_MS = 300;
const RETRY_MAX_MS = 2000;
const SILENT_MS = 3000; // a socket without a message for so long counts as lost, even while the browser shows it as open

function decode(data) {
  if (typeof data === "string") return JSON.parse(data);
  const length = new DataView(data).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  message.body = data.slice(4 + length);
  return message;
}

export class Link {
  constructor(onMessage, onState) {
    this.onMessage = onMessage;
    this.onState = onState;
    this.retryMs = RETRY_FIRST_MS;
    this.heardMs = 0;
    setInterval(() => this.#watch(), 500);
    this.#connect();
  }

  #connect() {
    const url = new URL("live", location.href);
    url.protocol = url.protocol.replace("http", "ws");
    url.hash = "";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heardMs = performance.now();
    socket.onmessage = (event) => {
      if (this.socket !== socket) return;
      this.heardMs = performance.now();
      this.retryMs = RETRY_FIRST_MS;
      const message = decode(event.data);
      if (message.channel === "hello") this.onState(true);
      this.onMessage(message.channel, message);
    };
    socket.onclose = () => this.#lost(socket);
  }

  #lost(socket) {
    if (this.socket !== socket) return;
    this.socket = null;
    this.onState(false);
    setTimeout(() => this.#connect(), this.retryMs);
    this.retryMs = Math.min(2 * this.retryMs, RETRY_MAX_MS);
  }

  #watch() {
    const socket = this.socket;
    if (socket && performance.now() - this.heardMs > SILENT_MS) {
      this.#lost(socket);
      socket.close();
    }
  }
}
