"use strict";
// Draws what the server says and tells it what a person does. It decides nothing: who may drive,
// and for how long a hand counts as holding, is the server's and the robot's business.

const REPEAT_MS = 100;
const RECONNECT_MS = 1000;
const WAYS = { ahead: [1, 1], back: [-1, -1], left: [-0.6, 0.6], right: [0.6, -0.6] };
const KEYS = {
  KeyW: "ahead", ArrowUp: "ahead", KeyS: "back", ArrowDown: "back",
  KeyA: "left", ArrowLeft: "left", KeyD: "right", ArrowRight: "right",
};

const at = (id) => document.getElementById(id);
let socket = null;
let seenStops = 0;
let runRefused = "not connected";

// --- what the server says

function connect() {
  const address = new URL("live", location.href);
  address.protocol = "ws:";
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => typeof data === "string" ? hear(JSON.parse(data)) : see(data);
  socket.onclose = () => {
    letGo();
    lost("no connection to `workstation console`; trying again");
    setTimeout(connect, RECONNECT_MS);
  };
}

function hear(message) {
  if (message.kind === "state") showState(message);
  else if (message.kind === "answer") say(message.words, message.done);
  else if (message.kind === "hand-ended") handEnded(message.words);
  else if (message.kind === "models") showModels(message.models);
  else if (message.kind === "recordings") showRecordings(message);
}

function showState(now) {
  at("robot").textContent = now.robot;
  document.title = `${now.robot}: ${now.state}`;
  at("state").textContent = now.state;
  at("state").className = `pill ${now.state}`;
  at("headline").textContent = now.headline;
  lost(now.lost);
  seenStops = now.stop_count ?? 0;
  list(at("faults"), now.faults ?? []);
  list(at("notices"), now.notices ?? []);
  const stops = now.stop_count ? `${now.stop_words}.` : "";
  at("stops").textContent = stops.charAt(0).toUpperCase() + stops.slice(1);
  refuseRun(now.run_refused);
  at("model").textContent = now.model
    ? `Model ${now.model}${now.on_trial ? ", on trial" : ""}` : "No model; push one.";
  rows(at("facts"), now.facts ?? []);
  bar(at("left"), now.wheels ? now.wheels.left : 0);
  bar(at("right"), now.wheels ? now.wheels.right : 0);
}

function lost(words) {
  at("link").textContent = words;
  document.body.classList.toggle("lost", words !== "");
  if (words) refuseRun(words);
}

function refuseRun(words) {
  runRefused = words;
  at("run").disabled = words !== "";
  at("run-refused").textContent = words;
}

async function see(data) {
  const canvas = at(new Uint8Array(data)[0] === 0x63 ? "camera" : "policy");
  const picture = await createImageBitmap(new Blob([data.slice(1)], { type: "image/jpeg" }));
  canvas.width = picture.width;
  canvas.height = picture.height;
  canvas.getContext("2d").drawImage(picture, 0, 0);
  picture.close();
}

function bar(element, value) {
  const most = 50 * Math.min(1, Math.abs(value));
  element.style.left = `${value < 0 ? 50 - most : 50}%`;
  element.style.width = `${most}%`;
}

function say(words, good) {
  at("said").textContent = words;
  at("said").classList.toggle("bad", !good);
}

function list(element, lines) {
  element.replaceChildren(...lines.map((line) => node("li", line)));
}

function rows(table, lines) {
  table.replaceChildren(...lines.map((cells) => {
    const row = document.createElement("tr");
    row.append(...cells.map((cell) => {
      const made = document.createElement("td");
      made.append(cell);
      return made;
    }));
    return row;
  }));
}

function node(kind, text) {
  const made = document.createElement(kind);
  made.textContent = text;
  return made;
}

// --- STOP: a request of its own, so that it needs no websocket and waits behind nothing

async function stop() {
  const began = performance.now();
  letGo();
  say("STOP ...", true);
  try {
    const reply = await fetch("stop", { method: "POST" });
    const { done, words } = await reply.json();
    const took = Math.round(performance.now() - began);
    say(done ? `STOP: ${words}, ${took} ms` : words, done);
    document.body.dataset.stopMs = done ? took : "";
  } catch {
    say("STOP did not reach `workstation console`: switch the robot off by hand", false);
  }
}

at("stop").addEventListener("pointerdown", (event) => { event.preventDefault(); stop(); });
at("stop").addEventListener("click", (event) => { if (event.detail === 0) stop(); });

// --- the hand: it drives while something is held, and the page is looked at

let press = 0;
let handEndedAt = 0;
const held = new Set();
let repeating = 0;

function wheels() {
  const speed = at("speed").value / 100;
  let left = 0, right = 0;
  for (const way of new Set([...held].map((name) => name.split(":")[1]))) {
    left += WAYS[way][0];
    right += WAYS[way][1];
  }
  const most = Math.max(1, Math.abs(left), Math.abs(right));
  return { left: speed * left / most, right: speed * right / most };
}

function hold(name) {
  if (held.size === 0) {
    press += 1;
    at("hand-words").textContent = "";
    repeating = setInterval(repeat, REPEAT_MS);
  }
  held.add(name);
  repeat();
}

function release(name) {
  if (!held.delete(name)) return;
  if (held.size === 0) letGo(); else repeat();
}

function letGo() {
  clearInterval(repeating);
  const was = held.size > 0 || repeating !== 0;
  held.clear();
  repeating = 0;
  for (const button of at("pad").children) button.classList.remove("held");
  if (was) send({ do: "let-go", press });
}

function repeat() {
  if (press === handEndedAt) return;
  const now = performance.now() / 1000;
  send({ do: "hand", press, seen_stops: seenStops, sent_s: now, ...wheels() });
}

function handEnded(words) {
  handEndedAt = press;  // whatever is still held counts again when it was let go
  at("hand-words").textContent = words;
}

function send(message) {
  if (socket !== null && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

for (const button of at("pad").children) {
  const name = `touch:${button.dataset.way}`;
  button.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    button.classList.add("held");
    hold(name);
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    button.addEventListener(end, () => { button.classList.remove("held"); release(name); });
  }
  button.addEventListener("contextmenu", (event) => event.preventDefault());
}

addEventListener("keydown", (event) => {
  if (event.code === "Space") {
    event.preventDefault();
    if (!event.repeat) stop();
    return;
  }
  if (event.code === "KeyM" && !event.repeat && !event.ctrlKey && !event.altKey && !event.metaKey) {
    send({ do: "mark" });
    return;
  }
  const way = KEYS[event.code];
  if (!way || event.ctrlKey || event.altKey || event.metaKey || event.target.id === "speed") return;
  event.preventDefault();
  if (!event.repeat) hold(`${event.code}:${way}`);
});
addEventListener("keyup", (event) => {
  const way = KEYS[event.code];
  if (way) release(`${event.code}:${way}`);
});
// A hand that cannot be seen any more has let go.
addEventListener("blur", letGo);
addEventListener("pagehide", letGo);
document.addEventListener("visibilitychange", () => { if (document.hidden) letGo(); });
at("speed").addEventListener("input", () => {
  at("speed-words").textContent = `${at("speed").value} %`;
});

// --- everything else

at("run").addEventListener("click", () => {
  if (!runRefused) send({ do: "run", seen_stops: seenStops });
});
at("mark").addEventListener("click", () => send({ do: "mark" }));
at("list-models").addEventListener("click", () => send({ do: "models" }));
at("push-model").addEventListener("click", () => chosen((file) => {
  askHere(`Send ${file.name} to ${at("robot").textContent} and make it active?`,
    () => longErrand(`push?name=${encodeURIComponent(file.name)}`, file));
}));
at("list-recordings").addEventListener("click", () => send({ do: "recordings" }));

function showModels(models) {
  rows(at("models"), models.map((model) => {
    const standing = model.active ? (model.proven ? "active" : "active, on trial")
      : model.rejected ? "rolled back" : model.previous ? "previous" : "";
    const back = node("button", "make active");
    back.disabled = model.active;
    back.addEventListener("click", () => {
      askHere(`Make ${model.name} ${model.digest} active?`, () => {
        say(`making ${model.name} active ...`, true);
        send({ do: "roll-back", sha256: model.sha256 });
      });
    });
    return [standing, `${model.name} ${model.digest}`, model.size, day(model.stored_unix_time_ms), back];
  }));
}

function showRecordings({ drives, free }) {
  rows(at("recordings"), drives.map((drive) => [
    drive.open ? "recording" : drive.kept ? "kept" : "",
    drive.name, `${drive.lasted_s} s`, drive.size, day(drive.started_unix_time_ms), actions(drive.name),
  ]));
  at("free").textContent = drives.length
    ? `${free} free on its card. "Fetch" brings a drive into the folder drives of this machine; `
      + '"decide again" asks the model that drove once more, or another one.'
    : "The robot keeps no recordings.";
}

function actions(name) {
  const made = document.createElement("span");
  const drive = encodeURIComponent(name);
  made.append(
    button("fetch", () => longErrand(`fetch?drive=${drive}`)),
    button("decide again", () => longErrand(`replay?drive=${drive}`)),
    button("by another model ...", () => {
      chosen((file) => longErrand(`replay?drive=${drive}`, file));
    }),
  );
  return made;
}

// In the page: the browser's own confirm() would hold up STOP until it is answered.
function askHere(words, yes) {
  const row = node("p", `${words} `);
  row.append(
    button("yes", () => { row.remove(); yes(); }),
    button("no", () => row.remove()),
  );
  at("questions").replaceChildren(row);
  row.scrollIntoView({ block: "nearest" });
}

function button(words, press) {
  const made = node("button", words);
  made.type = "button";
  made.addEventListener("click", press);
  return made;
}

// --- what takes long: a request of its own, answered by lines while it goes on

async function longErrand(path, body = null) {
  const bar = document.createElement("progress");
  const words = node("span", "asking ...");
  const row = document.createElement("p");
  row.append(bar, " ", words);
  at("under-way").append(row);
  try {
    const reply = await fetch(path, { method: "POST", body });
    if (!reply.ok) throw new Error(await reply.text());
    for await (const line of lines(reply.body)) {
      if (line.kind === "progress") {
        bar.value = line.share;
        words.textContent = line.words;
      } else if (line.kind === "replay") showReplay(line);
      else hear(line);
    }
  } catch (error) {
    say(`${path.split("?")[0]}: ${error.message}; is \`workstation console\` still running?`, false);
  } finally {
    row.remove();
  }
}

async function* lines(stream) {
  const reader = stream.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const parts = (rest + value).split("\n");
    rest = parts.pop();
    for (const part of parts) yield JSON.parse(part);
  }
}

function showReplay(found) {
  at("replay").hidden = false;
  at("verdict").textContent = found.words;
  at("verdict").classList.toggle("bad", !found.done);
  list(at("replay-lines"), found.lines);
  rows(at("replay-rows"), found.rows.length
    ? [["time", "beat", "then: left, right", "now", "differs by"], ...found.rows] : []);
  at("replay").scrollIntoView({ block: "nearest" });
}

function chosen(use) {
  const input = document.createElement("input");
  input.type = "file";
  input.accept = ".onnx";
  input.addEventListener("change", () => { if (input.files.length) use(input.files[0]); });
  input.click();
}

function day(unixTimeMs) {
  return unixTimeMs ? new Date(unixTimeMs).toLocaleString([], { dateStyle: "short", timeStyle: "short" }) : "-";
}

connect();
