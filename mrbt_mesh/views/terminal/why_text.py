"""An explanation of `viewmodel/why.py` as text: the sentence, and who else could."""

from __future__ import annotations

from typing import Any

from rich.text import Text


def why_text(answer: dict[str, Any]) -> Text:
    """The sentence, then a line for each candidate of each local task."""
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
