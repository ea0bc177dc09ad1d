// The page: puts its parts together and keeps them up to date.

import { Control, takeToken } from "./control.mjs";
import { MapView } from "./map.mjs";
import { PlaybackView } from "./playback.mjs";
import { RobotsView } from "./robots.mjs";
import { Store } from "./store.mjs";
import { SIGN, byId, hasDifferedLong, seconds, setData, setText } from "./text.mjs";
import { TimelineView } from "./timeline.mjs";
import { TreeView } from "./tree.mjs";
import { WhyView } from "./why.mjs";

const RETRY_MS = 1000;

async function mission() {
  for (;;) {
    try {
      const answer = await fetch("/mission");
      if (answer.ok) return answer.json();
    } catch { /* not there yet, or not any more */ }
    banner("No answer. Trying again…");
    await new Promise((done) => setTimeout(done, RETRY_MS));
  }
}

function banner(text) {
  const shown = byId("banner");
  setText(shown, text);
  shown.hidden = !text;
}

function drawTeam(store, isRecording) {
  const team = store.get("team");
  if (!team) return;
  const status = !team.started ? "idle" : team.order === "pause" && !team.ended ? "warn" : team.ended ?? team.result ?? "idle";
  const words = !team.started ? (isRecording ? "before the start" : "waiting for the team") : status === "warn" ? "❚❚ paused"
    : team.stands_by ? `${SIGN[status] ?? ""} ${status}, stands by` : `${SIGN[status] ?? ""} ${status}`;
  setData(byId("result"), "status", status);
  setText(byId("result"), words);
  const { equal, robots, differ } = team.agreement;
  const isAgreeing = !equal && !Object.values(differ).some((since) => hasDifferedLong(since, store.now()));
  const others = Object.entries(differ).map(([robot, since]) => `${robot} since ${seconds(since)}`);
  setData(byId("agreement"), "status", robots === 0 || isAgreeing ? "idle" : equal ? "success" : "warn");
  setText(byId("agreement"), robots === 0 ? "nobody is heard" : equal ? `● ${robots === 1 ? "one robot" : `all ${robots} agree`}` : isAgreeing ? "◌ agreeing…" : `◐ differs: ${others.join(", ")}`);
  const blocked = team.blocked.map((each) => `${each.request} is ${each.reason} (since ${seconds(each.since_s)})`);
  drawBanner(store, team.ended ? [] : blocked, isRecording);
}

function drawBanner(store, blocked, isRecording) {
  if (store.state === "lost") banner("Connection lost. The page shows what was last known, and tries again by itself…");
  else if (store.state === "over" && isRecording) banner("The recording is shown no more: its server has ended.");
  else if (store.state === "over") banner("The run is over. The page stays as it was.");
  else banner(blocked.join(" · "));
}

async function begin() {
  const told = await mission();
  banner("");
  document.title = `${told.name} · ${told.recording ? "replay · " : ""}mrbt`;
  setText(byId("mission"), told.name);
  const store = new Store();
  if (told.recording) store.end = told.recording.to_s;
  const playback = told.recording ? new PlaybackView(store, told.recording) : null;
  const control = told.control ? new Control(told.control, takeToken()) : null;
  const select = (selection) => {
    why.show(selection);
    robots.select(selection.kind === "robot" ? selection.name : null);
  };
  const robots = new RobotsView(store, told.robots, select, control);
  const why = new WhyView(store, select, control);
  const tree = new TreeView(store, told.tree, select);
  const timeline = new TimelineView(store, select, told.recording, (time) => playback?.go(time));
  const map = new MapView(store, told.map, select);
  for (const view of [robots, tree, timeline, why, map, ...(playback ? [playback] : [])]) store.onChange((keys) => view.update(keys));
  store.onChange(() => drawTeam(store, playback !== null));
  store.connect();
  const tick = () => {
    setText(byId("clock"), seconds(store.now()));
    timeline.tick();
    playback?.tick();
    requestAnimationFrame(tick);
  };
  tick();
}

begin();
