"""What documents name exists: files, headings, targets of make, commands and their options."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest

from mrbt_mesh.cli.main import main
from tests.support.paths import ROOT
from tests.support.structure.commands import unknown_commands, unknown_options, unknown_targets
from tests.support.structure.markdown import anchors, broken_links, missing_paths
from tests.support.structure.source import settle

Tree = Callable[[dict[str, str]], Path]

COMMANDS = {"": {"--help"}, "up": {"--json", "-o"}, "tree": {"--help"}, "tree show": {"--svg"}}


def commands() -> dict[str, set[str]]:
    """Every command of `mrbt` with its options."""
    found: dict[str, set[str]] = {}

    def look(command: Any, name: str) -> None:
        found[name] = {"--help"}
        for option in command.params:
            found[name].update(option.opts, option.secondary_opts)
        if isinstance(command, click.Group):
            context = click.Context(command)
            for each in command.list_commands(context):
                look(command.get_command(context, each), f"{name} {each}".strip())

    look(main, "")
    return found


def test_links_lead_somewhere() -> None:
    settle("links", broken_links(ROOT))


def test_paths_exist() -> None:
    settle("paths", missing_paths(ROOT, "mrbt_mesh"))


def test_the_makefile_has_the_targets() -> None:
    settle("targets", unknown_targets(ROOT))


def test_the_commands_exist_with_their_options() -> None:
    known = commands()
    assert {"up", "tree show", "agent"} < known.keys()
    assert "--continue" in known["up"]
    assert "--takeover" in known["agent"]
    settle("commands", unknown_commands(ROOT, known))
    settle("options", unknown_options(ROOT, known))


@pytest.mark.parametrize(
    ("text", "target", "problem"),
    [
        ("See [b](b.md).", "b.md", "there is no such file"),
        ("![picture](docs/b.png)", "docs/b.png", "there is no such file"),
        ("[a](docs/a.md#two)", "docs/a.md#two", "there is no such heading"),
        ("[here](#two)", "#two", "there is no such heading"),
        ("[py](x.py#L3)", "x.py#L3", "there is no such heading"),
        ("[a][1]\n\n[1]: b.md", "b.md", "there is no such file"),
        ("[`code`](b.md)", "b.md", "there is no such file"),
        ('a [titled](b.md "title") one', "b.md", "there is no such file"),
    ],
)
def test_a_broken_link(tree: Tree, text: str, target: str, problem: str) -> None:
    root = tree({"README.md": f"# One\n\n{text}\n", "docs/a.md": "# One\n", "x.py": ""})
    assert [(each.key, each.text) for each in broken_links(root)] == [
        (f"README.md: {target}", problem)
    ]


@pytest.mark.parametrize(
    "text",
    [
        "[a](docs/a.md), [one](docs/a.md#one), [up](./), [one](#one)",
        "[elsewhere](https://example.org/x), [mail](mailto:a@example.org)",
        "`[no](link.md)` is code",
        "```\n[no](link.md)\n```",
        "\n    [no](link.md)\n",
        "[space](docs/with%20space.md)",
    ],
)
def test_a_link_that_holds(tree: Tree, text: str) -> None:
    files = {"README.md": f"# One\n\n{text}\n", "docs/a.md": "# One\n", "docs/with space.md": ""}
    assert broken_links(tree(files)) == []


def test_hidden_folders_are_not_looked_at(tree: Tree) -> None:
    assert broken_links(tree({".venv/lib/README.md": "[a](a.md)"})) == []


def test_headings_become_anchors_as_on_github() -> None:
    text = "# What's *new*, really?\n## `mrbt up` & co\n## A [link](b.md)\n## Two\n### Two\n"
    text += "```\n# no heading\n```\n"
    assert anchors(text) == {
        *("whats-new-really", "mrbt-up--co", "a-link", "two", "two-1"),
    }


def test_a_path_in_code_that_does_not_exist(tree: Tree) -> None:
    text = "`tests/a.py` `tests/b.py` `tests/*.py` `tests/*.md` `core/` `core/x/` `no/path`\n"
    text += "`tests/b.py --option` `a b/c`\n"
    root = tree({"README.md": text, "tests/a.py": "", "pkg/core/c.py": ""})
    assert [each.key for each in missing_paths(root, "pkg")] == [
        *("README.md: tests/b.py", "README.md: tests/*.md", "README.md: core/x/"),
    ]


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("Then `make tets`.", "make tets"),
        ("    make test && make tets   # all", "make tets"),
        ("```sh\nmake N=3 test tets\n```", "make tets"),
    ],
)
def test_an_unknown_target(tree: Tree, text: str, key: str) -> None:
    root = tree({"a.md": f"# A\n\n{text}\n", "Makefile": "N := 1\nall: test\ntest: lint\n\ttrue\n"})
    assert [each.key for each in unknown_targets(root)] == [f"a.md: {key}"]


def test_make_as_a_word_is_no_target(tree: Tree) -> None:
    text = "Robots make plans. `make test MINUTES=3` and `make PYTHON=python3 test`\n"
    assert unknown_targets(tree({"a.md": text, "Makefile": "test:\n"})) == []


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("Start it: `mrbt start`.", "mrbt start"),
        ("    mrbt up m.yaml --jsno", "mrbt up --jsno"),
        ("    mrbt up m.yaml \\\n        --jsno", "mrbt up --jsno"),
        ("    mrbt tree draw x.xml", "mrbt tree draw"),
        ("    mrbt tree show x.xml --json", "mrbt tree show --json"),
        ("    mrbt up; mrbt stop a", "mrbt stop"),
        ("    mrbt up -x", "mrbt up -x"),
        ("    mrbt up2 -x", "mrbt up2"),
        ("`mrbt --hlep`", "mrbt  --hlep"),
    ],
)
def test_an_unknown_command(tree: Tree, text: str, key: str) -> None:
    root = tree({"a.md": f"# A\n\n{text}\n"})
    assert [each.key for each in unknown_commands(root, COMMANDS)] == [f"a.md: {key}"]


@pytest.mark.parametrize(
    "text",
    [
        "`mrbt`, `mrbt up`, `mrbt up MISSION --json`, `mrbt tree`, `mrbt tree show x --svg`",
        "    mrbt up m.yaml --json=1 -o out.yaml    # mrbt stop --now",
        "    (mrbt up 'a; mrbt stop')",
        "Write `mrbt-mesh`, or mrbt stop.",
    ],
)
def test_known_commands(tree: Tree, text: str) -> None:
    assert unknown_commands(tree({"a.md": f"# A\n\n{text}\n"}), COMMANDS) == []


def test_an_option_alone_that_no_command_has(tree: Tree) -> None:
    root = tree({"a.md": "With `--json`, `-o FILE`, `--svg=x` or `--pdf`; not `- x` or ``--``."})
    assert [each.key for each in unknown_options(root, COMMANDS)] == ["a.md: --pdf"]
