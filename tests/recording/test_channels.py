"""The channels: their examples fit, and docs/how-to/recordings.md says what the schemas say."""

from __future__ import annotations

import json
import re

import fastjsonschema
import pytest

from mrbt_mesh.recording.channels import CHANNELS, Channel
from tests.support.paths import ROOT

DOCUMENT = (ROOT / "docs" / "data" / "recording-channels.md").read_text(encoding="utf-8")
LAYOUT = json.loads((ROOT / "docs" / "foxglove-layout.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("channel", CHANNELS.values(), ids=CHANNELS)
def test_an_example_fits_its_schema_and_a_field_less_does_not(channel: Channel) -> None:
    check = fastjsonschema.compile(dict(channel.schema))
    example = {**channel.example, "check": "0011223344556677"}
    check(example)
    for name in channel.schema["required"]:
        with pytest.raises(fastjsonschema.JsonSchemaValueException):
            check({key: value for key, value in example.items() if key != name})
    if channel.name.startswith("mrbt."):
        with pytest.raises(fastjsonschema.JsonSchemaValueException):
            check({**example, "more": 1})


def test_the_document_lists_every_channel_with_its_schema_and_purpose() -> None:
    rows = re.findall(r"^\| `(/\w+)` \| `([\w.]+)` \| (.*) \|$", DOCUMENT, re.MULTILINE)
    assert rows == [(c.topic, c.name, c.purpose) for c in CHANNELS.values()]


@pytest.mark.parametrize("channel", CHANNELS.values(), ids=CHANNELS)
def test_the_document_has_all_fields_and_the_example_of_a_channel(channel: Channel) -> None:
    section = DOCUMENT.partition(f"\n## `{channel.topic}`\n")[2].partition("\n## ")[0]
    fields = re.findall(r"^\| `(\w+)` \| ([^|]*) \| [^|]* \|$", section, re.MULTILINE)
    wanted = [name for name in channel.schema["properties"] if name != "check"]
    assert [name for name, _ in fields] == wanted
    required = set(channel.schema["required"])
    assert {name for name, when in fields if when == "always"} == required - {"check"}
    (example,) = re.findall(r"```json\n(.*?)```", section, re.DOTALL)
    assert json.loads(example) == channel.example


def test_the_layout_for_foxglove_names_only_channels_that_there_are() -> None:
    topics = set(re.findall(r'"(/\w+)[".]', json.dumps(LAYOUT)))
    assert topics
    assert topics <= set(CHANNELS)
