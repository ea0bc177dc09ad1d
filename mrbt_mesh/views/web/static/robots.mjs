// The robots as cards.

import { SIGN, byId, element, hasDifferedLong, lostText, setData, setText, textsByReason } from "./text.mjs";

const SIGNS = { alive: "●", joining: "◌", suspect: "◐", leaving: "◍", dead: "✕", left: "○", absent: "○" };
const TREES = ["T_i", "T_A", "T_G", "T_Li"];
const MEANINGS = ["all it does", "how it plans", "the team's tree", "its own tasks"];

export class RobotsView {
  constructor(store, robots, select, control) {
    this._store = store;
    this._mission = robots;
    this._select = select;
    this._control = control;
    this._cards = new Map();
    this._selected = null;
    for (const name of Object.keys(robots)) this._card(name);
  }

  update(keys) {
    let isNew = false;
    for (const key of keys) {
      if (key.startsWith("robot/")) { this._draw(key.slice(6)); isNew = true; }
      else if (key.startsWith("fault/") && this._store.get(key)) this._draw(this._store.get(key).robot);
    }
    if (isNew || keys.has("team")) this._count();
  }

  select(name) {
    this._selected = name;
    for (const [robot, card] of this._cards) card.root.classList.toggle("selected", robot === name);
  }

  _count() {
    const counts = new Map();
    for (const robot of this._store.all("robot").values()) counts.set(robot.state, (counts.get(robot.state) ?? 0) + 1);
    setText(byId("robots-hint"), [...counts].map(([state, count]) => `${count} ${state}`).join(", "));
  }

  _card(name) {
    const part = (tag, className) => element(tag, { class: className });
    const card = { state: part("span", "state"), type: part("span", "hint"), task: part("div", "task"),
      can: part("div", "can"), wrong: part("div", "wrong"), problems: part("div", "problems"), trees: part("div", "trees"), buttons: part("div", "buttons"), shown: "", canShown: "" };
    // Its inner part is scaled, which needs no new layout.
    card.done = element("div", {});
    card.bar = element("div", { class: "progress", role: "progressbar", "aria-label": `progress of ${name}`, "aria-valuenow": 0 }, card.done);
    card.name = element("button", { type: "button", class: "name", title: `Why does ${name} do this?`,
      onclick: () => this._select({ kind: "robot", name }) }, name);
    // By keys it is chosen by its name; with a mouse or a finger it is one target, but for its buttons.
    card.root = element("li", { class: "card", onclick: (event) => { if (!event.target.closest("button")) card.name.click(); } },
      element("div", { class: "top" }, card.name, card.type, card.state), card.task, card.bar, card.can, card.wrong, card.problems, card.trees, card.buttons);
    this._cards.set(name, card);
    const after = [...this._cards.keys()].sort().indexOf(name);
    byId("cards").insertBefore(card.root, byId("cards").children[after] ?? null);
    this._draw(name);
    return card;
  }

  _draw(name) {
    const card = this._cards.get(name) ?? this._card(name);
    const robot = this._store.get(`robot/${name}`) ?? {
      state: "absent", type: this._mission[name]?.type, capabilities: this._mission[name]?.capabilities ?? {}, lost: {}, pending: {}, statuses: [], idle: "" };
    setData(card.root, "state", robot.state);
    setText(card.state, `${SIGNS[robot.state] ?? "●"} ${this._stateText(robot)}`);
    setText(card.type, robot.type ?? "");
    const isAt = robot.local_task !== null && robot.local_task !== undefined;
    const waits = robot.phase === "running" ? "" : ` (${robot.phase === "ready" ? "waits for its partners" : "about to begin"})`;
    setText(card.task, isAt ? `${robot.local_task}${robot.local_task === robot.global_task ? "" : ` for ${robot.global_task}`}${waits}` : robot.idle ? `free: ${robot.idle}` : "no task");
    if (card.task.title !== card.task.textContent) card.task.title = card.task.textContent;
    if (card.task.classList.contains("none") === isAt) card.task.classList.toggle("none", !isAt);
    const visibility = robot.phase === "running" ? "" : "hidden";
    if (card.bar.style.visibility !== visibility) card.bar.style.visibility = visibility;
    const progress = String(robot.progress ?? 0);
    if (card.bar.getAttribute("aria-valuenow") !== progress) {
      card.bar.setAttribute("aria-valuenow", progress);
      card.done.style.transform = `scaleX(${progress / 100})`;
    }
    this._drawCan(card, robot);
    setText(card.problems, (robot.problems ?? []).map((text) => `⚠ ${text}`).join("\n"));
    this._drawTrees(card, robot.statuses);
    if (this._control) this._drawButtons(card, name, robot);
  }

  _drawTrees(card, statuses) {
    const key = statuses.join();
    if (card.treesShown === key) return;
    card.treesShown = key;
    setText(card.trees, "");
    statuses.forEach((status, i) => card.trees.append(
      element("span", { title: `${TREES[i]}, ${MEANINGS[i]}: ${status}` }, `${TREES[i]} `,
        element("span", { class: `s-${status}`, "aria-hidden": "true" }, SIGN[status]), element("span", { class: "said" }, status))));
  }

  _stateText(robot) {
    if (hasDifferedLong(robot.differs_since_s, this._store.now())) return "differs";
    if (robot.state === "alive" && this._store.get("team")?.stands_by) return "standing by";
    return robot.state === "absent" ? "not started" : robot.state;
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
      ...textsByReason(robot.lost).map(([reason, names]) => element("div", { class: "lost" }, lostText(names, reason))),
      ...textsByReason(robot.pending).map(([reason, names]) => element("div", {}, `${names.join(", ")} not yet: ${reason}`)));
  }

  // Whether its process is known to have ended: one that is frozen is taken for dead as well.
  _hasEnded(name) {
    return [...this._store.all("fault").values()].some((fault) => fault.robot === name && fault.until_s === null && fault.has_ended);
  }

  _drawButtons(card, name, robot) {
    const isHere = !["dead", "left", "absent"].includes(robot.state);
    const isFrozen = robot.state === "suspect" || (robot.state === "dead" && !this._hasEnded(name));
    const acts = isFrozen ? ["kill", "thaw"] : isHere ? ["kill", "freeze"] : ["join"];
    const offered = acts.filter((act) => this._control.offers.robot[act]);
    const key = offered.join();
    if (card.shown === key) return;
    card.shown = key;
    card.buttons.replaceChildren(...offered.map((act) => this._control.button(act, name)));
  }
}
