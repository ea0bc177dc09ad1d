// The tree T_G as rows, of which only those are made that can be seen.

import { STATUS, SIGN, byId, byName, contains, element, kindSign, setData, setText } from "./text.mjs";

const ROW = 26;
const SIZES = [11, 12, 13, 15, 17, 20];
// Larger trees begin folded, below the second level if it has not too many rows.
const LARGE = 150, MOST_ROWS = 100;
const AROUND = 6;
// What is finished above it is not folded: the steps of the mission are seen to its end.
const KEPT_DEPTH = 2;

export class TreeView {
  constructor(store, nodes, select) {
    this._store = store;
    this._nodes = nodes.map((node, index) => ({ ...node, index, children: [], depth: 0, end: index }));
    for (const node of this._nodes) {
      if (node.parent < 0) continue;
      this._nodes[node.parent].children.push(node.index);
      node.depth = this._nodes[node.parent].depth + 1;
    }
    for (let i = this._nodes.length - 1; i > 0; i--) {
      const parent = this._nodes[this._nodes[i].parent];
      parent.end = Math.max(parent.end, this._nodes[i].end);
    }
    this._select = select;
    this._folded = new Set();
    this._opened = new Set();
    this._rows = new Map();
    this._shown = [];
    this._place = new Map();
    this._hits = new Set();
    // Nodes with robots or a note, for the folded nodes around them.
    this._marked = new Map();
    this._size = 2;
    this._current = 0;
    this._top = 0;
    this._seen = 0;
    this._scroller = byId("rows");
    this._inner = byId("rows-inner");
    if (nodes.length > LARGE) this._foldBelow(this._nodes.filter((n) => n.depth <= 2).length > MOST_ROWS ? 1 : 2);
    this._listen();
    this._layout();
    setText(byId("tree-hint"), `${nodes.length} nodes`);
  }

  update(keys) {
    let isMoved = false, isNew = false;
    for (const key of keys) {
      if (!key.startsWith("node/")) continue;
      isNew = true;
      const index = Number(key.slice(5)), [, robots = [], note = ""] = this._store.get(key) ?? [];
      if (robots.length || note) this._marked.set(index, [robots, note]); else this._marked.delete(index);
      isMoved ||= byId("fold-finished").checked;
    }
    if (isMoved) this._layout();
    else if (isNew) this._draw();
  }

  // -- which rows there are ---------------------------------------------------------------

  _status(index) { return STATUS[this._store.get(`node/${index}`)?.[0] ?? 0]; }

  _isFolded(node) {
    if (node.children.length === 0 || this._opened.has(node.index)) return false;
    if (this._folded.has(node.index)) return true;
    return node.depth >= KEPT_DEPTH && byId("fold-finished").checked && ["success", "failure"].includes(this._status(node.index));
  }

  _layout() {
    this._shown = [];
    for (let i = 0; i < this._nodes.length;) {
      const node = this._nodes[i];
      this._shown.push(i);
      i = this._isFolded(node) ? node.end + 1 : i + 1;
    }
    this._place = new Map(this._shown.map((index, row) => [index, row]));
    if (!this._place.has(this._current)) this._current = this._nearestShown(this._current);
    this._inner.style.height = `${this._shown.length * this._height}px`;
    this._draw();
  }

  _nearestShown(index) {
    while (index > 0 && !this._place.has(index)) index = this._nodes[index].parent;
    return Math.max(0, index);
  }

  get _height() { return Math.round(ROW * SIZES[this._size] / 13); }

  _foldBelow(depth) {
    this._opened.clear();
    this._folded = new Set(this._nodes.filter((n) => n.depth >= depth && n.children.length).map((n) => n.index));
  }

  _toggle(index, isOpen = this._isFolded(this._nodes[index])) {
    if (isOpen) { this._folded.delete(index); this._opened.add(index); }
    else { this._opened.delete(index); this._folded.add(index); }
    this._layout();
  }

  // -- drawing ----------------------------------------------------------------------------

  _draw() {
    // Both are kept: to read them from the page would have it laid out anew each time.
    const height = this._height, top = this._top;
    const first = Math.max(0, Math.floor(top / height) - AROUND);
    const last = Math.min(this._shown.length, Math.ceil((top + this._seen) / height) + AROUND);
    const wanted = new Set(this._shown.slice(first, last));
    if (this._shown.length) wanted.add(this._current);
    for (const [index, row] of this._rows) {
      if (!wanted.has(index)) { row.root.remove(); this._rows.delete(index); }
    }
    for (const index of wanted) this._row(index, this._place.get(index), height);
  }

  _row(index, place, height) {
    const node = this._nodes[index];
    let row = this._rows.get(index);
    if (!row) {
      row = this._make(node);
      this._rows.set(index, row);
      this._inner.append(row.root);
    }
    const times = this._store.get(`node/${index}`)?.[3] ?? 0;
    const status = this._status(index), isFolded = this._isFolded(node);
    const [robots, note, inner = ""] = isFolded ? this._inside(node) : this._marked.get(index) ?? [[], ""];
    const y = `translateY(${place * height}px)`;
    if (row.root.style.transform !== y) row.root.style.transform = y;
    setData(row.root, "is", status);
    setText(row.sign, SIGN[status]);
    const look = `${status} ${place} ${height} ${isFolded} ${inner} ${robots} ${note} ${times} ${this._hits.has(index)} ${index === this._current}`;
    if (row.look === look) return;
    row.look = look;
    setText(row.twist, node.children.length ? (isFolded ? "▸" : "▾") : "");
    setText(row.label, inner ? `${node.label} · ${inner}` : node.label);
    setText(row.note, note);
    row.note.hidden = !note;
    row.note.classList.toggle("blocked", note === "blocked");
    const who = robots.length > 6 ? `${robots.slice(0, 5).join(" ")} +${robots.length - 5}` : robots.join(" ");
    setText(row.who, who);
    // Who works there says that it runs.
    setText(row.word, status === "idle" || (who && status === "running") ? "" : status);
    row.who.hidden = !who;
    setText(row.times, times > 1 ? `×${times}` : "");
    row.root.classList.toggle("hit", this._hits.has(index));
    const isCurrent = index === this._current;
    row.root.tabIndex = isCurrent ? 0 : -1;
    row.root.setAttribute("aria-selected", String(isCurrent));
    if (node.children.length) row.root.setAttribute("aria-expanded", String(!isFolded));
    const said = `${node.kind}: ${node.label}, ${status}`;
    if (row.root.title !== said) row.root.title = said;
  }

  // Who works within a folded node, whether something is blocked there, and at what task it is, else the first of its tasks.
  _inside(node) {
    const marked = [...this._marked].filter(([index]) => index >= node.index && index <= node.end), marks = marked.map(([, mark]) => mark);
    const task = marked[0]?.[0] ?? this._nodes.slice(node.index, node.end + 1).find((inner) => inner.kind === "Action")?.index;
    return [[...new Set(marks.flatMap(([robots]) => robots))].sort(byName), ["blocked", "waits"].find((note) => marks.some((mark) => mark[1] === note)) ?? "",
      node.name || task === undefined ? "" : this._nodes[task].label];
  }

  _make(node) {
    const part = (name, isSign = false) => element("span", { class: name, "aria-hidden": isSign ? "true" : undefined });
    const row = { twist: part("twist", true), sign: part("sign", true), kind: part("kind", true), label: part("label"),
      word: part("word"), note: part("note"), who: part("who"), times: part("times") };
    setText(row.kind, kindSign(node.kind));
    setText(row.label, node.label);
    const siblings = node.parent < 0 ? [node.index] : this._nodes[node.parent].children;
    row.root = element("div", {
      class: `row ${node.kind.toLowerCase()}`, role: "treeitem", "aria-level": node.depth + 1,
      "aria-posinset": siblings.indexOf(node.index) + 1, "aria-setsize": siblings.length, "data-index": node.index,
    }, row.twist, row.sign, kindSign(node.kind) ? row.kind : null, row.label, row.who, row.note, row.word, row.times);
    row.root.style.setProperty("--depth", Math.min(node.depth, 12));
    return row;
  }

  // -- what people do ---------------------------------------------------------------------

  _listen() {
    this._scroller.addEventListener("scroll", () => { this._top = this._scroller.scrollTop; this._draw(); }, { passive: true });
    new ResizeObserver(() => { this._seen = this._scroller.clientHeight; this._draw(); }).observe(this._scroller);
    this._inner.addEventListener("click", (event) => {
      const row = event.target.closest(".row");
      if (!row) return;
      const index = Number(row.dataset.index);
      if (event.target.classList.contains("twist")) this._toggle(index);
      this._goTo(index);
      this._choose(index);
    });
    this._inner.addEventListener("dblclick", (event) => {
      const row = event.target.closest(".row");
      if (row && !event.target.classList.contains("twist")) this._toggle(Number(row.dataset.index));
    });
    this._inner.addEventListener("keydown", (event) => this._key(event));
    this._scroller.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this._resize(event.deltaY < 0 ? 1 : -1);
    }, { passive: false });
    byId("fold-finished").addEventListener("change", () => { this._opened.clear(); this._layout(); });
    byId("fold-all").addEventListener("click", () => { this._foldBelow(1); this._layout(); });
    byId("unfold-all").addEventListener("click", () => {
      byId("fold-finished").checked = false; this._folded.clear(); this._layout();
    });
    byId("larger").addEventListener("click", () => this._resize(1));
    byId("smaller").addEventListener("click", () => this._resize(-1));
    byId("search").addEventListener("keydown", (event) => { if (event.key === "Enter") this._nextHit(); });
  }

  _resize(step) {
    this._size = Math.max(0, Math.min(SIZES.length - 1, this._size + step));
    this._scroller.style.setProperty("--size", `${SIZES[this._size]}px`);
    this._scroller.style.setProperty("--row", `${this._height}px`);
    this._layout();
  }

  _choose(index) {
    const node = this._nodes[index];
    if (node.kind === "Action") this._select({ kind: "task", name: node.subject });
  }

  _goTo(index) {
    this._current = index;
    const top = this._place.get(index) * this._height;
    if (top < this._top) this._scroller.scrollTop = top;
    else if (top + this._height > this._top + this._seen) this._scroller.scrollTop = top + this._height - this._seen;
    this._top = this._scroller.scrollTop;
    this._draw();
    this._rows.get(index)?.root.focus({ preventScroll: true });
  }

  _key(event) {
    const place = this._place.get(this._current), node = this._nodes[this._current];
    const step = { ArrowDown: 1, ArrowUp: -1, PageDown: 12, PageUp: -12, Home: -1e9, End: 1e9 }[event.key];
    if (step !== undefined) {
      this._goTo(this._shown[Math.max(0, Math.min(this._shown.length - 1, place + step))]);
    } else if (event.key === "ArrowRight") {
      if (this._isFolded(node)) this._toggle(node.index, true);
      else if (node.children.length) this._goTo(node.children[0]);
    } else if (event.key === "ArrowLeft") {
      if (node.children.length && !this._isFolded(node)) this._toggle(node.index, false);
      else if (node.parent >= 0) this._goTo(node.parent);
    } else if (event.key === "Enter" || event.key === " ") {
      if (node.children.length) this._toggle(node.index); else this._choose(node.index);
    } else return;
    event.preventDefault();
    this._rows.get(this._current)?.root.focus({ preventScroll: true });
  }

  // -- search -----------------------------------------------------------------------------

  search(wanted) {
    this._hits = new Set(wanted ? this._nodes.filter((n) => contains(n.label, wanted)).map((n) => n.index) : []);
    if (this._hits.size) this._reveal(Math.min(...this._hits)); else this._draw();
    return `${this._hits.size} nodes`;
  }

  _nextHit() {
    const hits = [...this._hits].sort((a, b) => a - b);
    if (hits.length) this._reveal(hits.find((hit) => hit > this._current) ?? hits[0]);
  }

  _reveal(index) {
    for (let i = this._nodes[index].parent; i >= 0; i = this._nodes[i].parent) { this._folded.delete(i); this._opened.add(i); }
    this._layout();
    const field = document.activeElement;
    this._goTo(index);
    field?.focus();
  }
}
