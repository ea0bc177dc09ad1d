// The list of this machine's runs.

import { takeToken } from "./control.mjs";
import { LEVEL_SIGN, byId, element, setText, withCommands } from "./text.mjs";

const LOOK_MS = 2000;

// As `mrbt ls` writes it: the date only of other days.
function since(unix) {
  if (unix === null) return "";
  const at = new Date(unix * 1000), time = at.toLocaleTimeString();
  return at.toDateString() === new Date().toDateString() ? `since ${time}` : `${at.toLocaleDateString()} ${time}`;
}

function robotsText({ result, robots, alive, dead }) {
  if (result !== "running") return `${robots} robots`;
  return `${alive} of ${robots} alive${dead ? `, ${dead} dead` : ""}`;
}

function row(run) {
  const { level, text } = run.headline;
  const name = run.run ? element("a", { href: `run/${run.run}/` }, run.team) : run.team;
  return element("li", { class: "panel", "data-level": level, "data-running": run.result === "running" }, element("h2", {}, name),
    element("p", {}, element("span", { class: "statement", "data-level": level },
      element("span", { "aria-hidden": "true" }, `${LEVEL_SIGN[level]} `), ...withCommands(text))),
    element("span", {}, robotsText(run)), element("span", { class: "hint" }, since(run.started_unix_s)));
}

let shown = "";

async function look() {
  try {
    const { runs } = await (await fetch("runs?headlines")).json(), key = JSON.stringify(runs);
    const running = runs.filter((run) => run.result === "running").length;
    setText(byId("runs-hint"), runs.length ? `${running} of ${runs.length} running` : "No run is known here yet: start one with mrbt up.");
    if (key !== shown) {
      // The link that has the focus keeps it.
      const focused = document.activeElement?.getAttribute("href");
      byId("runs").replaceChildren(...runs.map(row));
      if (focused) byId("runs").querySelector(`a[href="${CSS.escape(focused)}"]`)?.focus();
      shown = key;
    }
  } catch {
    setText(byId("runs-hint"), "connection lost: this is what was last known; trying again…");
  }
  setTimeout(look, LOOK_MS);
}

takeToken();
look();
