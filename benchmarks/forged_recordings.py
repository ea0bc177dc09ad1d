"""Forgeries of a run directory, file by file and byte by byte: how many `verify` does not name.

    python -m benchmarks.forged_recordings [--run RUN_DIR] [--seed 0]

The kinds are thought of from the documents alone (docs/how-to/recordings.md, the reference of the
channels, and that of MCAP): whatever a reader could show. None needs a key. Without --run, a keyed
team of real processes is run first, with a kill and commands. A file that nothing signs counts as
named where `verify` lists it as no evidence. Exit status 1 for an unnamed one.
"""

from __future__ import annotations

import base64
import json
import os
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.report import ROOT, grid, run_program, say
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording import mcap_file
from mrbt_mesh.recording.channels import CHANNELS
from mrbt_mesh.recording.messages import first_check, next_check
from mrbt_mesh.views.recordings.files import verified

MRBT = (sys.executable, "-m", "mrbt_mesh")
MISSION = ROOT / "examples" / "deliveries" / "mission.yaml"
_TOPICS = tuple(topic for topic in CHANNELS if topic != "/beats")
_FIELDS = mcap_file.MESSAGE_FIELDS


@dataclass
class Message:
    """One message of a file; `body` is its JSON without the check."""

    topic: str
    number: int
    at_ns: int
    body: bytes


@dataclass
class Parsed:
    """A recording's file: its metadata, its messages, and whether it was closed."""

    path: Path
    values: dict[str, str]
    messages: list[Message]
    is_closed: bool

    def save(self) -> None:
        """Write it again, with all checks made anew: that takes no key."""
        check, content = first_check(self.values), mcap_file.begin(_TOPICS, self.values)
        numbers = mcap_file.channel_numbers(_TOPICS)
        for each in self.messages:
            check = next_check(check, each.number, each.topic, each.at_ns, each.body)
            text = b'%s,"check":"%s"}' % (each.body[:-1], check.hex().encode())
            content += mcap_file.message(numbers[each.topic], each.number, each.at_ns, text)
        if self.is_closed:
            content += mcap_file.end(_TOPICS, len(content))
        self.path.write_bytes(content)

    def renumber(self) -> None:
        """The numbers without a hole."""
        for number, each in enumerate(self.messages, start=1):
            each.number = number


def parse(path: Path) -> Parsed:
    """Read a file that is as mrbt wrote it."""
    content, at = path.read_bytes(), len(mcap_file.MAGIC)
    topics = {n: topic for topic, n in mcap_file.channel_numbers(_TOPICS).items()}
    values: dict[str, str] = {}
    messages, is_closed = [], False
    while at + mcap_file.FRAME.size <= len(content) and not is_closed:
        opcode, length = mcap_file.FRAME.unpack_from(content, at)
        at += mcap_file.FRAME.size
        record, at = content[at : at + length], at + length
        if opcode == mcap_file.METADATA_RECORD:
            _, values = mcap_file.read_metadata(record)
        elif opcode == mcap_file.MESSAGE:
            channel, number, at_ns, _ = _FIELDS.unpack_from(record)
            body = record[_FIELDS.size :].rpartition(b',"check":')[0] + b"}"
            messages.append(Message(topics[channel], number, at_ns, body))
        is_closed = opcode == mcap_file.DATA_END
    return Parsed(path, values, messages, is_closed)


@dataclass(frozen=True)
class Scene:
    """A copy of the run directory that is forged, and the draw."""

    folder: Path
    draw: random.Random

    @property
    def robots(self) -> list[Path]:
        """The recordings of robots."""
        return sorted((self.folder / "recordings").glob("*.mcap"))

    def robot(self) -> Path:
        """One of them."""
        return self.draw.choice(self.robots)

    def killed(self) -> Path:
        """That of a robot that was killed: it has no end."""
        return self.draw.choice([path for path in self.robots if not parse(path).is_closed])

    def closed(self) -> Path:
        """That of a robot that ended by itself."""
        return self.draw.choice([path for path in self.robots if parse(path).is_closed])


Forgery = Callable[[Scene], None]
FORGERIES: dict[str, Forgery] = {}


def forgery(name: str) -> Callable[[Forgery], Forgery]:
    """Add one to the list."""

    def add(made: Forgery) -> Forgery:
        FORGERIES[name] = made
        return made

    return add


# -- records of MCAP ------------------------------------------------------------------------------


def _text(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def _record(opcode: int, content: bytes) -> bytes:
    return mcap_file.FRAME.pack(opcode, len(content)) + content


_POSITION = mcap_file.message(
    mcap_file.channel_numbers(_TOPICS)["/positions"],
    1,
    10**18,
    b'{"timestamp":{"sec":1,"nsec":0},"parent_frame_id":"world","child_frame_id":"robot/A1"}',
)
_SUMS = struct.pack("<QQQII", 0, 1 << 62, len(_POSITION), 0, 0)
RECORDS = {
    "a chunk with a position": _record(6, _SUMS + struct.pack("<Q", len(_POSITION)) + _POSITION),
    "an attachment": _record(
        9, struct.pack("<QQ", 1, 1) + _text(b"map.png") + _text(b"image/png") + bytes(12)
    ),
    "more metadata": _record(12, _text(b"notes") + _text(_text(b"by") + _text(b"root"))),
    "metadata of mrbt again": _record(12, _text(b"mrbt") + _text(_text(b"robot") + _text(b"D9"))),
    "a second header": _record(1, _text(b"ros2") + _text(b"rosbag2")),
    "a schema": _record(3, struct.pack("<H", 90) + _text(b"x") + _text(b"jsonschema") + _text(b"")),
    "a channel": _record(
        4, struct.pack("<HH", 90, 1) + _text(b"/speeds") + _text(b"json") + _text(b"")
    ),
    "statistics": _record(11, bytes(46)),
    "an index": _record(8, bytes(60)),
    "a record of a private kind": _record(0x90, b"whatever"),
    "a message on an unknown channel": mcap_file.message(91, 1, 10**18, b'{"x":1}'),
    "a message without a check": _POSITION,
}


def _messages_begin(content: bytes) -> int:
    at = len(mcap_file.MAGIC)
    while content[at] != mcap_file.MESSAGE:
        at += mcap_file.FRAME.size + int.from_bytes(content[at + 1 : at + 9], "little")
    return at


def _put(what: str, where: str) -> Forgery:
    def forge(scene: Scene) -> None:
        path = scene.closed()
        content = path.read_bytes()
        begin = _messages_begin(content)
        end = content.index(_record(mcap_file.DATA_END, bytes(4)))
        at = {"begin": begin, "end": end, "summary": end + 13, "header": len(mcap_file.MAGIC)}
        place = at.get(where, len(content))
        path.write_bytes(content[:place] + RECORDS[what] + content[place:])

    return forge


for _what in RECORDS:
    for _where in ("begin", "end"):
        FORGERIES[f"{_what}, put at the {_where} of the messages"] = _put(_what, _where)
for _what, _where in (
    ("more metadata", "header"),
    ("a chunk with a position", "summary"),
    ("statistics", "summary"),
    ("an attachment", "behind the file"),
    ("a chunk with a position", "behind the file"),
):
    FORGERIES[f"{_what}, put into the {_where}"] = _put(_what, _where)


def _bytes(old: bytes, new: bytes, *, is_last: bool = False) -> Forgery:
    def forge(scene: Scene) -> None:
        path = scene.closed()
        content = path.read_bytes()
        at = content.rindex(old) if is_last else content.index(old)
        path.write_bytes(content[:at] + new + content[at + len(old) :])

    return forge


FORGERIES |= {
    "the library in the header": _bytes(b"mrbt-mesh", b"mrbt-mess"),
    "the title of a schema": _bytes(b'"title": "mrbt.Fault"', b'"title": "mrbt.Faulp"'),
    "the topic of a channel": _bytes(b"/positions", b"/velocities"[:10]),
    "the encoding of a channel": _bytes(b"json\x00\x00\x00\x00", b"cbor\x00\x00\x00\x00"),
    "a topic in the summary": _bytes(b"/deaths", b"/births", is_last=True),
    "the magic at the end": _bytes(mcap_file.MAGIC, b"\x89MCAP1\r\n", is_last=True),
}


@forgery("another recording appended to the file")
def _appended(scene: Scene) -> None:
    path = scene.closed()
    path.write_bytes(path.read_bytes() + scene.robots[0].read_bytes())


@forgery("the end of the file cut off in the middle of its summary")
def _cut_end(scene: Scene) -> None:
    path = scene.closed()
    messages = parse(path).messages
    del messages[-3:]
    found = parse(path)
    found.messages, found.is_closed = messages, False
    found.save()


@forgery("zeros over a message in the middle")
def _zeros(scene: Scene) -> None:
    path = scene.robot()
    content = bytearray(path.read_bytes())
    at = content.index(b'"check"', len(content) // 2)
    content[at - 200 : at] = bytes(200)
    path.write_bytes(bytes(content))


# -- messages, with all checks made anew ----------------------------------------------------------


def _edit(change: Callable[[Parsed, random.Random], None], which: str = "robot") -> Forgery:
    def forge(scene: Scene) -> None:
        found = parse(getattr(scene, which)() if which else scene.folder / "run.mcap")
        change(found, scene.draw)
        found.save()

    return forge


def _some(found: Parsed, draw: random.Random, topic: str) -> Message:
    return draw.choice([each for each in found.messages[:-1] if each.topic == topic])


def _value(topic: str, old: bytes, new: bytes) -> Callable[[Parsed, random.Random], None]:
    def change(found: Parsed, draw: random.Random) -> None:
        those = [each for each in found.messages if each.topic == topic and old in each.body]
        each = draw.choice(those)
        each.body = each.body.replace(old, new, 1)

    return change


def _metadata(name: str, value: str) -> Callable[[Parsed, random.Random], None]:
    def change(found: Parsed, _: random.Random) -> None:
        assert found.values[name] != value
        found.values[name] = value

    return change


def _time_of_end(found: Parsed, _: random.Random) -> None:
    found.messages[-1].at_ns += 3_000_000_000


def _later(found: Parsed, _: random.Random) -> None:
    for each in found.messages:
        each.at_ns += 3_600_000_000_000


def _double_key(found: Parsed, draw: random.Random) -> None:
    each = found.messages[-1]
    each.body = b'{"by":"nobody",' + each.body[1:]


def _white_space(found: Parsed, draw: random.Random) -> None:
    found.messages[-1].body = found.messages[-1].body.replace(b":", b": ", 1)


def _base64(found: Parsed, draw: random.Random) -> None:
    each = found.messages[-1]
    data = json.loads(each.body)
    text = data["signature"]
    letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
    at = len(text.rstrip("=")) - 1
    other = letters[letters.index(text[at]) ^ 1]
    data["signature"] = text[:at] + other + text[at + 1 :]
    assert base64.b64decode(data["signature"]) == base64.b64decode(text)
    each.body = json.dumps(data, separators=(",", ":")).encode()


def _appended_messages(topic: str, seconds: int) -> Callable[[Parsed, random.Random], None]:
    def change(found: Parsed, draw: random.Random) -> None:
        each, last = _some(found, draw, topic), found.messages[-1]
        for second in range(1, seconds + 1):
            at_ns = last.at_ns + second * 1_000_000_000
            number = found.messages[-1].number + 1
            found.messages.append(Message(topic, number, at_ns, each.body))

    return change


def _reordered(found: Parsed, draw: random.Random) -> None:
    at = draw.randrange(len(found.messages) // 2)
    first, second = found.messages[at : at + 2]
    found.messages[at : at + 2] = [second, first]
    found.renumber()


def _first_gone(found: Parsed, draw: random.Random) -> None:
    del found.messages[0]
    found.renumber()


def _other_way_round(found: Parsed, draw: random.Random) -> None:
    found.messages.reverse()
    found.renumber()


FORGERIES |= {
    "metadata: another robot": _edit(_metadata("robot", "Z9")),
    "metadata: another version of mrbt": _edit(_metadata("version", "9.9")),
    "metadata: another speed": _edit(_metadata("speed", "7.0")),
    "metadata: no keys": _edit(_metadata("has_keys", "false")),
    "metadata: not observed": _edit(_metadata("is_observed", "false")),
    "metadata: another clock": _edit(_metadata("epoch_ns", "1700000000000000000")),
    "metadata: another solver": _edit(_metadata("solver", "cp_sat")),
    "metadata: a later part": _edit(_metadata("part", "2")),
    "metadata: earlier parts": _edit(_metadata("kept_from", "0")),
    "the clock of the observer": _edit(_metadata("epoch_ns", "1700000000000000000"), ""),
    "the time of the last signature": _edit(_time_of_end, "closed"),
    "all times an hour later": _edit(_later),
    "a key twice in a signature": _edit(_double_key, "closed"),
    "white space in a signature": _edit(_white_space, "closed"),
    "bits of a signature that mean nothing": _edit(_base64, "closed"),
    "a minute of statuses behind a killed robot's end": _edit(
        _appended_messages("/statuses", 60), "killed"
    ),
    "a minute of robots behind a killed robot's end": _edit(
        _appended_messages("/robots", 60), "killed"
    ),
    "a minute of statuses behind an end": _edit(_appended_messages("/statuses", 60), "closed"),
    "two messages exchanged": _edit(_reordered),
    "the first message removed": _edit(_first_gone),
    "all messages the other way round": _edit(_other_way_round),
    "the reason of a stop": _edit(_value("/life", b'"reason":"', b'"reason":"not '), "closed"),
    "the progress of another robot in run.mcap": _edit(
        _value("/robots", b'"percent":', b'"percent":1'), ""
    ),
    "how long ago a robot died in run.mcap": _edit(
        _value("/deaths", b'"ago_us":', b'"ago_us":9'), ""
    ),
    "whether a death is exact in run.mcap": _edit(
        _value("/deaths", b'"exact":true', b'"exact":false'), ""
    ),
    "a head that others heard": _edit(_value("/heads", b'"number":', b'"number":1')),
    "the tree of a robot": _edit(_value("/robot_trees", b'"nodes":"', b'"nodes":"S')),
    "the map": _edit(_value("/map", b'"place/', b'"place/x')),
    "the reason of an action's failure": _edit(
        _value("/actions", b'"local_task":"', b'"local_task":"x')
    ),
    "the partners of a coalition": _edit(_value("/actions", b'"partners":[', b'"partners":["Z9",')),
}


# -- files ----------------------------------------------------------------------------------------


@forgery("two robots' files exchanged")
def _exchanged(scene: Scene) -> None:
    first, second = scene.draw.sample(scene.robots, 2)
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


@forgery("a robot's file under another robot's name")
def _renamed(scene: Scene) -> None:
    path = scene.robot()
    path.rename(path.with_name("Z9.mcap"))


@forgery("a robot's file twice")
def _copied(scene: Scene) -> None:
    path = scene.robot()
    shutil.copy(path, path.with_name(f"{path.stem.partition('.')[0]}.7.mcap"))


@forgery("a robot's file as a later part")
def _as_part(scene: Scene) -> None:
    path = scene.robot()
    shutil.copy(path, path.with_name(f"{path.stem}.part2.mcap"))


@forgery("the observer's file twice")
def _observer_twice(scene: Scene) -> None:
    shutil.copy(scene.folder / "run.mcap", scene.folder / "run.2.mcap")


@forgery("a file emptied")
def _emptied(scene: Scene) -> None:
    scene.closed().write_bytes(b"")


@forgery("a file of zeros in place of a robot's")
def _zeroed(scene: Scene) -> None:
    path = scene.closed()
    path.write_bytes(bytes(path.stat().st_size))


@forgery("a file in the folder of recordings")
def _more_in_folder(scene: Scene) -> None:
    (scene.folder / "recordings" / "notes.txt").write_text("A1 was out of order\n")


@forgery("a report in the run directory")
def _report(scene: Scene) -> None:
    (scene.folder / "report.html").write_text("<h1>all proved</h1>")


@forgery("a revision that there was not")
def _revision(scene: Scene) -> None:
    shutil.copyfile(scene.folder / "run.json", scene.folder / "revision.json")


def _rewritten(name: str, change: Callable[[str], str]) -> Forgery:
    def forge(scene: Scene) -> None:
        path = scene.folder / name
        before = path.read_text()
        after = change(before)
        assert after != before, name
        path.write_text(after)

    return forge


def _gone(*names: str) -> Forgery:
    def forge(scene: Scene) -> None:
        for name in names:
            (scene.folder / name).unlink()

    return forge


def _lines(change: Callable[[list[str]], list[str]]) -> Callable[[str], str]:
    return lambda text: "".join(f"{line}\n" for line in change(text.splitlines()))


_NEW = '{"unix_s": 1.0, "by": "mrbt kill", "command": "B2 (pid 7) killed", "after": ""}'
FORGERIES |= {
    "a command added": _rewritten("commands.jsonl", lambda text: f"{text}{_NEW}\n"),
    "a command put first": _rewritten("commands.jsonl", lambda text: f"{_NEW}\n{text}"),
    "the first command removed": _rewritten("commands.jsonl", _lines(lambda each: each[1:])),
    "the last command removed": _rewritten("commands.jsonl", _lines(lambda each: each[:-1])),
    "a command's robot changed": _rewritten(
        "commands.jsonl", lambda t: t.replace("killed", "left")
    ),
    "a command's time changed": _rewritten(
        "commands.jsonl", lambda text: text.replace('"unix_s": 1', '"unix_s": 2', 1)
    ),
    "a command's signer changed": _rewritten(
        "commands.jsonl", lambda text: text.replace('"signer": "operator"', '"signer": "boss"', 1)
    ),
    "a command twice": _rewritten("commands.jsonl", _lines(lambda each: [*each, each[-1]])),
    "commands reordered": _rewritten("commands.jsonl", _lines(lambda each: each[::-1])),
    "all commands removed": _gone("commands.jsonl"),
    "the result in summary.json": _rewritten(
        "summary.json", lambda text: text.replace("success", "failure", 1)
    ),
    "the duration in summary.json": _rewritten(
        "summary.json", lambda text: text.replace('"duration_s": ', '"duration_s": 1', 1)
    ),
    "summary.json removed": _gone("summary.json"),
    "the summary's signature removed": _gone("summary.signature"),
    "the summary's signature of other commands": _rewritten(
        "summary.signature", lambda text: text.replace('"commands": "', '"commands": "0', 1)
    ),
    "mission.json: another name": _rewritten(
        "mission.json", lambda text: text.replace("deliveries", "robberies", 1)
    ),
    "deaths.json": _rewritten("deaths.json", lambda text: text.replace("}", "} ", 1)),
    "events.jsonl": _rewritten("events.jsonl", _lines(lambda each: each[1:])),
    "run.json": _rewritten("run.json", lambda text: text.replace("deliveries", "other", 1)),
    "a robot's log": _rewritten("D1.log", lambda text: text[: len(text) // 2]),
}


# -- the run, and the verdicts --------------------------------------------------------------------


def record_run(folder: Path) -> Path:
    """A keyed team of real processes, one of which is killed; its run directory."""
    path, environment = folder / "run", os.environ | {"MRBT_STATE_DIR": str(folder / "state")}
    words = ("up", str(MISSION), "--run-dir", str(path), "--headless", "--robots", "C1,C2,D1,D2")
    with subprocess.Popen([*MRBT, *words], env=environment, stdout=subprocess.DEVNULL) as team:
        while not (path / "D2.process").exists():
            time.sleep(0.2)
        for command in (
            ("submit", "inspect", "shelf_2"),
            ("submit", "deliver", "shelf_1", "dock_1", "1"),
            ("pause",),
            ("resume",),
            ("kill", "C1"),
            ("down",),
        ):
            told = [*MRBT, *command, "--run-dir", str(path)]
            subprocess.run(told, env=environment, stdout=subprocess.DEVNULL, check=True)
        team.wait()
    return path


def named_by(folder: Path) -> set[str]:
    """All that verify says of a run directory that is not praise."""
    try:
        found = verified((folder,))
    except InputError as error:
        return {str(error)}
    said = {str(each) for each in (*found.findings, *found.gaps)} | set(found.notes)
    return said | {f"no evidence: {name}" for name in found.no_evidence}


def measure(run: str = "", seed: int = 0) -> dict[str, Any]:
    """Forge a run in each way; `run` is its directory."""
    with tempfile.TemporaryDirectory(prefix="mrbt-forged-") as name:
        folder = Path(name)
        true = Path(run) if run else record_run(folder)
        honest = named_by(true)
        rows = list(_forged(true, folder, seed, honest))
    unnamed = [kind for kind, said in rows if said == ""]
    left_out = [kind for kind, said in rows if said is None]
    table = grid(("forgery", "what verify says first"), [row for row in rows if row[1] is not None])
    text = f"{len(rows) - len(left_out)} forgeries: {len(unnamed)} unnamed.\n\n{table}"
    return {
        "tables": {"forged": text},
        "honest": sorted(honest),
        "forgeries": len(rows) - len(left_out),
        "unnamed": unnamed,
        "left_out": left_out,
    }


def _forged(
    true: Path, folder: Path, seed: int, honest: set[str]
) -> Iterator[tuple[str, str | None]]:
    """(Kind, what is said of it and not of the true run); None: the run has nothing to forge so."""
    for kind, forge in FORGERIES.items():
        copy = folder / "forged"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(true, copy, ignore=shutil.ignore_patterns("*.journal*", "*.sock"))
        listed = {f"no evidence: {name}" for name in _files(copy)}
        try:
            forge(Scene(copy, random.Random(f"{seed}/{kind}")))
        except (IndexError, ValueError, FileNotFoundError, AssertionError):
            say(f"{kind}: nothing to forge")
            yield kind, None
            continue
        changed = {f"no evidence: {name}" for name in _changed(true, copy)}
        said = sorted(named_by(copy) - honest) or sorted(changed & listed & honest)
        if not said:
            say(f"unnamed: {kind}")
        yield kind, said[0] if said else ""


def _files(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def _changed(true: Path, copy: Path) -> list[str]:
    """The files at the top that differ from those of the true run."""
    return [
        path.name
        for path in copy.iterdir()
        if path.is_file()
        and (true / path.name).is_file()
        and path.read_bytes() != (true / path.name).read_bytes()
    ]


if __name__ == "__main__":
    found = run_program(__doc__, measure)
    raise SystemExit(1 if found["unnamed"] else 0)
