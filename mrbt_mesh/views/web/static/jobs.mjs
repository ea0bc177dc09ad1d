// The jobs: those at work first, then those that wait, by priority, then the newest that have ended.
// With control there are a form for new ones and a menu for each that is open.

import { toast } from "./control.mjs";
import { byId, contains, dialog, element, seconds, setData, setText } from "./text.mjs";

const SIGNS = { running: "▶", waiting: "◷", held: "‖", succeeded: "✓", failed: "✕", cancelled: "⊘", expired: "◷✕" };
const OPEN = ["running", "waiting", "held"];
// Of more, only these are drawn.
const MOST = 200;

const label = (job) => `${job.type}(${Object.values(job.arguments).join(", ")})`;
// As the robots write times: `not before 2026-05-04 10:03:19 UTC`.
const utc = (unix_us) => `${new Date(unix_us / 1000).toISOString().slice(0, 19).replace("T", " ")} UTC`;
const isOpen = (job) => OPEN.includes(job.state);

function byOrder(a, b) {
  if (isOpen(a) !== isOpen(b)) return isOpen(a) ? -1 : 1;
  if (!isOpen(a)) return (b.since_s ?? 0) - (a.since_s ?? 0) || b.id.localeCompare(a.id);
  const isRunning = (job) => job.state === "running";
  return isRunning(b) - isRunning(a) || b.priority - a.priority || a.id.localeCompare(b.id);
}

// As `mrbt submit` makes them: the same id again is the same job.
function newId() {
  const random = [...crypto.getRandomValues(new Uint8Array(4))].map((byte) => byte.toString(16).padStart(2, "0"));
  return `${new Date().toISOString().slice(0, 19).replace(/[-:]/g, "")}-${random.join("")}`;
}

export class JobsView {
  constructor(store, types, control) {
    this._store = store;
    this._control = control;
    this._rows = new Map();
    this._wanted = "";
    this._list = byId("jobs-list");
    byId("jobs").hidden = false;
    if (control) new SubmitForm(types, control);
  }

  update(keys) {
    if ([...keys].some((key) => key.startsWith("job/"))) this._draw();
  }

  search(wanted) {
    this._wanted = wanted;
    return `${this._draw()} jobs`;
  }

  _draw() {
    const jobs = [...this._store.all("job").values()].filter((job) => contains(`${job.id} ${label(job)} ${job.operator}`, this._wanted)).sort(byOrder);
    const count = (state) => jobs.filter((job) => job.state === state).length;
    const ended = jobs.filter((job) => !isOpen(job)).length, hidden = jobs.length - MOST;
    setText(byId("jobs-hint"), `${count("running")} running, ${count("waiting")} waiting, ${count("held")} held, ${ended} ended${hidden > 0 ? `; ${hidden} not shown` : ""}`);
    const rows = jobs.slice(0, MOST).map((job) => this._row(job));
    if (rows.length !== this._list.children.length || rows.some((row, i) => this._list.children[i] !== row)) {
      const focused = document.activeElement;
      this._list.replaceChildren(...rows);
      if (this._list.contains(focused)) focused.focus({ preventScroll: true });
    }
    for (const name of this._rows.keys()) if (!this._store.get(`job/${name}`)) this._rows.delete(name);
    return jobs.length;
  }

  _row(job) {
    if (!this._rows.has(job.id)) this._rows.set(job.id, this._newRow(job));
    const row = this._rows.get(job.id);
    if (row.shown === job) return row.root;
    row.shown = job;
    setData(row.state, "state", job.state);
    setText(row.state, `${SIGNS[job.state]} ${job.state}`);
    setText(row.note, [job.id, job.robots.join(", "), job.why, job.priority ? `priority ${job.priority}` : "", job.deadline_us ? `until ${utc(job.deadline_us)}` : ""].filter(Boolean).join(" · "));
    setText(row.time, job.since_s === null ? "" : `${isOpen(job) ? "since" : "at"} ${seconds(job.since_s)}`);
    if (row.menu) row.menu.hidden = !isOpen(job);
    return row.root;
  }

  _newRow(job) {
    const row = { state: element("span", { class: "job-state" }), note: element("span", { class: "hint" }), time: element("time") };
    row.menu = this._control?.menuButton(`Change ${job.id}`, "⋯", () => this._menu(job.id));
    row.root = element("li", {}, row.state, element("span", {}, element("b", { title: `${job.id}, submitted by ${job.operator}` }, label(job)), row.note), row.time, row.menu);
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
