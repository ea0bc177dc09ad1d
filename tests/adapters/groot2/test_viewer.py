"""A tree served over ZeroMQ, to a client that is written from the protocol's description."""

from __future__ import annotations

import contextlib
import socket
import struct
from random import Random
from xml.etree import ElementTree

import msgpack
import pytest
import zmq

from mrbt_mesh.adapters.groot2.viewer import MAX_REQUEST_BYTES, listening
from mrbt_mesh.errors import InputError
from tests.support.extras import said_without
from tests.support.groot2 import Desk, Monitor, monitoring, served


def test_a_monitor_follows_the_team() -> None:
    desk = Desk()
    desk.go("pass 300")
    with served(desk.monitored) as port, monitoring(port) as monitor:
        (xml,) = monitor.ask("T")
        root = ElementTree.fromstring(xml)
        assert root.get("BTCPP_format") == "4"
        names = {int(e.get("_uid", 0)): e.get("name") for e in root.iter()}
        running = [names[uid] for uid, status in monitor.statuses().items() if status == 1]
        assert running[-1] == "weld"
        desk.go("succeed A", "pass 300")
        assert monitor.statuses()[5] == 1
        (data,) = monitor.ask("B", b"MainTree")
        assert msgpack.unpackb(data) == {"MainTree": {"done": False}}
        assert monitor.raw(b"nonsense") == [b"error", b"wrong request header"]
        assert monitor.statuses()[5] == 1


def test_several_monitors_at_once() -> None:
    desk = Desk()
    with served(desk.monitored) as port, monitoring(port) as one, monitoring(port) as other:
        assert one.ask("T") == other.ask("T", number=1)


def test_who_sends_too_much_or_leaves_without_an_answer_disturbs_nobody() -> None:
    desk = Desk()
    with served(desk.monitored) as port:
        rude = Monitor(port)
        rude._socket.send_multipart([bytes([2, ord("T"), 0, 0, 0, 0])])
        rude.close()
        big = Monitor(port)
        big._socket.setsockopt(zmq.RCVTIMEO, 200)
        with pytest.raises(zmq.Again):
            big.raw(bytes(MAX_REQUEST_BYTES + 1))
        big.close()
        with monitoring(port) as monitor:
            assert monitor.ask("D") == [b"[]"]


def random_part(random: Random) -> bytes:
    kind = random.choice(b"TSBIRUDAXrtZ")
    header = struct.pack("<BBI", 2, kind, random.getrandbits(32))
    names = random.choice([b"start", b"MainTree;" * 500, b"\xff" * 100])
    return random.choice([header, header, b"", names, random.randbytes(random.randrange(40))])


def test_whatever_is_sent_ends_nothing() -> None:
    """Random messages with and without an envelope, of any kind of socket, and random bytes."""
    random, desk = Random(7), Desk()
    types = (zmq.DEALER, zmq.DEALER, zmq.REQ, zmq.ROUTER, zmq.PUSH, zmq.PAIR)
    with served(desk.monitored) as port, zmq.Context() as context:
        where = f"tcp://127.0.0.1:{port}"
        for number in range(200):
            with context.socket(random.choice(types)) as rude:
                rude.setsockopt(zmq.LINGER, 100)
                rude.connect(where)
                parts = [random_part(random) for _ in range(random.choice([1, 1, 2, 3, 50]))]
                with contextlib.suppress(zmq.ZMQError):
                    rude.send_multipart([b""] if number % 9 == 0 else parts, zmq.DONTWAIT)
                    rude.send_multipart([b"", *parts], zmq.DONTWAIT)
            with socket.create_connection(("127.0.0.1", port)) as raw:
                greeting = b"\xff" + bytes(8) + b"\x7f\3\0NULL" + bytes(48)
                raw.sendall(greeting * (number % 2) + random.randbytes(60))
        with monitoring(port) as monitor:
            assert monitor.ask("D") == [b"[]"]


async def test_a_port_that_is_taken_is_said() -> None:
    with listening("127.0.0.1", 0) as (_, port):
        text = f"127.0.0.1:{port}: cannot listen for Groot2: Address already in use"
        with pytest.raises(InputError, match=text), listening("127.0.0.1", port):
            pass


def test_without_the_library_it_is_said_how_to_get_it() -> None:
    said = said_without(
        "zmq", "mrbt_mesh.adapters.groot2.viewer", "listening('127.0.0.1', 0).__enter__()"
    )
    assert "pip install 'mrbt-mesh[groot2]'" in said
