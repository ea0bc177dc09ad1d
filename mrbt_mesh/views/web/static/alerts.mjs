// Alerts, off until somebody turns them on: by the title, a sound and a notification.

import { byId } from "./text.mjs";

const SOUND_HZ = 660, SOUND_S = 0.25;

export class Alerts {
  constructor(name) {
    this._name = name;
    this._known = new Set();
    // Before the title, until somebody looks.
    this.prefix = "";
    this._button = byId("alerts");
    this._button.addEventListener("click", () => this._turn());
    addEventListener("focus", () => { this.prefix = ""; });
  }

  // Alerts of what is wrong and was not wrong before.
  update(statements) {
    const texts = statements.filter(({ level }) => level === "bad" || level === "warn").map(({ text }) => text);
    const fresh = texts.filter((text) => !this._known.has(text));
    this._known = new Set(texts);
    if (this._sound && fresh.length) this._alert(fresh.join("; "));
  }

  // A page may make sounds and ask for notifications once somebody has pressed a button.
  _turn() {
    if (this._sound) { this._sound.close(); this._sound = null; }
    else {
      this._sound = new AudioContext();
      globalThis.Notification?.requestPermission();
    }
    this._button.setAttribute("aria-pressed", String(!!this._sound));
  }

  _alert(text) {
    this.prefix = `⚠ ${text} · `;
    const tone = this._sound.createOscillator();
    tone.frequency.value = SOUND_HZ;
    tone.connect(this._sound.destination);
    tone.start();
    tone.stop(this._sound.currentTime + SOUND_S);
    if (globalThis.Notification?.permission === "granted") new Notification(this._name, { body: text, tag: this._name });
  }
}
