"""One network namespace per robot on one machine, and faults between any two of them.

    robot A1: eth0 ---.
    robot B1: eth0 ---+--- bridge (in a namespace of its own) --- leg: the machine itself
    robot C1: eth0 ---'

The machine's own network gets one more interface, the leg, by which an observer reaches every
robot; no fault touches it. Cuts and losses are rules at the target, by source address, so
that each direction fails alone. Needs root on Linux, iproute2 and iptables.
"""

from __future__ import annotations

import contextlib
import functools
import ipaddress
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any

# Reserved for benchmarks of networks (RFC 2544), so no machine's own network uses it.
RANGE = ipaddress.IPv4Network("198.18.0.0/15")
MAX_ROBOTS = 250
NETNS_FOLDER = Path("/run/netns")
NAME = re.compile(r"mrbt-(\d+)-(\d+)-")
LABEL = re.compile(r"[A-Za-z0-9_-]{1,32}")
DELETE_TIMEOUT_S = 5.0

_numbers = itertools.count()


class NamespaceError(Exception):
    """The kernel or a tool refused a command; the message has the command and the reason."""


@dataclass(frozen=True, slots=True)
class LinkFault:
    """What happens to packets from one robot to another."""

    blocked: bool = False
    loss_permille: int = 0
    delay_ms: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.loss_permille <= 1000:
            raise ValueError(f"loss {self.loss_permille}: 0 to 1000 permille")


WELL = LinkFault()


def available() -> str | None:
    """Return None if namespaces can be used here, else the reason."""
    if not sys.platform.startswith("linux"):
        return f"network namespaces need Linux, this is {sys.platform}"
    if os.geteuid() != 0:
        return "network namespaces need root"
    for tool, package in (("ip", "iproute2"), ("iptables-restore", "iptables")):
        if shutil.which(tool) is None:
            return f"the command {tool} is missing (package {package})"
    return _trial()


@functools.cache
def _trial() -> str | None:
    """Try two namespaces and a fault: containers may forbid what root may do elsewhere."""
    try:
        with Namespaces(["a", "b"], "trial") as pair:
            pair.disturb([("a", "b")], loss_permille=500)
    except NamespaceError as error:
        return str(error)
    return None


@functools.cache
def has_netem() -> bool:
    """True if this kernel can delay packets (sch_netem); some lack it."""
    if shutil.which("tc") is None:
        return False
    name = f"mrbt-{os.getpid()}-{next(_numbers)}-netem"
    _run("ip", "netns", "add", name)
    try:
        tried = "tc", "-n", name, "qdisc", "add", "dev", "lo", "root", "netem", "delay", "1ms"
        return subprocess.run(tried, capture_output=True, check=False).returncode == 0
    finally:
        _run("ip", "netns", "del", name)


class Namespaces:
    """Context manager that makes the namespaces, and removes them with all processes in them.

    `label` becomes part of the namespaces' names. Namespaces of runners that died are removed at
    the next start. Raises NamespaceError.
    """

    def __init__(self, robots: Sequence[str], label: str) -> None:
        if not robots or len(robots) > MAX_ROBOTS or len(set(robots)) < len(robots):
            raise ValueError(f"1 to {MAX_ROBOTS} different robots, not {list(robots)}")
        for name in (label, *robots):
            if LABEL.fullmatch(name) is None:
                raise ValueError(f"{name!r}: 1 to 32 letters, digits, '_' or '-'")
        self._robots = tuple(robots)
        number = next(_numbers)
        self._stem = f"mrbt-{os.getpid()}-{number}-"
        self._hub = f"{self._stem}hub"
        self._leg = f"mrbt{os.getpid()}.{number}"
        self._names = {r: f"{self._stem}{label}-{r}" for r in robots}
        self._faults: dict[tuple[str, str], LinkFault] = {}
        self._network = RANGE

    def __enter__(self) -> Namespaces:
        remove_stale()
        self.can_delay = has_netem()
        self.loss_tool = "netem" if self.can_delay else "iptables statistic"
        self._network = _free_network()
        try:
            self._make()
        except NamespaceError:
            self._remove()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._remove()

    def _make(self) -> None:
        hub, names = self._hub, self._names
        _ip(f"netns add {name}" for name in (hub, *names.values()))
        # Without snooping, the bridge forwards all multicast, as a plain switch does.
        _ip([f"link add name bridge0 netns {hub} type bridge mcast_snooping 0"])
        ends = [f"name eth0 netns {names[robot]}" for robot in self._robots]
        ends.append(f"name {self._leg}")
        _ip(f"link add p{i} netns {hub} type veth peer {end}" for i, end in enumerate(ends))
        ports = [f"link set p{i} master bridge0 up" for i in range(len(ends))]
        _ip(["link set bridge0 up", *ports], hub)
        for robot in self._robots:
            _ip([*self._up("eth0", self.address(robot)), "link set lo up"], names[robot])
        _ip(self._up(self._leg, self.observer_address))
        if self.can_delay:
            for robot in self._robots:
                _tc(shaping_base(self._port(robot)), hub)

    def _up(self, interface: str, address: str) -> list[str]:
        """Return commands that bring an interface up.

        Faults are by IPv4 address, so IPv6 is off: it would bypass them.
        """
        return [
            f"link set dev {interface} addrgenmode none",
            f"address add {address}/{self._network.prefixlen} dev {interface}",
            f"link set dev {interface} up",
        ]

    def _remove(self) -> None:
        subprocess.run(["ip", "link", "del", self._leg], capture_output=True, check=False)
        _delete(name for name in _namespaces() if name.startswith(self._stem))

    # -- where robots live ----------------------------------------------------------------

    def address(self, robot: str) -> str:
        """The robot's IPv4 address."""
        return str(self._network[1 + self._robots.index(robot)])

    @property
    def observer_address(self) -> str:
        """The machine's own address on the bridge."""
        return str(self._network[254])

    def command_prefix(self, robot: str) -> list[str]:
        """Return the prefix that makes a command run in the robot's namespace, as the same pid."""
        return ["ip", "netns", "exec", self._names[robot]]

    def _port(self, robot: str) -> str:
        return f"p{self._robots.index(robot)}"

    # -- faults ---------------------------------------------------------------------------

    def disturb(self, pairs: Iterable[tuple[str, str]], **changes: Any) -> None:
        """Change the fields of a LinkFault for packets from the first to the second of each pair.

        The other direction is unchanged. A delay needs `can_delay`.
        """
        targets = set()
        for pair in pairs:
            if pair[0] == pair[1] or not {*pair} <= {*self._robots}:
                raise ValueError(f"{pair[0]} to {pair[1]}: not two robots of {self._robots}")
            fault = replace(self._faults.get(pair, WELL), **changes)
            if fault.delay_ms and not self.can_delay:
                raise NamespaceError("this kernel cannot delay packets: it lacks sch_netem")
            self._faults[pair] = fault
            targets.add(pair[1])
        for target in sorted(targets):
            self._apply(target)

    def partition(self, *groups: Iterable[str]) -> None:
        """Block every pair of robots of different groups in both directions, robot by robot."""
        sets = [sorted(set(group)) for group in groups]
        pairs = [
            pair
            for one, other in itertools.permutations(sets, 2)
            for pair in itertools.product(one, other)
        ]
        self.disturb(pairs, blocked=True)

    def heal(self) -> None:
        """Remove all faults."""
        faulty = {target for _, target in self._faults}
        self._faults.clear()
        for target in sorted(faulty):
            self._apply(target)

    def _apply(self, target: str) -> None:
        faults = {
            self.address(source): fault
            for (source, at), fault in sorted(self._faults.items())
            if at == target and fault != WELL
        }
        rules = firewall(faults, with_loss=not self.can_delay)
        _run(*self.command_prefix(target), "iptables-restore", "-w", text=rules)
        if self.can_delay:
            port = self._port(target)
            _tc([f"qdisc del dev {port} root", *shaping_base(port)], self._hub)
            _tc(shaping(port, faults), self._hub)


def firewall(faults: Mapping[str, LinkFault], *, with_loss: bool) -> str:
    """Return the iptables-restore rules of one robot's namespace.

    `faults` are by source address.
    """
    lines = ["*filter", ":INPUT ACCEPT [0:0]"]
    for source, fault in faults.items():
        if fault.blocked:
            lines.append(f"-A INPUT -s {source}/32 -j DROP")
        elif with_loss and fault.loss_permille:
            random = f"-m statistic --mode random --probability {fault.loss_permille / 1000:.3f}"
            lines.append(f"-A INPUT -s {source}/32 {random} -j DROP")
    return "\n".join([*lines, "COMMIT", ""])


def shaping_base(port: str) -> list[str]:
    """Return tc commands for classes by source at the bridge's port to one robot.

    They are not at the sender, whose TCP would notice at once that a packet is lost in its own
    queue.
    """
    return [
        f"qdisc add dev {port} root handle 1: htb default 1 r2q 100000",
        f"class add dev {port} parent 1: classid 1:1 htb rate 10gbit",
    ]


def shaping(port: str, faults: Mapping[str, LinkFault]) -> list[str]:
    """Return tc commands for loss and delay at the bridge's port to one robot, after
    `shaping_base`.
    """
    commands = []
    for number, (source, fault) in enumerate(faults.items(), start=2):
        if fault.loss_permille or fault.delay_ms:
            effect = f"delay {fault.delay_ms}ms loss {fault.loss_permille / 10:.1f}%"
            match = f"u32 match ip src {source}/32 flowid 1:{number:x}"
            commands += [
                f"class add dev {port} parent 1: classid 1:{number:x} htb rate 10gbit",
                f"qdisc add dev {port} parent 1:{number:x} netem limit 10000 {effect}",
                f"filter add dev {port} parent 1: protocol ip prio 1 {match}",
            ]
    return commands


def remove_stale() -> None:
    """Remove the namespaces of dead runners, and the processes still running in them."""
    dead = []
    for name in _namespaces():
        found = NAME.match(name)
        if found is not None and not Path(f"/proc/{found[1]}").exists():
            dead.append(name)
    _delete(dead)


def _namespaces() -> list[str]:
    try:
        return sorted(path.name for path in NETNS_FOLDER.iterdir() if NAME.match(path.name))
    except FileNotFoundError:
        return []


def _delete(names: Iterable[str]) -> None:
    """Delete namespaces with all their processes: robots outlive their launcher."""
    for name in names:
        try:
            _end_processes(name)
            _run("ip", "netns", "del", name)
        except NamespaceError:
            # Another runner may have removed it at the same time.
            if name in _namespaces():
                raise


def _end_processes(namespace: str) -> None:
    deadline_s = time.monotonic() + DELETE_TIMEOUT_S
    while pids := _run("ip", "netns", "pids", namespace).split():
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)
        if time.monotonic() > deadline_s:
            raise NamespaceError(f"{namespace}: processes {', '.join(pids)} cannot be killed")


def _free_network() -> ipaddress.IPv4Network:
    """Return a /24 that no route of this machine uses; parallel runners start at different ones."""
    routes = json.loads(_run("ip", "-json", "-4", "route", "show", "table", "all"))
    targets = {route["dst"] for route in routes} - {"default"}
    taken = [ipaddress.IPv4Network(target, strict=False) for target in targets]
    found = list(RANGE.subnets(new_prefix=24))
    start = os.getpid() % len(found)
    for network in (*found[start:], *found[:start]):
        if not any(network.overlaps(other) for other in taken):
            return network
    raise NamespaceError(f"no free network in {RANGE}")


def _ip(commands: Iterable[str], namespace: str | None = None) -> None:
    where = ["-n", namespace] if namespace is not None else []
    _run("ip", *where, "-batch", "-", text="\n".join(commands) + "\n")


def _tc(commands: Iterable[str], namespace: str) -> None:
    _run("tc", "-n", namespace, "-batch", "-", text="\n".join(commands) + "\n")


def _run(*command: str, text: str = "") -> str:
    """Run a tool and return its output. Raises NamespaceError if it fails."""
    try:
        done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    except OSError as error:
        raise NamespaceError(f"{command[0]}: {error}") from error
    if done.returncode != 0:
        raise NamespaceError(f"{' '.join(command)}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout
