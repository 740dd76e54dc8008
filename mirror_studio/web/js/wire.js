// The connection to the server: requests in, answers out; it comes back by itself after a restart.

const MAGIC = 0x3153434d; // "MCS1"
const MOST_IN_FLIGHT = 2;
const RETRY_MS = [150, 300, 600, 1000, 2000];
export const SILENT = "the studio's server does not answer";

export class Wire {
  constructor(handlers) {
    this.handlers = handlers; // shown, failed, probed, building, built, unbuilt, connected, lost
    this.id = 0;
    this.flying = new Map(); // id → {sent, fine}
    this.next = null;
    this.tries = 0;
    this.connect();
  }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}/ws`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.tries = 0; this.handlers.connected(); };
    this.socket.onmessage = (event) => this.receive(event.data);
    this.socket.onclose = (event) => {
      this.flying.clear();
      this.handlers.lost(event.reason);
      setTimeout(() => this.connect(), RETRY_MS[Math.min(this.tries++, RETRY_MS.length - 1)]);
    };
  }

  get open() { return this.socket.readyState === WebSocket.OPEN; }

  // The newest design wins: one that has not been sent yet is forgotten.
  design(request) {
    this.next = request;
    this.send();
  }

  send() {
    if (!this.next || !this.open || this.flying.size >= MOST_IN_FLIGHT) return;
    const request = this.next;
    this.next = null;
    const id = ++this.id;
    this.flying.set(id, { sent: performance.now(), fine: request.fine, changed: request.changed });
    const { spec, look, fine } = request;
    this.socket.send(JSON.stringify({ type: "design", id, spec, look, fine }));
  }

  ask(message) {
    if (!this.open) return 0;
    const id = ++this.id;
    this.socket.send(JSON.stringify({ id, ...message }));
    return id;
  }

  receive(data) {
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.type === "error" || message.type === "stopped") {
        const flight = this.land(message);
        if (message.type === "error") this.handlers.failed(message, flight);
        return;
      }
      this.handlers[message.type]?.(message);
      return;
    }
    const message = unpack(data);
    if (message.type !== "shown") { this.handlers[message.type]?.(message); return; } // beside the designs, or before one is done
    const flight = this.land(message);
    this.handlers.shown(message, flight);
  }

  land(message) {
    const flight = this.flying.get(message.id);
    for (const id of [message.id, ...message.dropped]) this.flying.delete(id);
    this.send();
    return flight;
  }
}

export function unpack(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== MAGIC) throw new Error("not a message of the studio");
  const length = view.getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  header.pictures = {};
  header.arrays = {};
  let at = 8 + length;
  for (const part of header.parts) {
    if (part.kind === "jpeg") header.pictures[part.name] = new Blob([new Uint8Array(buffer, at, part.bytes)], { type: "image/jpeg" });
    else header.arrays[part.name] = { data: new Float32Array(buffer, at, part.bytes / 4), shape: part.shape };
    at += part.bytes + ((4 - (part.bytes % 4)) % 4);
  }
  return header;
}

const sent = (path, body) => fetch(path, { method: "POST", body }).catch(() => { throw new Error(SILENT); });

export async function postForFile(path, body) {
  const answer = await sent(path, body);
  if (answer.ok) return answer.blob();
  const { faults } = await answer.json().catch(() => ({ faults: [`the server answered ${answer.status}`] }));
  throw new Faults(faults);
}

export async function post(path, body) {
  const answer = await sent(path, body);
  const content = await answer.json().catch(() => ({ faults: [`the server answered ${answer.status}`] }));
  if (content.faults) throw new Faults(content.faults);
  return content;
}

export class Faults extends Error {
  constructor(faults) {
    super(faults.join("\n"));
    this.faults = faults;
  }
}
