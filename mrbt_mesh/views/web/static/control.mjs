// Commands and drills: only where the server offers them, and with the token of the printed address.

import { byId, dialog, element, placeMenu, setText } from "./text.mjs";

const WORDS = { kill: "Kill", freeze: "Freeze", thaw: "Thaw", join: "Start again", lose: "Lose", restore: "Restore",
  leave: "Leave", pause: "Pause", resume: "Resume", abort: "Abort" };

// The token stands in the fragment, which no server is sent; from there it is put out of sight.
export function takeToken() {
  const token = location.hash.slice(1);
  if (token) {
    sessionStorage.setItem("mrbt-token", token);
    history.replaceState(null, "", location.pathname + location.search);
  }
  return sessionStorage.getItem("mrbt-token") ?? "";
}

export class Control {
  constructor(offers, token) {
    this.offers = offers;
    this._token = token;
    this._drills = null;
    this._menu = byId("menu");
    this._makeTeamOrders();
  }

  // Of pause and resume, the one that has an effect now.
  update(keys, store) {
    if (!keys.has("team")) return;
    const { command, ended } = store.get("team") ?? {};
    byId("team-commands").hidden = !!ended || store.state === "over";
    this._pause.replaceChildren(this._button(command === "pause" ? "resume" : "pause"));
  }

  // A button that opens a menu with what `rows` returns.
  menuButton(label, text, rows) {
    const made = element("button", { type: "button", class: "more", "aria-label": label, title: label, onclick: () => {
      this._menu.setAttribute("aria-label", label);
      this._menu.replaceChildren(...rows());
      this._menu.querySelector("button")?.setAttribute("autofocus", "");
      placeMenu(this._menu, made);
    } }, text);
    made.popoverTargetElement = this._menu;
    return made;
  }

  // What can be done to a robot, each with what it will do. `robot()`: what is known of it then.
  robotMenu(name, robot) {
    return this.menuButton(`Commands to ${name}`, "⋯", () => {
      const { isHere, isFrozen, capabilities, lost } = robot();
      const acts = isFrozen ? ["thaw", "kill"] : isHere ? ["kill", "freeze", "leave"] : ["join"];
      const rows = acts.flatMap((act) => this._row(act, name));
      if (isHere) rows.push(...this._choice("lose", name, ["all", ...capabilities]));
      if (isHere && lost.length) rows.push(...this._choice("restore", name, ["all", ...lost]));
      return rows;
    });
  }

  _hint(act) { return element("span", { class: "hint" }, this.offers.robot[act] ?? this.offers.team[act]); }

  _row(act, robot) {
    return this.offers[robot ? "robot" : "team"][act] ? [this._button(act, robot), this._hint(act)] : [];
  }

  _choice(act, robot, tasks) {
    const choice = element("select", { "aria-label": `capability to ${act}` }, ...tasks.map((task) => element("option", { value: task }, task)));
    const button = element("button", { type: "button", onclick: (event) => this._press(event.currentTarget, { act, robot, local_task: choice.value }) }, WORDS[act]);
    return [button, element("span", {}, choice, " ", this._hint(act))];
  }

  _button(act, robot) {
    return element("button", { type: "button", class: act === "kill" || act === "abort" ? "danger" : undefined,
      "aria-label": robot ? `${WORDS[act]} ${robot}` : WORDS[act], title: this.offers.robot[act] ?? this.offers.team[act],
      onclick: (event) => this._press(event.currentTarget, { act, ...(robot ? { robot } : {}) }) }, WORDS[act]);
  }

  _makeTeamOrders() {
    this._pause = element("span", {}, this._button("pause"));
    byId("team-commands").append(this._pause, this.menuButton("Commands to the team", "Commands…", () => [...this._row("abort"),
      ...(this.offers.drills ? [element("button", { type: "button", onclick: () => this._openDrills() }, "Drills…"),
        element("span", { class: "hint" }, "Faults at chosen moments, from the drill files.")] : [])]));
    byId("team-commands").hidden = false;
    dialog("drills");
    byId("drills-search").addEventListener("input", () => this._listDrills());
  }

  async _press(button, command) {
    if (command.act === "abort" && button.textContent === WORDS.abort) {
      button.textContent = "Really abort?";
      setTimeout(() => { button.textContent = WORDS.abort; }, 4000);
      return;
    }
    button.disabled = true;
    this._menu.hidePopover();
    await this._send(command);
    button.disabled = false;
  }

  async _fetch(path, options = {}) {
    const headers = { "x-mrbt-token": this._token, "content-type": "application/json" };
    return fetch(path, { ...options, headers });
  }

  // Asks for something about jobs; why it is refused, or "".
  async ask(path, body = {}) {
    try {
      const answer = await this._fetch(`v1/jobs${path}`, { method: "POST", body: JSON.stringify(body) });
      return answer.ok ? "" : (await answer.json()).detail;
    } catch {
      return "The server does not answer.";
    }
  }

  closeMenu() { this._menu.hidePopover(); }

  async _send(command) {
    try {
      const answer = await this._fetch("commands", { method: "POST", body: JSON.stringify(command) });
      const isTold = (answer.headers.get("content-type") ?? "").startsWith("application/json");
      toast(isTold ? (await answer.json()).text : await answer.text());
    } catch {
      toast("The server does not answer.");
    }
  }

  async _openDrills() {
    this._menu.hidePopover();
    byId("drills").showModal();
    if (this._drills) return;
    setText(byId("drills-list"), "reading the drill files…");
    try {
      const answer = await this._fetch("drills");
      if (!answer.ok) return setText(byId("drills-list"), await answer.text());
      this._drills = await answer.json();
    } catch {
      return setText(byId("drills-list"), "The server does not answer.");
    }
    this._listDrills();
  }

  _listDrills() {
    if (!this._drills) return;
    const wanted = byId("drills-search").value.trim().toLowerCase();
    const found = this._drills.filter((drill) => `${drill.label} ${drill.description}`.toLowerCase().includes(wanted));
    byId("drills-list").replaceChildren(...found.map((drill) => element("li", {},
      element("div", { class: "top" }, element("b", {}, drill.label), element("span", { class: "grow" }),
        element("button", { type: "button", "aria-label": `Carry out ${drill.label}`, onclick: async () => {
          byId("drills").close();
          await this._send({ act: "drill", label: drill.label });
        } }, "Carry out")),
      element("span", {}, drill.description),
      element("ol", {}, ...drill.steps.map((step) => element("li", {}, step))))));
    if (!found.length) setText(byId("drills-list"), "no drill fits this mission");
  }
}

let hiding = 0;

export function toast(text) {
  const shown = byId("toast");
  setText(shown, text);
  shown.hidden = false;
  clearTimeout(hiding);
  hiding = setTimeout(() => { shown.hidden = true; }, 5000);
}

export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    toast(`Copied: ${text}`);
  } catch {
    toast(text);
  }
}
