// The jobs: those that are blocked first, then those at work, then those that wait, by priority, then the
// newest that have ended. With control there are a form for new ones and a menu for each that is open.

import { copy, toast } from "./control.mjs";
import { byId, byName, contains, dialog, due, duration, element, seconds, setData, setText } from "./text.mjs";

const SIGNS = { running: "▶", waiting: "◷", held: "‖", succeeded: "✓", failed: "✕", cancelled: "⊘", expired: "◷✕" };
const OPEN = ["running", "waiting", "held"];
// Of more, only these are drawn.
const MOST = 200;
// A deadline that is nearer is marked.
const SOON_S = 60;

const label = (job) => `${job.type}(${Object.values(job.arguments).join(", ")})`;
// As the robots write times: `not before 2026-05-04 10:03:19 UTC`.
const utc = (unix_us) => `${new Date(unix_us / 1000).toISOString().slice(0, 19).replace("T", " ")} UTC`;
const isOpen = (job) => OPEN.includes(job.state);
// At most this many robots are named.
const MOST_NAMED = 3;
const isBlocked = (job) => isOpen(job) && job.why.startsWith("blocked");

function byOrder(a, b) {
  if (isOpen(a) !== isOpen(b)) return isOpen(a) ? -1 : 1;
  if (!isOpen(a)) return (b.since_s ?? 0) - (a.since_s ?? 0) || byName(b.id, a.id);
  const isRunning = (job) => job.state === "running";
  return isBlocked(b) - isBlocked(a) || isRunning(b) - isRunning(a) || b.priority - a.priority || byName(a.id, b.id);
}

// As `mrbt submit` makes them: the same id again is the same job.
function newId() {
  const random = [...crypto.getRandomValues(new Uint8Array(4))].map((byte) => byte.toString(16).padStart(2, "0"));
  return `${new Date().toISOString().slice(0, 19).replace(/[-:]/g, "")}-${random.join("")}`;
}

export class JobsView {
  constructor(store, { job_types: types, submit }, select, control) {
    this._store = store;
    this._select = select;
    this._control = control;
    this._rows = new Map();
    this._wanted = "";
    this._list = byId("jobs-list");
    byId("jobs").hidden = false;
    this._offer(submit);
    // They take the tree's place, which goes beside them: it has only the steps of jobs.
    document.querySelector("main").classList.add("has-jobs");
    byId("aside").append(byId("tree"));
    byId("jobs").classList.toggle("has-menus", !!control);
    if (control) new SubmitForm(types, control);
    this._draw();
  }

  update(keys) {
    if (keys.has("connection") || [...keys].some((key) => key.startsWith("job/"))) this._draw();
    const isOver = !!this._store.get("team")?.ended;
    if (isOver !== this._isOver) {
      this._isOver = isOver;
      for (const row of this._rows.values()) row.job = null;
      this._draw();
    }
  }

  // Between changes time passes.
  tick() {
    const now = this._store.now();
    if (now === null || Math.abs(now - (this._drawnAt ?? -Infinity)) < 0.2) return;
    this._drawnAt = now;
    for (const row of this._rows.values()) this._drawTimes(row, now);
  }

  search(wanted) {
    this._wanted = wanted;
    return `${this._draw()} jobs`;
  }

  _offer(command) {
    byId("jobs-none").append("No job yet. Submit one: ", element("code", {}, command), " ",
      element("button", { type: "button", "aria-label": "Copy the command that submits a job", onclick: () => copy(command) }, "Copy"));
  }

  _drawNone() {
    byId("jobs-none").hidden = this._store.all("job").size > 0 || !!this._store.get("team")?.ended;
    byId("jobs-table").hidden = this._store.all("job").size === 0;
  }

  _draw() {
    const jobs = [...this._store.all("job").values()].filter((job) => contains(`${job.id} ${label(job)} ${job.operator}`, this._wanted)).sort(byOrder);
    const count = (state) => jobs.filter((job) => job.state === state).length;
    const ended = jobs.filter((job) => !isOpen(job)).length, hidden = jobs.length - MOST, blocked = jobs.filter(isBlocked).length;
    const open = `${blocked ? `${blocked} blocked, ` : ""}${count("running")} running, ${count("waiting") - blocked} waiting, ${count("held")} held`;
    setText(byId("jobs-hint"), `${this._isOver ? `${jobs.length - ended} left open` : open}, ${ended} ended${hidden > 0 ? `; ${hidden} not shown` : ""}`);
    const rows = jobs.slice(0, MOST).map((job) => this._row(job));
    if (rows.length !== this._list.children.length || rows.some((row, i) => this._list.children[i] !== row)) {
      const focused = document.activeElement;
      this._list.replaceChildren(...rows);
      if (this._list.contains(focused)) focused.focus({ preventScroll: true });
    }
    for (const name of this._rows.keys()) if (!this._store.get(`job/${name}`)) this._rows.delete(name);
    this._drawNone();
    return jobs.length;
  }

  _row(job) {
    if (!this._rows.has(job.id)) this._rows.set(job.id, this._newRow(job));
    const row = this._rows.get(job.id);
    if (row.job === job) return row.root;
    row.job = job;
    // Of a run that is over nobody works on it or waits for anything any more.
    const isLeft = !!this._isOver && isOpen(job);
    setData(row.root, "state", isLeft ? "left" : job.state);
    setData(row.root, "blocked", String(!isLeft && isBlocked(job)));
    setText(row.state, isLeft ? "◷ left open" : `${SIGNS[job.state]} ${job.state}`);
    setText(row.why, isLeft ? "" : job.why);
    const who = isOpen(job) && job.state !== "running" ? [] : job.robots, more = who.length - MOST_NAMED;
    setText(row.who, who.slice(0, MOST_NAMED).join(", ") + (more > 0 ? ` +${more}` : ""));
    row.who.title = who.join(", ");
    setText(row.priority, job.priority === null ? "" : String(job.priority));
    this._drawTimes(row, this._store.now());
    if (row.menu) row.menu.hidden = !isOpen(job) || isLeft;
    return row.root;
  }

  _drawTimes(row, now) {
    const { job } = row;
    if (!job) return;
    const isDue = isOpen(job) && !!job.deadline_us;
    const left = job.deadline_s === null || now === null || this._isOver ? null : job.deadline_s - now;
    setText(row.deadline, !isDue ? "" : left === null ? utc(job.deadline_us).slice(11, 19) : due(left));
    setData(row.deadline, "level", !isDue || left === null || left > SOON_S ? "" : left < 0 ? "bad" : "warn");
    const title = job.deadline_us ? utc(job.deadline_us) : "";
    if (row.deadline.title !== title) row.deadline.title = title;
    setText(row.since, job.since_s === null || now === null ? "" : duration(now - job.since_s));
    const since = job.since_s === null ? "" : `${job.state} since ${seconds(job.since_s)} of the run`;
    if (row.since.title !== since) row.since.title = since;
  }

  _newRow(job) {
    const row = { state: element("div", { class: "job-state" }), why: element("div", { class: "job-why" }), ...Object.fromEntries(["who", "priority", "deadline", "since"].map((name) => [name, cell(name)])) };
    row.menu = this._control?.menuButton(`Change ${job.id}`, "⋯", () => this._menu(job.id));
    const name = element("button", { type: "button", class: "name", title: `Why is it so? Submitted by ${job.operator}`, onclick: () => this._select({ kind: "job", name: job.id }) }, label(job));
    row.root = element("tr", { role: "row" }, cell("job", name, element("div", { class: "job-id" }, job.id), row.why), cell("state", row.state),
      row.who, row.priority, row.deadline, row.since, cell("more", row.menu));
    return row;
  }

  _menu(name) {
    const job = this._store.get(`job/${name}`);
    const priority = element("input", { type: "number", value: job.priority, step: 1, "aria-label": "New priority" });
    const button = (change, words, body) => element("button", { type: "button", class: change === "cancel" ? "danger" : undefined, onclick: async () => {
      this._control.closeMenu();
      const refused = await this._control.ask(`/${encodeURIComponent(name)}/${change}`, body());
      if (refused) toast(`${words} ${name}: ${refused}`);
    } }, words);
    const hint = (text) => element("span", { class: "hint" }, text);
    const hold = job.state === "held" ? [button("release", "Release", () => ({})), hint("It goes on.")] : [button("hold", "Hold", () => ({})), hint("It does not begin until it is released.")];
    return [...hold, button("priority", "Set priority", () => ({ priority: Number(priority.value) })), priority,
      button("cancel", "Cancel", () => ({})), hint("What is being done is stopped.")];
  }
}

// Its role is said, as a narrow page lays the table out in another way.
const cell = (name, ...children) => element("td", { role: "cell", class: `job-${name}`, "data-of": name }, ...children);

// A form made from the types of jobs.
class SubmitForm {
  constructor(types, control) {
    this._types = new Map(types.map((type) => [type.name, type]));
    this._control = control;
    this._id = null;
    this._form = byId("submit-form");
    this._alert = element("p", { role: "alert" });
    this._type = element("select", { id: "submit-type", onchange: () => this._draw() }, ...types.map((type) => element("option", {}, type.name)));
    byId("submit-open").hidden = false;
    dialog("submit", byId("submit-open"));
    // Other words are another job.
    this._form.addEventListener("input", () => { this._id = null; });
    this._form.addEventListener("submit", (event) => { event.preventDefault(); this._submit(); });
    this._draw();
  }

  _draw() {
    const type = this._types.get(this._type.value);
    this._fields = new Map(type.parameters.map((each) => [each.name, this._field(each)]));
    this._priority = element("input", { type: "number", id: "submit-priority", step: 1, value: type.priority });
    [this._notBefore, this._deadline] = ["not-before", "deadline"].map((name) => element("input", { type: "datetime-local", id: `submit-${name}` }));
    const labelled = (text, field) => [element("label", { for: field.id }, text), field];
    this._button = element("button", { type: "submit" }, "Submit");
    this._form.replaceChildren(...labelled("type", this._type), ...[...this._fields].flatMap(([name, field]) => labelled(name, field)),
      ...labelled("priority", this._priority), ...labelled("not before", this._notBefore), ...labelled("deadline", this._deadline), element("span"), element("span", {}, this._button), this._alert);
  }

  _field({ name, choices, min, max }) {
    const id = `submit-argument-${name}`;
    if (choices.length) return element("select", { id }, ...choices.map((each) => element("option", {}, each)));
    return element("input", { id, type: "number", required: true, min, max, step: 1, value: min, title: `${min} to ${max}` });
  }

  async _submit() {
    this._id ??= newId();
    this._button.disabled = true;
    this._say("", "submitting…");
    const values = Object.fromEntries([...this._fields].map(([name, field]) => [name, field.type === "number" ? Number(field.value) : field.value]));
    const time = (field) => (field.value ? new Date(field.value).toISOString() : null);
    const refused = await this._control.ask("", { id: this._id, type: this._type.value, arguments: values, priority: Number(this._priority.value),
      not_before: time(this._notBefore), deadline: time(this._deadline) });
    this._say(refused ? "bad" : "good", refused || `submitted: ${this._id}`);
    if (!refused) this._id = null;
    this._button.disabled = false;
  }

  _say(level, text) {
    setData(this._alert, "level", level);
    setText(this._alert, text);
  }
}
