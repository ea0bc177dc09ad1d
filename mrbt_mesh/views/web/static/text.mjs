// Signs and words that several parts of the page share.

export const STATUS = ["idle", "running", "success", "failure"];
export const SIGN = { idle: "·", running: "▶", success: "✓", failure: "✕" };
const KINDS = {
  Sequence: "→", Fallback: "?", Parallel: "⇉", IfThenElse: "⋔", Inverter: "!", ForceSuccess: "✓!",
  ForceFailure: "✕!", RetryUntilSuccessful: "↻", Repeat: "↻", KeepRunningUntilFailure: "↻",
  Timeout: "◷", SubTree: "▣", Condition: "○", Action: "",
};

export const kindSign = (kind) => KINDS[kind] ?? "◆";

// Of a statement of the headline.
export const LEVEL_SIGN = { bad: "✕", warn: "⚠", info: "·", good: "✓" };

// What is said of a robot: sign, group, meaning.
export const STATES = {
  dead: ["✕", "trouble", "declared dead by the others"],
  suspect: ["◐", "trouble", "silent: it may be dead"],
  differs: ["≠", "trouble", "reports another plan than the others"],
  "at work": ["▶", "work", "has a task"],
  joining: ["◌", "idle", "is not counted on yet"],
  leaving: ["◍", "idle", "leaves on purpose"],
  idle: ["○", "idle", "has no task; its row says why"],
  left: ["⊘", "idle", "has left on purpose"],
  "not started": ["–", "idle", "no message from it yet"],
  ended: ["■", "idle", "the run is over"],
};

// What is said of a robot: a key of `STATES`.
export function stateOf(robot, now, isOver) {
  if (robot.state === "absent") return "not started";
  if (isOver && robot.state !== "dead") return "ended";
  if (hasDifferedLong(robot.differs_since_s, now)) return "differs";
  return robot.state !== "alive" ? robot.state : robot.local_task ? "at work" : "idle";
}

// Its group: one with a problem is in trouble whatever it does.
export function groupOf(robot, now, isOver) {
  const isWrong = !["dead", "left", "absent"].includes(robot.state) && (robot.problems?.length || Object.keys(robot.lost ?? {}).length);
  return isWrong && !isOver ? "trouble" : STATES[stateOf(robot, now, isOver)]?.[1] ?? "idle";
}

// Its place in lists, the smallest first: the dead, those with a problem, those at work, the others.
export function rankOf(robot, now, isOver) {
  const group = groupOf(robot, now, isOver), own = STATES[stateOf(robot, now, isOver)]?.[1] ?? "idle";
  return 2 * ["trouble", "work", "idle"].indexOf(group) + (own === group ? 0 : 1);
}

// How a span of the timeline ends: key -> words.
export const ENDS = { running: "works", done: "done", failed: "failed", dropped: "not needed any more", died: "died at it" };
const MARKS = [["✕", "died; the line goes to who took over"], ["▲", "lost capabilities"], ["◂", "began before it was watched"], ["━", "claimed, not begun yet"]];

const swatch = (end) => element("i", { "data-end": end });

// The signs of the timeline that are seen most.
export function timelineLegend() {
  return [...["running", "done", "failed", "dropped"].flatMap((end) => [swatch(end), `${ENDS[end]} `]),
    element("b", {}, "✕"), "death ", element("i", { class: "hatched" }), "not watched"];
}

// All signs of the page, with their meanings.
export function allSigns() {
  const table = (title, rows) => element("section", {}, element("h3", {}, title),
    element("dl", {}, ...rows.flatMap(([sign, text]) => [element("dt", {}, sign), element("dd", {}, text)])));
  return [
    table("Robots", [...Object.entries(STATES).map(([state, [sign, , meaning]]) => [sign, `${state}: ${meaning}`]),
      ["⚠", "a problem of its program or journal, or a lost capability, which is struck out"]]),
    table("Timeline", [...Object.entries(ENDS).map(([end, text]) => [swatch(end), text]),
      [element("i", { class: "hatched" }), "not watched: nothing is known of this time"],
      [element("i", { class: "dashed" }), "expected, by the schedule in force; the dashed line is its end"], ...MARKS]),
    table("State of a node", Object.entries(SIGN).map(([status, sign]) => [sign, status === "idle" ? "idle: the tree does not reach it now" : status])),
    table("Kind of a node", [...Object.entries(KINDS).filter(([, sign]) => sign).map(([kind, sign]) => [sign, kind]), ["◆", "another kind"]]),
  ];
}

export function seconds(value) {
  if (value === null || value === undefined) return "";
  if (value < 600) return `${value.toFixed(1)} s`;
  return `${Math.floor(value / 60)} min ${String(Math.floor(value % 60)).padStart(2, "0")} s`;
}

// Names as people order them: C2 before C10.
export const byName = new Intl.Collator("en", { numeric: true }).compare;

// A duration that is told again and again: "0.5 s", "42 s", "3 min", "2 h 5 min".
export function duration(value) {
  if (value < 10) return `${Math.max(0, value).toFixed(1).replace(".0", "")} s`;
  if (value < 100) return `${Math.round(value)} s`;
  const minutes = Math.round(value / 60), hours = Math.floor(minutes / 60);
  if (!hours) return `${minutes} min`;
  return minutes % 60 ? `${hours} h ${minutes % 60} min` : `${hours} h`;
}

// When something is due, `left` seconds from now: "in 3 min", "4 min late".
export const due = (left) => (left >= 0 ? `in ${duration(left)}` : `${duration(-left)} late`);

// For how long a robot has been at its work, of how long it should take, where that is known.
export function timeAtWork(robot, now) {
  if (robot.begun_s === null || robot.begun_s === undefined || robot.phase !== "running") return { text: "", isLate: false };
  const passed = Math.max(0, Math.floor((now ?? 0) - robot.begun_s)), expected = robot.expected_s;
  if (expected === null || expected === undefined) return { text: passed ? ` for ${duration(passed)}` : "", isLate: false };
  return { text: ` for ${duration(passed)} of ${duration(expected)}`, isLate: passed > robot.late_after_s };
}

// Plans differ for a moment after every event; that is no disagreement yet.
export const hasDifferedLong = (since, now) => since !== null && since !== undefined && now - since > 0.5;

export const lostText = (names, reason) => `lost ${names.join(", ")}${reason ? `: ${reason}` : ""}`;

// Text -> its reason, as pairs of a reason and all its texts.
export function textsByReason(reasons) {
  const found = new Map();
  for (const [text, reason] of Object.entries(reasons)) found.set(reason, [...(found.get(reason) ?? []), text]);
  return [...found];
}

// An element with attributes and children; text is never read as HTML.
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

// Changes the page only where something is new: many parts are written ten times a second.
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function setData(node, key, value) {
  if (node.dataset[key] !== value) node.dataset[key] = value;
}

export const byId = (id) => document.getElementById(id);

// When the others knew of a fault: there a recording shows it.
export const knownAt = (fault) => fault.at_s + (fault.detected_ms ?? 0) / 1000 + 0.001;

// A panel over the page that its buttons open and close.
export function dialog(name, open) {
  const shown = byId(name);
  byId(`${name}-close`).addEventListener("click", () => shown.close());
  open?.addEventListener("click", () => shown.showModal());
  return shown;
}

// A menu at the button that opens it.
export function placeMenu(menu, button) {
  const { right, bottom, top } = button.getBoundingClientRect(), isLow = bottom > innerHeight * 0.6;
  menu.style.left = `${Math.max(8, Math.min(right, innerWidth - 8) - 320)}px`;
  menu.style.top = isLow ? "auto" : `${bottom + 4}px`;
  menu.style.bottom = isLow ? `${innerHeight - top + 4}px` : "auto";
}

// Text in which `commands` are marked by backticks, as nodes.
export const withCommands = (text) => text.split("`").map((part, i) => (i % 2 ? element("code", {}, part) : part));

export const contains = (text, wanted) => text.toLowerCase().includes(wanted);
