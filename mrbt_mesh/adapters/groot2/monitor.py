"""Groot2's protocol, version 2: the tree shown to a monitor, and the replies to its requests.

A request is a ZeroMQ message of one or two parts: a header of 6 bytes and, for some requests, data.
The reply repeats the header, followed by the 16 bytes of the tree's id, and then has its data. An
error is the text `error` and a second part with the reason. Numbers are little-endian.
"""

from __future__ import annotations

import enum
import hashlib
import struct
import time
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import msgpack

from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.analysis.team_tree_writer import team_tree_document
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN
from mrbt_mesh.btcpp.files.document import MODELS, TREE, Document, type_id
from mrbt_mesh.btcpp.files.elements import Element, write_content
from mrbt_mesh.btcpp.files.export import model_element, with_ids
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.files.loadable import compact
from mrbt_mesh.core.bt.tree import Kind, Status, Tree
from mrbt_mesh.errors import InputError
from mrbt_mesh.observer.observer import Observer

PROTOCOL = 2
ERROR = b"error"
IDLE_AFTER = 10
MICROSECOND_BITS = 48
TREE_ID_BYTES = 16
# Uids are 16 bits wide on the wire.
MAX_UID = (1 << 16) - 1
# BehaviorTree.CPP keeps this many transitions for a monitor that does not fetch them.
MAX_TRANSITIONS = 1_000
NO_HOOKS = "not supported: robots never wait for permission, so there are no breakpoints"
TWO_PARTS = "must be 2 parts message"
_HEADER = struct.Struct("<BBI")
_STATUS = struct.Struct("<HB")


class RequestKind(enum.IntEnum):
    """The requests of a monitor."""

    FULL_TREE = ord("T")
    STATUS = ord("S")
    BLACKBOARD = ord("B")
    HOOK_INSERT = ord("I")
    HOOK_REMOVE = ord("R")
    BREAKPOINT_UNLOCK = ord("U")
    HOOKS_DUMP = ord("D")
    REMOVE_ALL_HOOKS = ord("A")
    DISABLE_ALL_HOOKS = ord("X")
    TOGGLE_RECORDING = ord("r")
    GET_TRANSITIONS = ord("t")


@dataclass(frozen=True, slots=True)
class MonitorRequest:
    """A request's header; the reply repeats its number."""

    kind: int
    number: int

    def reply_header(self, tree_id: bytes) -> bytes:
        """Return the header of the reply; `tree_id`: 16 bytes that change with the tree."""
        return _HEADER.pack(PROTOCOL, self.kind, self.number) + tree_id


def parse_request(header: bytes) -> MonitorRequest | None:
    """Parse a request's header; None if it is not a request of this protocol."""
    if len(header) != _HEADER.size:
        return None
    protocol, kind, number = _HEADER.unpack(header)
    return MonitorRequest(kind, number) if protocol == PROTOCOL else None


def status_buffer(statuses: Iterable[int]) -> bytes:
    """Encode the statuses of the nodes with uids 1, 2, ...; for idle nodes see `shown`."""
    return b"".join(_STATUS.pack(uid, status) for uid, status in enumerate(statuses, 1))


def shown(before: int, status: int) -> int:
    """Return a node's status for monitors: a node that became idle also keeps its last status."""
    if status != Status.IDLE or before == Status.IDLE:
        return status
    return before if before >= IDLE_AFTER else IDLE_AFTER + before


def transition(at_us: int, uid: int, status: int) -> bytes:
    """Encode one change of a status for recordings, in 9 bytes.

    `at_us`: time since the recording began; it is sent modulo 2**48.
    """
    moment = at_us % (1 << MICROSECOND_BITS)
    return moment.to_bytes(MICROSECOND_BITS // 8, "little") + _STATUS.pack(uid, status)


class FullTree:
    """A tree as XML with a `_uid` at every node, and the conditions read in each subtree.

    The node with index n has the uid n + 1: both number the nodes depth first.
    """

    def __init__(self, tree: Tree, title: str) -> None:
        """Raises InputError if the tree has more nodes than there are uids."""
        if len(tree.nodes) > MAX_UID:
            raise InputError(f"{title}: {len(tree.nodes)} nodes, Groot2's protocol has {MAX_UID}")
        library = Library()
        library.add(team_tree_document(tree.spec(), title))
        document = with_ids(library)
        self.blackboards = _conditions(tree, document)
        self.xml = _xml(document)


def _xml(document: Document) -> str:
    """Return the compact form with models of all nodes used, as BehaviorTree.CPP writes it."""
    used = {type_id(element) for tree in document.trees for element in tree.walk()}
    root = compact(document).root
    models = next((each for each in root.children if each.tag == MODELS), None)
    if models is None:
        models = Element(MODELS)
        root.content.append(models)
    models.content.extend(model_element(BUILTIN[name]) for name in sorted(used & BUILTIN.keys()))
    return write_content(root) + "\n"


def _conditions(tree: Tree, document: Document) -> dict[str, tuple[str, ...]]:
    """Return the conditions read in or below each tree, by the name of its blackboard.

    The first tree's blackboard is named by the tree's ID, the other ones by their path.
    """
    found: dict[str, tuple[str, ...]] = {}
    for number, element in enumerate(each for each in document.root.children if each.tag == TREE):
        uid = next(int(inner.get("_uid")) for inner in element.walk() if inner is not element)
        name = element.get("ID") if number == 0 else element.get("_fullpath")
        found[name] = _conditions_below(tree, uid - 1)
    return found


def _conditions_below(tree: Tree, index: int) -> tuple[str, ...]:
    waiting, found = [index], []
    while waiting:
        node = tree.nodes[waiting.pop()]
        waiting.extend(reversed(node.children))
        if node.kind is Kind.CONDITION:
            found.append(node.subject)
    return tuple(dict.fromkeys(found))


_HOOKS = (RequestKind.HOOK_INSERT, RequestKind.HOOK_REMOVE, RequestKind.BREAKPOINT_UNLOCK)
# A monitor that disconnects removes all hooks; there are none.
_GONE = (RequestKind.REMOVE_ALL_HOOKS, RequestKind.DISABLE_ALL_HOOKS)
_MORE = frozenset({RequestKind.BLACKBOARD, RequestKind.TOGGLE_RECORDING, *_HOOKS})


class MonitoredTree:
    """Answers the requests of monitors; call `update` when the observer has changed."""

    def __init__(self, observed: ObservedTree, observer: Observer) -> None:
        """Raises InputError if the tree has more nodes than the protocol can number."""
        self._observed = observed
        self._observer = observer
        self._full = FullTree(observed.tree, observed.title)
        text = f"{observed.title}\0{observer.mission.digest}\0{observer.facts.run}"
        leaves = (node for node in observer.mission.tree.nodes if node.kind is Kind.CONDITION)
        self._conditions = {node.subject for node in leaves}
        self._tree_id = hashlib.blake2b(text.encode(), digest_size=TREE_ID_BYTES).digest()
        self._statuses = bytes(len(observed.tree.nodes))
        self._shown = list(self._statuses)
        self._buffer = status_buffer(self._shown)
        self._transitions: deque[bytes] = deque(maxlen=MAX_TRANSITIONS)
        self._recording_since_us: int | None = None

    def update(self, now_us: int) -> None:
        """Update the statuses from the observer."""
        statuses = self._observed.statuses(self._observer)
        if statuses == self._statuses:
            return
        for index, (before, status) in enumerate(zip(self._statuses, statuses, strict=True)):
            if before != status:
                self._shown[index] = shown(self._shown[index], status)
                if self._recording_since_us is not None:
                    since_us = now_us - self._recording_since_us
                    self._transitions.append(transition(since_us, index + 1, status))
        self._statuses = statuses
        self._buffer = status_buffer(self._shown)

    def answer(self, parts: Sequence[bytes], now_us: int) -> list[bytes]:
        """Return the reply to one request; a malformed request gets an error."""
        request = parse_request(parts[0]) if parts else None
        if request is None:
            return _error("wrong request header")
        data = self._data(request, parts[1] if len(parts) == 2 else None, now_us)
        if isinstance(data, str):
            return _error(data)
        header = request.reply_header(self._tree_id)
        return [header] if data is None else [header, data]

    def _data(self, request: MonitorRequest, more: bytes | None, now_us: int) -> bytes | str | None:
        """Return the data after the header, None for no data, or the text of an error."""
        if request.kind in _MORE and more is None:
            return TWO_PARTS
        match request.kind:
            case RequestKind.FULL_TREE:
                return self._full.xml.encode()
            case RequestKind.STATUS:
                return self._buffer
            case RequestKind.BLACKBOARD:
                return self._blackboards(more or b"")
            case RequestKind.TOGGLE_RECORDING:
                return self._record(more or b"", now_us)
            case RequestKind.GET_TRANSITIONS:
                found = b"".join(self._transitions)
                self._transitions.clear()
                return found
            case RequestKind.HOOKS_DUMP:
                return b"[]"
            case kind if kind in _GONE:
                return None
            case kind if kind in _HOOKS:
                return NO_HOOKS
            case _:
                return "Request not recognized"

    def _blackboards(self, names: bytes) -> bytes:
        """Encode the conditions of T_G as entries, for each known blackboard in `names`."""
        holds, known = self._observer.facts.condition, self._full.blackboards
        wanted = [name for name in names.decode(errors="replace").split(";") if name in known]
        entries = {
            name: {each: holds(each) for each in known[name] if each in self._conditions}
            for name in wanted
        }
        return bytes(msgpack.packb(entries))

    def _record(self, word: bytes, now_us: int) -> bytes | None:
        """Start recording transitions and return the Unix time in microseconds, or stop."""
        if word == b"start":
            self._recording_since_us = now_us
            self._transitions.clear()
            return str(time.time_ns() // 1_000).encode()
        if word == b"stop":
            self._recording_since_us = None
        return None


def _error(text: str) -> list[bytes]:
    return [ERROR, text.encode()]
