// Why: what is selected, explained by the server from the plan.

import { ENDS, SIGN, STATUS, byId, due, element, kindSign, lostText, seconds, setText, withCommands } from "./text.mjs";

const AGAIN_MS = 300;
// Entries of a robot's history that are shown.
const HISTORY = 30;
const TREES = ["T_i", "T_A", "T_G", "T_Li"];

// A drawer. It opens by itself on what is blocked, else on the newest fault, until somebody selects something.
export class WhyView {
  constructor(store, select) {
    this._store = store;
    this._select = select;
    this._selection = null;
    this._timer = 0;
    this._shown = "";
    this._worst = undefined;
    // Times of what happens next, with what shows them.
    this._times = [];
    byId("why-close").addEventListener("click", () => this._close());
    byId("why").addEventListener("keydown", (event) => { if (event.key === "Escape") this._close(); });
  }

  show(selection) {
    this._opener = document.activeElement;
    this._isByHand = true;
    this._open(selection);
  }

  _open(selection) {
    this._selection = selection;
    this._shown = "";
    byId("why").hidden = false;
    byId("why").classList.toggle("by-hand", !!this._isByHand);
    document.querySelector("main").classList.add("has-why");
    this._load();
  }

  _close() {
    this._selection = null;
    this._isByHand = false;
    byId("why").hidden = true;
    document.querySelector("main").classList.remove("has-why");
    if (this._opener?.isConnected) this._opener.focus();
  }

  // What is selected may have changed: it is asked again, but not all the time.
  update(keys) {
    this._follow();
    const chosen = this._selection;
    if (!chosen || this._timer) return;
    const wanted = chosen.kind === "fault" ? `why/${chosen.name}` : `${chosen.kind}/${chosen.name}`;
    if (![wanted, `fault/${chosen.name}`, "forecast"].some((key) => keys.has(key))) return;
    this._timer = setTimeout(() => { this._timer = 0; if (this._selection) this._load(); }, AGAIN_MS);
  }

  // In a recording, the newest fault until where it is.
  _follow() {
    const first = (kind, why) => { const found = [...this._store.all(kind)].find(([, each]) => why(each)?.startsWith("blocked")); return found && { kind, name: found[0] }; };
    const isOver = !!this._store.get("team")?.ended;
    const blocked = isOver ? undefined : first("task", (task) => task.reason) ?? first("job", (job) => job.why);
    const now = this._store.now();
    const past = [...this._store.all("fault")].filter(([, fault]) => fault.at_s === null || now === null || fault.at_s <= now);
    const newest = past.sort((a, b) => (a[1].at_s ?? 0) - (b[1].at_s ?? 0)).at(-1)?.[0];
    const worst = blocked ?? (newest && { kind: "fault", name: newest });
    const key = worst && `${worst.kind}/${worst.name}`;
    if (key === this._worst) return;
    this._worst = key;
    if (this._isByHand) return;
    if (worst) this._open(worst); else this._close();
  }

  async _load() {
    const chosen = this._selection;
    let told = null, trees = null;
    if (chosen.kind === "fault") {
      const fault = this._store.get(`fault/${chosen.name}`);
      told = this._store.get(`why/${chosen.name}`) ?? this._untaken(chosen.name);
      const isDead = told && fault && fault.until_s === null && this._store.get(`robot/${fault.robot}`)?.state === "dead";
      if (isDead) told = { ...told, next: (await fetched(`why/robot/${encodeURIComponent(fault.robot)}`))?.next };
    } else {
      [told, trees] = await Promise.all([
        fetched(`why/${chosen.kind}/${encodeURIComponent(chosen.name)}`),
        chosen.kind === "robot" ? fetched(`trees/${encodeURIComponent(chosen.name)}`) : null,
      ]);
    }
    if (chosen !== this._selection || !told) return;
    const key = JSON.stringify([told, trees, this._store.get(`robot/${chosen.name}`)?.statuses]);
    if (key === this._shown) return;
    this._shown = key;
    this._draw(chosen, told, trees);
  }

  _untaken(index) {
    const fault = this._store.get(`fault/${index}`);
    if (!fault) return null;
    const held = fault.older ? `who took over its ${fault.held ?? "work"} was not watched` : fault.held ? (fault.wanted ? `nobody has taken over its ${fault.held} yet` : `its ${fault.held} is no longer needed`) : "it held no task";
    return { subject: fault.robot, sentence: `${fault.robot} died ${fault.older ? "before" : "at"} ${seconds(fault.at_s)}; ${held}.`, groups: [] };
  }

  _draw(chosen, told, trees) {
    const body = byId("why-body");
    const parts = [element("h3", {}, told.subject), element("p", { class: "sentence" }, told.sentence), ...this._next(told.next ?? [])];
    for (const group of told.groups) {
      if (!group.candidates.length) continue;
      if (told.groups.length > 1) parts.push(element("h3", {}, group.local_task));
      parts.push(element("table", { "aria-label": `Who can do ${group.local_task}` },
        element("thead", {}, element("tr", {}, element("th", { scope: "col" }, "robot"),
          element("th", { scope: "col" }, "how well"), element("th", { scope: "col" }, "why, why not"))),
        element("tbody", {}, ...group.candidates.map((each) => this._candidate(each)))));
    }
    const statuses = chosen.kind === "robot" ? this._store.get(`robot/${chosen.name}`)?.statuses ?? [] : [];
    if (statuses.length) {
      parts.push(element("p", { class: "hint" }, ...statuses.flatMap((status, i) => [`${TREES[i]} `,
        element("span", { class: `s-${status}` }, `${SIGN[status]} ${status} `)])));
    }
    if (chosen.kind === "robot") parts.push(...this._history(chosen.name));
    if (trees) {
      for (const name of ["T_A", "T_Li"]) {
        parts.push(element("h3", {}, `${name}: ${name === "T_A" ? "how it plans" : "its own tasks"}`), ownTree(trees[name], name));
      }
    }
    body.replaceChildren(...parts);
  }

  // What a robot has done and lost, the newest first.
  _history(name) {
    const of = (kind) => [...this._store.all(kind).values()].filter((each) => each.robot === name);
    const rows = [
      ...of("work").map((work) => [work.claimed_s, `${work.local_task} for ${work.global_task}: ${ENDS[work.end ?? "running"]}${work.reason ? `: ${work.reason}` : ""}`]),
      ...of("fault").map((fault) => [fault.at_s, "died"]), ...of("fault").filter((fault) => fault.until_s !== null).map((fault) => [fault.until_s, "back"]),
      ...of("loss").map((loss) => [loss.at_s, lostText(loss.local_tasks, loss.reason)]),
    ].sort((a, b) => b[0] - a[0]).slice(0, HISTORY);
    return rows.length ? [element("h3", {}, "What it did, the newest first"),
      element("ol", { class: "events" }, ...rows.map(([at, text]) => element("li", {}, element("time", {}, seconds(at)), element("span", {}, text))))] : [];
  }

  // What happens next, with the time until then.
  _next(steps) {
    this._times = steps.map(({ at_s: at }) => ({ at, shown: element("b") }));
    if (!steps.length) return [];
    const rows = steps.map(({ text }, i) => element("li", {}, ...withCommands(text), " ", this._times[i].shown));
    this.tick();
    return [element("h3", {}, "What happens next"), element("ul", { class: "steps" }, ...rows)];
  }

  // Between changes time passes.
  tick() {
    const now = this._store.now();
    for (const { at, shown } of this._times) setText(shown, at === null || now === null ? "" : due(at - now));
  }

  _candidate(each) {
    const name = element("button", { type: "button", class: "link", onclick: () => this._select({ kind: "robot", name: each.robot }) }, each.robot);
    const number = each.performance === null ? "no bid" : String(Math.round(each.performance * 1000) / 1000);
    return element("tr", { class: each.chosen ? "chosen" : undefined },
      element("td", {}, name), element("td", { class: "number" }, number), element("td", {}, each.reason));
  }
}

function ownTree(told, name) {
  const depths = [];
  return element("div", { class: "own", role: "list", "aria-label": name }, ...told.tree.map((node, index) => {
    depths[index] = node.parent < 0 ? 0 : depths[node.parent] + 1;
    const status = STATUS[told.statuses[index]];
    // That a condition does not hold is no failure of anybody.
    const look = node.kind === "Condition" && status === "failure" ? "idle" : status;
    const row = element("div", { role: "listitem" }, element("span", { class: `s-${look}`, title: status }, SIGN[status]),
      element("span", { class: status === "idle" ? "hint" : undefined }, `${kindSign(node.kind)} ${node.label}`.trim()));
    row.style.setProperty("--depth", depths[index]);
    return row;
  }));
}

async function fetched(path) {
  try {
    const answer = await fetch(path);
    return answer.ok ? await answer.json() : null;
  } catch {
    return null;
  }
}
