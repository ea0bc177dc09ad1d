// Orders and drills: only where the server offers them, and with the token of the printed address.

import { byId, element, setText } from "./text.mjs";

const WORDS = { kill: "Kill", freeze: "Freeze", thaw: "Thaw", join: "Start again", lose: "Lose", restore: "Restore",
  leave: "Leave", pause: "Pause", resume: "Resume", abort: "Abort" };

// The token stands in the fragment, which no server is sent; from there it is put out of sight.
export function takeToken() {
  const token = location.hash.slice(1);
  if (token) {
    sessionStorage.setItem("mrbt-token", token);
    history.replaceState(null, "", location.pathname);
  }
  return sessionStorage.getItem("mrbt-token") ?? "";
}

export class Control {
  constructor(offers, token) {
    this.offers = offers;
    this._token = token;
    this._drills = null;
    this._makeTeamOrders();
  }

  button(act, robot, more = {}) {
    const kind = act === "kill" || act === "abort" ? "danger" : undefined;
    const text = robot ? `${WORDS[act]} ${robot}` : WORDS[act];
    return element("button", { type: "button", class: kind, title: (this.offers.robot[act] ?? this.offers.team[act]),
      "aria-label": text, "data-act": act,
      onclick: (event) => this._press(event.currentTarget, { act, ...(robot ? { robot } : {}), ...more }) }, WORDS[act]);
  }

  // What can be done to one robot, each with what it will do.
  details(robot, capabilities, lost) {
    const rows = element("div", { class: "do" });
    for (const act of ["kill", "freeze", "thaw", "join", "leave"]) {
      if (this.offers.robot[act]) rows.append(this.button(act, robot), element("span", { class: "hint" }, this.offers.robot[act]));
    }
    for (const [act, tasks] of [["lose", ["all", ...capabilities]], ["restore", ["all", ...lost]]]) {
      if (!this.offers.robot[act]) continue;
      const choice = element("select", { "aria-label": `capability to ${act}` },
        ...tasks.map((task) => element("option", { value: task }, task)));
      const press = element("button", { type: "button", onclick: (event) =>
        this._press(event.currentTarget, { act, robot, local_task: choice.value }) }, WORDS[act]);
      rows.append(press, element("span", { class: "hint" }, this.offers.robot[act]), element("span", { class: "wide" }, choice));
    }
    return rows;
  }

  _makeTeamOrders() {
    const orders = byId("team-orders");
    orders.hidden = false;
    for (const act of ["pause", "resume", "abort"]) orders.append(this.button(act));
    if (this.offers.drills) {
      orders.append(element("button", { type: "button", title: "Faults at chosen moments, from the drill files", onclick: () => this._openDrills() }, "Drills…"));
      byId("drills-close").addEventListener("click", () => byId("drills").close());
      byId("drills-search").addEventListener("input", () => this._listDrills());
    }
  }

  async _press(button, order) {
    if (order.act === "abort" && button.textContent === WORDS.abort) {
      button.textContent = "Really abort?";
      setTimeout(() => { button.textContent = WORDS.abort; }, 4000);
      return;
    }
    button.disabled = true;
    await this._send(order);
    button.disabled = false;
  }

  async _fetch(path, options = {}) {
    const headers = { "x-mrbt-token": this._token, "content-type": "application/json" };
    return fetch(path, { ...options, headers });
  }

  async _send(order) {
    try {
      const answer = await this._fetch("/orders", { method: "POST", body: JSON.stringify(order) });
      const isTold = (answer.headers.get("content-type") ?? "").startsWith("application/json");
      toast(isTold ? (await answer.json()).text : await answer.text());
    } catch {
      toast("The server does not answer.");
    }
  }

  async _openDrills() {
    byId("drills").showModal();
    if (this._drills) return;
    setText(byId("drills-list"), "reading the drill files…");
    try {
      const answer = await this._fetch("/drills");
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

function toast(text) {
  const shown = byId("toast");
  setText(shown, text);
  shown.hidden = false;
  clearTimeout(hiding);
  hiding = setTimeout(() => { shown.hidden = true; }, 5000);
}
