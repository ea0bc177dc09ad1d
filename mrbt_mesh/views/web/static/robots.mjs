// The robots: those in trouble first, then those at work, then the others.

import { STATES, byId, byName, contains, element, groupOf, lostText, rankOf, setData, setText, stateOf, textsByReason, timeAtWork } from "./text.mjs";

const GROUPS = { trouble: "in trouble", work: "at work", idle: "idle" };
// With this many robots, each has a row instead of a card.
const ROWS_FROM = 10;

export class RobotsView {
  constructor(store, robots, select, control) {
    this._store = store;
    this._mission = robots;
    this._select = select;
    this._control = control;
    this._cards = new Map();
    this._wanted = "";
    this._group = null;
    this._list = byId("cards");
    this._makeGroups();
    for (const name of Object.keys(robots)) this._card(name);
    this._arrange();
    // Robots begin and end work all the time: they keep their places while somebody reads or points.
    for (const left of ["mouseleave", "focusout"]) this._list.addEventListener(left, () => this._isMoving || this._arrange());
  }

  update(keys) {
    const drawn = new Set();
    // How the team is decides on the state of all.
    if (keys.has("team") && this._isOver !== this._hasEnded()) {
      this._isOver = this._hasEnded();
      for (const name of this._cards.keys()) drawn.add(name);
    }
    for (const key of keys) {
      if (key.startsWith("robot/")) drawn.add(key.slice(6));
      else if (key.startsWith("fault/") && this._store.get(key)) drawn.add(this._store.get(key).robot);
    }
    for (const name of drawn) this._draw(name);
    if (drawn.size) this._arrange();
  }

  // Between changes time passes.
  tick() {
    const now = this._store.now();
    for (const [name, card] of this._cards) this._drawTime(card, this._robot(name), now);
  }

  select(name) {
    for (const [robot, card] of this._cards) card.root.classList.toggle("selected", robot === name);
  }

  search(wanted) {
    this._wanted = wanted;
    return `${this._filter()} robots`;
  }

  _hasEnded() { return !!this._store.get("team")?.ended; }

  // -- groups, order, filter --------------------------------------------------------------

  _makeGroups() {
    this._buttons = new Map(Object.keys(GROUPS).map((group) => [group, element("button", { type: "button", "data-group": group, "aria-pressed": "false",
      onclick: () => { this._group = this._group === group ? null : group; this._filter(); } })]));
    byId("groups").append(...this._buttons.values());
  }

  _arrange() {
    const cards = [...this._cards.values()];
    for (const [group, button] of this._buttons) {
      const count = cards.filter((card) => card.group === group).length;
      setText(button, `${count} ${group === "idle" && this._isOver ? "ended" : GROUPS[group]}`);
      setData(button, "count", String(count));
    }
    this._list.classList.toggle("is-over", !!this._isOver);
    this._list.classList.toggle("compact", cards.length >= ROWS_FROM);
    const wanted = cards.sort((a, b) => a.rank - b.rank || byName(a.robot, b.robot));
    const trouble = wanted.filter((card) => card.group === "trouble").map((card) => card.robot).join();
    const isHeld = this._list.matches(":hover, :focus-within") && trouble === this._trouble;
    if (!isHeld && wanted.some((card, i) => this._list.children[i] !== card.root)) {
      const focused = document.activeElement;
      // To move the focused card is to leave it, too: arranged again meanwhile, cards would get lost.
      this._isMoving = true;
      this._list.append(...wanted.map((card) => card.root));
      this._isMoving = false;
      if (this._list.contains(focused)) focused.focus({ preventScroll: true });
      this._trouble = trouble;
    }
    this._filter();
  }

  _filter() {
    let shown = 0;
    for (const card of this._cards.values()) {
      const fits = (!this._group || card.group === this._group) && contains(card.root.textContent, this._wanted);
      if (card.root.hidden === fits) card.root.hidden = !fits;
      shown += fits;
    }
    for (const [group, button] of this._buttons) button.setAttribute("aria-pressed", String(group === this._group));
    return shown;
  }

  // -- one robot --------------------------------------------------------------------------

  _card(name) {
    const part = (className) => element("div", { class: className });
    const card = { robot: name, state: element("span", { class: "state" }, element("span"), element("span", { class: "word" })), type: element("span", { class: "hint" }), task: part("task"), since: element("em", { class: "since" }),
      can: part("can"), wrong: part("wrong"), problems: part("problems"), canShown: "" };
    // Its inner part is scaled, which needs no new layout.
    card.done = element("div", {});
    card.bar = element("div", { class: "progress", role: "progressbar", "aria-label": `progress of ${name}`, "aria-valuenow": 0 }, card.done);
    card.name = element("button", { type: "button", class: "name", title: `Why does ${name} do this?`,
      onclick: () => this._select({ kind: "robot", name }) }, name);
    // By keys it is chosen by its name; with a mouse or a finger it is one target, but for its buttons.
    card.root = element("li", { class: "card", onclick: (event) => { if (!event.target.closest("button")) card.name.click(); } },
      element("div", { class: "top" }, card.name, card.type, card.state, this._control?.robotMenu(name, () => this._known(name))),
      card.task, card.bar, card.can, card.wrong, card.problems);
    this._cards.set(name, card);
    this._list.append(card.root);
    this._draw(name);
    return card;
  }

  _robot(name) {
    return this._store.get(`robot/${name}`) ?? { state: "absent", type: this._mission[name]?.type,
      capabilities: this._mission[name]?.capabilities ?? {}, lost: {}, pending: {}, idle: "" };
  }

  _draw(name) {
    const card = this._cards.get(name) ?? this._card(name);
    const robot = this._robot(name), hasTask = !!robot.local_task;
    const now = this._store.now(), isOver = this._hasEnded();
    const state = stateOf(robot, now, isOver), [sign, group] = STATES[state] ?? ["●", "idle"];
    card.group = groupOf(robot, now, isOver);
    card.rank = rankOf(robot, now, isOver);
    setData(card.root, "state", robot.state);
    setData(card.root, "group", card.group);
    setData(card.state, "is", group);
    setText(card.state.firstChild, sign);
    setText(card.state.lastChild, ` ${state}`);
    setText(card.type, robot.type ?? "");
    const phase = robot.under_way ? "on its way" : robot.phase === "ready" ? "waits for its partners" : "about to begin";
    const waits = robot.phase === "running" ? "" : `, ${phase}`;
    this._drawTask(card, robot, hasTask, waits);
    this._drawTime(card, robot, now);
    card.task.classList.toggle("none", !hasTask);
    const isRunning = robot.phase === "running" && !isOver;
    if (card.bar.hidden === isRunning) card.bar.hidden = !isRunning;
    const progress = String(robot.progress ?? 0);
    if (card.bar.getAttribute("aria-valuenow") !== progress) {
      card.bar.setAttribute("aria-valuenow", progress);
      card.done.style.transform = `scaleX(${progress / 100})`;
    }
    this._drawCan(card, robot);
    setText(card.problems, (robot.problems ?? []).map((text) => `⚠ ${text}`).join("\n"));
  }

  // A row leaves out what it is for.
  _drawTask(card, robot, hasTask, waits) {
    const whole = robot.local_task === robot.global_task ? "" : ` for ${robot.global_task}`;
    const text = hasTask ? robot.local_task : robot.idle && !this._isOver ? `free: ${robot.idle}` : "";
    const goal = waits && robot.under_way ? ` to ${robot.under_way}` : "", key = `${text}|${whole}|${waits}|${goal}`;
    if (card.taskShown === key) return;
    card.taskShown = key;
    card.task.title = hasTask ? `${text}${whole}${waits}${goal}` : "";
    card.task.replaceChildren(...(hasTask ? [text, element("span", {}, whole), waits, element("span", {}, goal)] : [text]), card.since);
  }

  _drawTime(card, robot, now) {
    const { text, isLate } = this._isOver ? { text: "", isLate: false } : timeAtWork(robot, now);
    setText(card.since, text);
    card.since.classList.toggle("late", isLate);
  }

  // Lost capabilities are struck out; below them is why.
  _drawCan(card, robot) {
    const key = JSON.stringify([robot.capabilities, robot.lost, robot.pending]);
    if (card.canShown === key) return;
    card.canShown = key;
    const parts = Object.entries(robot.capabilities).flatMap(([name, value], i) => {
      const text = value === 1 ? name : `${name} ${value}`;
      const reason = robot.lost[name] ?? robot.lost[name.split("(")[0]];
      const shown = reason === undefined ? element("span", {}, text) : element("s", { title: lostText([name], reason) }, text);
      return i ? [", ", shown] : [shown];
    });
    card.can.replaceChildren(...parts);
    card.wrong.replaceChildren(
      ...textsByReason(robot.lost).map(([reason, names]) => element("div", { class: "lost" }, `⚠ ${lostText(names, reason)}`)),
      ...textsByReason(robot.pending).map(([reason, names]) => element("div", {}, `cannot use ${names.join(", ")} now: ${reason}`)));
  }

  // What its menu depends on. A robot that is frozen is taken for dead as well: what is known is whether its process has ended.
  _known(name) {
    const { state, capabilities, lost } = this._robot(name);
    const hasEnded = [...this._store.all("fault").values()].some((fault) => fault.robot === name && fault.until_s === null && fault.has_ended);
    return { isHere: !["dead", "left", "absent"].includes(state), isFrozen: state === "suspect" || (state === "dead" && !hasEnded),
      capabilities: Object.keys(capabilities), lost: Object.keys(lost) };
  }
}
