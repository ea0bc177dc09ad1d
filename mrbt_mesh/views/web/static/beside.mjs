// A second recording: its lanes below the others, on the same axis, and the differences in numbers.

import { byId, byName, element } from "./text.mjs";

const TIMES = ["claimed_s", "running_s", "ended_s", "at_s", "until_s", "from_s", "to_s"];
const SIGN = "②";
const named = (robot) => robot && `${SIGN} ${robot}`;

export class Beside {
  constructor(told, changed) {
    this._told = told;
    this.align(0);
    this._changed = changed;
    this.robots = [...new Set(["work", "fault", "loss"].flatMap((kind) => told.lanes[kind].map((item) => named(item.robot))))].sort(byName);
    this._show();
  }

  // Its times are moved by this many seconds.
  align(shift) {
    this._shift = shift;
    const moved = (item) => ({ ...item, robot: named(item.robot), replacement: named(item.replacement), beside: true, own_s: item.at_s,
      ...Object.fromEntries(TIMES.filter((name) => typeof item[name] === "number").map((name) => [name, item[name] + shift])) });
    this._lanes = Object.fromEntries(Object.entries(this._told.lanes).map(([kind, items]) => [kind, items.map(moved)]));
  }

  items(kind) { return this._lanes[kind] ?? []; }

  get from() { return this._told.from_s + this._shift; }

  get to() { return this._told.to_s + this._shift; }

  _show() {
    const { files, results, figures, torn, first_death_s: [own, other] } = this._told;
    const value = (number, unit, sign = "") => (number === null ? "–" : `${number > 0 ? sign : ""}${Number(number.toFixed(3))} ${unit}`);
    const choice = element("select", { onchange: () => { this.align(choice.value === "death" ? own - other : 0); this._changed(); } },
      element("option", { value: "start" }, "the start"), ...(own !== null && other !== null ? [element("option", { value: "death" }, "the first death")] : []));
    byId("beside").replaceChildren(element("label", { class: "check" }, "aligned at ", choice),
      element("table", {}, element("thead", {}, element("tr", {}, element("td", {}), element("th", { scope: "col" }, files[0]),
        element("th", { scope: "col" }, `${SIGN} ${files[1]}`), element("th", { scope: "col" }, "difference"))),
      element("tbody", {}, element("tr", {}, element("th", { scope: "row" }, "result"), ...results.map((result) => element("td", {}, result)), element("td", {})),
        ...figures.map(({ figure, unit, first, second, difference }) => element("tr", {}, element("th", { scope: "row" }, figure),
          element("td", {}, value(first, unit)), element("td", {}, value(second, unit)), element("td", {}, value(difference, unit, "+")))))),
      ...(torn ? [element("p", { class: "soft" }, `${files[1]}: ${torn}`)] : []));
    byId("beside").hidden = false;
  }
}
