// One WebSocket, opened again whenever it closes. Requests are answered by number.

const RETRY_MS = [200, 500, 1000, 1500];
const SILENT_MS = 5000; // the server sends something every second

const link = { last: {}, socket: null, role: null, next: 1, tries: 0, heardMs: 0, lostMs: null, waiting: new Map(), handlers: {} };

/** Call `handler` with each message of a type. */
function on(type, handler) {
  (link.handlers[type] ??= []).push(handler);
}

/** Send a request; a promise of its answer, for `answerText`, which never fails. */
function request(what) {
  if (link.socket?.readyState !== WebSocket.OPEN) {
    return Promise.resolve(unanswered("connection.unsent"));
  }
  const id = link.next++;
  link.socket.send(JSON.stringify({ ...what, id }));
  return new Promise((resolve) => link.waiting.set(id, resolve));
}

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
  socket.binaryType = "arraybuffer";
  link.socket = socket;
  link.heardMs = performance.now();
  socket.onmessage = (message) => received(message.data);
  socket.onclose = (event) => closed(socket, event.reason);
}

function received(data) {
  link.heardMs = performance.now();
  if (typeof data !== "string") return past.session ? undefined : takePicture(data);
  const message = JSON.parse(data);
  if (message.type === "answer") {
    link.waiting.get(message.id)?.(message);
    link.waiting.delete(message.id);
  }
  link.last[message.type] = message;
  handle(message);
}

const handle = (message) => (link.handlers[message.type] ?? []).forEach((handler) => handler(message));

/** `reason` is the server's, where it closed the connection itself. */
function closed(socket, reason = "") {
  if (socket !== link.socket) return;
  link.socket = null;
  link.lostMs ??= performance.now();
  for (const resolve of link.waiting.values()) {
    resolve(unanswered("connection.unanswered"));
  }
  link.waiting.clear();
  showConnection(reason);
  setTimeout(tryAgain, RETRY_MS[Math.min(link.tries++, RETRY_MS.length - 1)]);
}

/** Connect again, unless the server is there and this browser has no key. */
async function tryAgain() {
  try {
    const answer = await (await fetch("/role")).json();
    if (answer.role === null) return showNoKey();
  } catch {
    // the server is away: the socket fails too and is tried again
  }
  connect();
}

/** Exchange the key of a one-time link for a cookie and take it out of the address bar. */
async function useKey() {
  const key = location.hash.slice(1);
  if (!key) return;
  history.replaceState(null, "", location.pathname);
  try {
    const answer = await fetch("/key", {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ key }),
    });
    if (!answer.ok) link.refused = (await answer.json()).key;
  } catch {
    link.refused = "refused.link";
  }
}

function showNoKey() {
  say($("state"), phrase("phase.unconnected"));
  const key = link.refused ?? "refused.no_key";
  say($("connection"), phrase(key));
  $("connection").dataset.key = key;
  $("connection").hidden = false;
}

function showConnection(reason = "") {
  const lost = link.lostMs !== null;
  if (lost) say($("connection"), phrase("connection.lost", { reason: wordFor("closed", reason || "lost") }));
  $("connection").hidden = !lost;
  document.body.classList.toggle("offline", lost);
}

/** Close a connection that has gone silent without closing. */
function checkConnection() {
  if (link.socket?.readyState === WebSocket.OPEN && performance.now() - link.heardMs > SILENT_MS) {
    const silent = link.socket;
    silent.close();
    closed(silent);
  }
}

on("hello", (hello) => {
  const back = link.lostMs !== null;
  Object.assign(link, { role: hello.role, tries: 0, lostMs: null });
  showConnection();
  if (back) showAnswer({ ...unanswered("connection.back"), ok: true });
});
