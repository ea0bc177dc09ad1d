// Signs and words that several parts of the page share.

export const STATUS = ["idle", "running", "success", "failure"];
export const SIGN = { idle: "·", running: "▶", success: "✓", failure: "✕" };
const KINDS = {
  Sequence: "→", Fallback: "?", Parallel: "⇉", IfThenElse: "⋔", Inverter: "!", ForceSuccess: "✓!",
  ForceFailure: "✕!", RetryUntilSuccessful: "↻", Repeat: "↻", KeepRunningUntilFailure: "↻",
  Timeout: "◷", SubTree: "▣", Condition: "○", Action: "",
};

export const kindSign = (kind) => KINDS[kind] ?? "◆";

export function seconds(value) {
  if (value === null || value === undefined) return "";
  if (value < 600) return `${value.toFixed(1)} s`;
  return `${Math.floor(value / 60)} min ${String(Math.floor(value % 60)).padStart(2, "0")} s`;
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
