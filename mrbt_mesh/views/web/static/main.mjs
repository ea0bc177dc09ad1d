// The page: puts its parts together and keeps them up to date.

import { Alerts } from "./alerts.mjs";
import { Control, copy, takeToken } from "./control.mjs";
import { JobsView } from "./jobs.mjs";
import { MapView } from "./map.mjs";
import { PlaybackView } from "./playback.mjs";
import { RobotsView } from "./robots.mjs";
import { Store } from "./store.mjs";
import { LEVEL_SIGN, allSigns, byId, dialog, element, seconds, setData, setText, withCommands } from "./text.mjs";
import { TimelineView } from "./timeline.mjs";
import { TreeView } from "./tree.mjs";
import { WhyView } from "./why.mjs";

const RETRY_MS = 1000, NEXT_MS = 3000;

const TRY_IT = "No robot has died. Try it: kill one from its menu (⋯). Here you then see who takes over its work, and after how many milliseconds.";
// Beyond so many letters the headline has a line of its own.
const LONG = 90;
// Statements that are shown before the others are asked for: more where there is room.
const FIRST = 5, FIRST_NARROW = 3, NARROW = "(max-width: 1180px)";

async function mission() {
  for (;;) {
    try {
      const answer = await fetch("mission");
      if (answer.ok) return answer.json();
    } catch { /* not there yet, or not any more */ }
    say([{ level: "warn", text: "no answer, trying again…" }]);
    await new Promise((done) => setTimeout(done, RETRY_MS));
  }
}

// What the server says of the team, after what the page knows of its connection.
function headline(store, isRecording) {
  const found = [...(store.get("headline") ?? [{ level: "info", text: "connecting…" }])];
  if (store.state === "lost") return [{ level: "warn", text: "connection lost: this is what was last known; trying again…" }, ...found];
  if (store.state === "over" || store.state === "replaced") return [{ level: "info", text: isRecording ? "its server has ended" : "the run is over" }, ...found];
  return found;
}

let isWhole = false, said = "";

function say(statements) {
  const first = matchMedia(NARROW).matches ? FIRST_NARROW : FIRST, key = JSON.stringify([isWhole, first, statements]);
  if (said === key) return;
  said = key;
  const shown = isWhole ? statements : statements.slice(0, first);
  const rows = shown.map(({ level, text }) => element("p", { "data-level": level },
    element("span", { "aria-hidden": "true" }, LEVEL_SIGN[level]), element("span", {}, ...withCommands(text))));
  if (statements.length > first) {
    const more = isWhole ? "less" : `${statements.length - first} more`;
    rows.push(element("button", { type: "button", onclick: () => { isWhole = !isWhole; say(statements); } }, more));
  }
  byId("headline").replaceChildren(...rows);
  byId("headline").classList.toggle("is-long", shown.reduce((length, { text }) => length + text.length, 0) > LONG);
}

// The revision in force, and the one that waits for robots.
function sayRevision(team) {
  const { revision = 0, pending = null } = team ?? {}, shown = byId("revision");
  shown.hidden = !revision && !pending;
  setText(shown, [revision || !pending ? `revision ${revision}` : "", pending ? `revision ${pending.number} pending` : ""].filter(Boolean).join(", "));
  shown.title = pending ? `proposed by ${pending.by}, waits for ${pending.awaited.join(", ") || "a majority"}` : "the revision of the mission that is in force";
  setData(shown, "level", pending ? "warn" : "");
}

// What can be done with a run that is over -> the command for it.
function offerCommands(commands) {
  byId("after").replaceChildren(...Object.entries(commands).map(([what, command]) => element("span", {}, `To ${what}: `, element("code", {}, command), " ",
    element("button", { type: "button", "aria-label": `Copy the command to ${what}`, onclick: () => copy(command) }, "Copy"))));
}

// A run that is over stays on the page; the next one is offered, never switched to by itself.
function offerNext(name, address) {
  if (byId("next").querySelector("a")?.getAttribute("href") === address) return;
  byId("next").replaceChildren(element("span", {}, element("b", {}, "Another run has begun: "), element("a", { href: address }, `open ${name}`)));
  byId("next").hidden = false;
}

// Of the machine's list: this run, and the newest one that has begun since and runs.
async function followMachine({ above, run }, changed) {
  for (;;) {
    try {
      const { runs } = await (await fetch(`${above}runs`)).json(), own = runs.find((each) => each.run === run);
      const next = runs.find((each) => each.result === "running" && own && each.started_unix_s > own.started_unix_s);
      changed(own && own.result !== "running" ? own.result : "", next);
    } catch { /* the headline says that the connection is lost */ }
    await new Promise((done) => setTimeout(done, NEXT_MS));
  }
}

async function begin() {
  const told = await mission();
  setText(byId("mission"), told.name);
  const store = new Store(told.run);
  let result = "", next;
  if (told.above) {
    byId("above").href = told.above;
    byId("above").hidden = false;
    followMachine(told, (...found) => { [result, next] = found; follow(); });
  }
  if (told.recording) store.end = told.recording.to_s;
  const playback = told.recording ? new PlaybackView(store, told.recording) : null;
  const token = takeToken();
  const control = told.control && token ? new Control(told.control, token) : null;
  const select = (selection) => {
    why.show(selection);
    robots.select(selection.kind === "robot" ? selection.name : null);
  };
  const robots = new RobotsView(store, told.robots, select, control);
  const why = new WhyView(store, select);
  const tree = new TreeView(store, told.tree, select);
  const timeline = new TimelineView(store, select, told.recording, (time) => playback?.go(time));
  const map = new MapView(store, told.map, select);
  const jobs = told.job_types.length ? [new JobsView(store, told, select, control)] : [];
  for (const view of [robots, tree, timeline, why, map, ...jobs, ...(playback ? [playback] : []), ...(control ? [control] : [])]) store.onChange((keys) => view.update(keys, store));
  const alerts = new Alerts(told.name);
  offerCommands(told.commands);
  if (control) setText(byId("no-faults"), TRY_IT);
  const follow = () => {
    // Another mission is in force: the page is made anew, with its tree, tasks and places.
    if (!playback && (store.get("team")?.revision ?? told.revision) !== told.revision) location.reload();
    sayRevision(store.get("team"));
    const isEnded = !!store.get("team")?.ended, statements = headline(store, playback !== null);
    if (result && !isEnded && store.state === "connected") statements.unshift({ level: "bad", text: `the run is over: ${result.replace("_", " ")}` });
    say(statements);
    alerts.update(statements);
    document.title = `${alerts.prefix}${statements[0].level === "bad" ? `${LEVEL_SIGN.bad} ` : ""}${told.name} · ${told.recording ? "replay · " : ""}mrbt`;
    byId("after").hidden = !(isEnded || result || ["over", "replaced"].includes(store.state));
    if (store.state === "replaced") offerNext("it", location.pathname);
    else if (next && result) offerNext(next.team, `${told.above}run/${next.run}/`);
  };
  store.onChange(follow);
  search([robots, ...jobs, tree, timeline]);
  linkMoments(timeline, playback);
  byId("signs-body").replaceChildren(...allSigns());
  dialog("signs", byId("signs-open"));
  store.connect();
  const tick = () => {
    setText(byId("clock"), seconds(store.now()));
    timeline.tick();
    robots.tick();
    why.tick();
    jobs[0]?.tick();
    playback?.tick();
    requestAnimationFrame(tick);
  };
  tick();
}

// `?t=SECONDS` leads to a moment of the run.
function linkMoments(timeline, playback) {
  const text = new URLSearchParams(location.search).get("t"), time = Number(text);
  if (text && Number.isFinite(time)) {
    timeline.showMoment(time);
    playback?.go(time, true);
  }
  byId("link").addEventListener("click", () => copy(`${location.origin}${location.pathname}?t=${timeline.moment().toFixed(2)}`));
}

// One field for robots, tasks and events: each view shows what fits, and says how much that is.
function search(views) {
  const field = byId("search");
  field.addEventListener("input", () => {
    const wanted = field.value.trim().toLowerCase();
    const found = views.map((view) => view.search(wanted));
    setText(byId("found"), wanted ? found.join(", ") : "");
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== "/" || event.ctrlKey || event.altKey || event.metaKey || event.target.closest("input, select, dialog")) return;
    field.focus();
    event.preventDefault();
  });
}

begin();
