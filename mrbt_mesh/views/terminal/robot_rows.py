"""Texts about robots: rows with state, task and progress; capabilities; explanations."""

from __future__ import annotations

import math
from typing import Any

from rich.text import Text

from mrbt_mesh.cli.views.marks import MARKS, STATE_MARKS, STATE_WORDS
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.values import texts_by_reason
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.observer.time_at_work import time_text

BAR_COLUMNS = 8
TREES = ("T_i", "T_A", "T_G", "T_Li")


def robot_text(
    robot: str, item: dict[str, Any], name_width: int, now_s: float, is_over: bool = False
) -> Text:
    """Return state, task and progress; `item`: the current one of `TeamView`.

    A living robot is shown by the sign alone.
    """
    sign, style = STATE_MARKS[item["state"]]
    text = Text(no_wrap=True)
    text.append(f"{robot:{name_width}} ", "bold")
    if is_over and item["state"] == "alive":
        return text.append("■ ended", "dim")
    word = STATE_WORDS.get(item["state"], item["state"])
    text.append(f"{sign} " if item["state"] == "alive" else f"{sign} {word} ", style)
    runs = item["phase"] == "running"
    if item["local_task"] is not None:
        text.append(item["local_task"], "" if runs else "dim")
        phase = f"to {item['under_way']}" if item["under_way"] else item["phase"]
        text.append(" " if runs else f" ({phase}) ", "dim")
        text.append_text(_time_at_work(item, now_s))
    for reason, names in texts_by_reason(item["lost"]).items():
        text.append("✘", "red")
        text.append(", ".join(names), "red strike")
        text.append(f": {reason} " if reason else " ", "red")
    for problem in item["problems"]:
        text.append(f"! {problem} ", "red")
    for reason, names in texts_by_reason(item["pending"]).items():
        text.append(f"cannot use {', '.join(names)} now: {reason} ", "yellow")
    if item["local_task"] is not None and item["progress"] is not None:
        text.append(f"{item['progress']}% {bar(item['progress'])} ", "cyan")
    if item["differs_since_s"] is not None:
        text.append(f"other plan since {item['differs_since_s']:.1f} s ", "yellow")
    if item["local_task"] is None:
        text.append(f"free: {item['idle']}" if item["idle"] else "", "dim")
    return text


def _time_at_work(item: dict[str, Any], now_s: float) -> Text:
    """`for 42 s of 10 s `."""
    begun_s, expected_s, limit_s = item["begun_s"], item["expected_s"], item["late_after_s"]
    if begun_s is None:
        return Text()
    for_s = math.floor(max(0.0, now_s - begun_s))
    if expected_s is None and not for_s:
        return Text()
    style = "yellow" if limit_s is not None and for_s > limit_s else "dim"
    return Text(f"for {time_text(for_s, expected_s)} ", style)


def bar(percent: int) -> str:
    """Return a progress bar for 0 to 100."""
    full = BAR_COLUMNS * min(max(percent, 0), 100) // 100
    return "▰" * full + "▱" * (BAR_COLUMNS - full)


def capabilities_text(item: dict[str, Any]) -> Text:
    """Return its type and capabilities with their performance; lost ones are struck out."""
    text = Text(item["type"] or "").append(" can ", "dim")
    lost = item["lost"]
    for number, (name, value) in enumerate(item["capabilities"].items()):
        text.append(", " if number else "", "dim")
        if name in lost or type_name(name) in lost:
            text.append("✘", "red")
            text.append(name, "red strike")
            reason = lost.get(name) or lost.get(type_name(name))
            text.append(f" (lost: {reason})" if reason else " (lost)", "red")
        else:
            text.append(f"{name} ({value:g})")
    return text


def trees_text(item: dict[str, Any]) -> Text:
    """Return the statuses of T_i and its parts, as reported by the robot."""
    text = Text()
    for name, word in zip(TREES, item["statuses"], strict=False):
        sign, style = MARKS[Status[word.upper()]]
        text.append(f"{name} ", "dim")
        text.append(f"{sign} {word}  ", style)
    return text


def why_text(answer: dict[str, Any]) -> Text:
    """Return an explanation of `model/why.py`: the sentence, then a line for each candidate."""
    text = Text(answer["sentence"])
    for group in answer["groups"]:
        if group["local_task"]:
            text.append(f"\n{group['local_task']}", "bold")
        for each in group["candidates"]:
            number = "no bid" if each["performance"] is None else f"{each['performance']:g}"
            sign, style = ("✔", "green") if each["chosen"] else ("·", "dim")
            text.append(f"\n  {sign} ", style)
            text.append(f"{each['robot']:<8}{number:>8}  ")
            text.append(each["reason"], "" if each["chosen"] else "dim")
    return text
