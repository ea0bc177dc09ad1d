"""The project of docker-compose.yml, as its user would act on it."""

from __future__ import annotations

import io
import json
import re
import subprocess
import sys
import tarfile
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from tests.support import docker_engine as docker

ROBOTS = ("a1", "a2", "b1", "b2", "c1", "c2")
# The robots of the profile `router`, and who watches them.
ROUTED = ("left-a1", "right-a2", "left-b1", "right-b2", "left-c1", "right-c2")
ROUTED_OBSERVER = "routed"
PROJECT = "mrbt-drill"
# They only end a test that hangs.
WAIT_S = 300
POLL_S = 0.2
# Compose reads it beside docker-compose.yml: the tasks that robots hold are in a file of the host.
HOLD_FOLDER, HOLD_FILE = "hold", "names"
OVERRIDE = """\
services:
  observer:
    environment: {COLUMNS: "200"}
""" + "".join(
    f"  {robot}:\n    environment: {{MRBT_HOLD: /hold/{HOLD_FILE}}}\n"
    f"    volumes: ['./{HOLD_FOLDER}:/hold:ro']\n"
    for robot in (*ROBOTS, *ROUTED)
)
# Substitutes for the images of a broker and of node, and their contents.
AGV_PACKAGES = "mosquitto,nodejs"
NODE_FOLDER, BROKER_FILE = "agv_node", "broker.conf"
OVERRIDE += f"""\
  broker:
    volumes: ["./{BROKER_FILE}:/mosquitto-no-auth.conf:ro"]
  agvs:
    volumes: ["./{NODE_FOLDER}:/agvs"]
  warehouse:
    environment: {{COLUMNS: "200"}}
"""


class Compose:
    """One project of docker-compose.yml; commands as a user would give them."""

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder = folder
        self._environment = dict(environment)
        self._followers: list[subprocess.Popen[str]] = []
        self._tick = threading.Event()

    def __call__(self, *arguments: str, timeout_s: float = WAIT_S) -> str:
        """Run a compose command, which must succeed; returns what it printed."""
        return self._run([*docker.compose_command(), *arguments], timeout_s)

    def docker(self, *arguments: str) -> str:
        return self._run(["docker", *arguments], WAIT_S)

    def _run(self, command: list[str], timeout_s: float) -> str:
        done = subprocess.run(
            command,
            cwd=self._folder,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )
        assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}"
        return done.stdout

    def container(self, service: str) -> str:
        """The id of a service's container, running or not; those of `run` do not count."""
        labels = {"project": PROJECT, "service": service, "oneoff": "False"}
        command = ["ps", "--all", "--quiet", "--no-trunc"]
        for key, value in labels.items():
            command += ["--filter", f"label=com.docker.compose.{key}={value}"]
        return self.docker(*command).strip()

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Run a compose command in the background."""
        return self._follow([*docker.compose_command(), *arguments], subprocess.DEVNULL)

    def observer(self, service: str = "observer") -> Lines:
        """The output of an observer's container, from its start."""
        logs = ["docker", "logs", "--follow", self.container(service)]
        return Lines(self._follow(logs, subprocess.STDOUT))

    def _follow(self, command: list[str], errors: int) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            command,
            cwd=self._folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        self._followers.append(process)
        return process

    def file(self, service: str, path: str) -> str:
        """A file of a service's container; its container need not run. Empty if there is none."""
        done = subprocess.run(
            ["docker", "cp", f"{self.container(service)}:{path}", "-"],
            env=self._environment,
            capture_output=True,
            timeout=WAIT_S,
            check=False,
        )
        if done.returncode != 0:
            return ""
        with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
            (member,) = archive.getmembers()
            content = archive.extractfile(member)
            assert content is not None
            return content.read().decode()

    def events(self) -> list[dict[str, Any]]:
        """What all robots did: each writes its own events.jsonl."""
        lines = [
            json.loads(line)
            for robot in ROBOTS
            for line in self.file(robot, "/var/lib/mrbt/events.jsonl").splitlines()
        ]
        return sorted(lines, key=lambda event: event["t"])

    def log(self, service: str) -> list[dict[str, Any]]:
        """A robot's log."""
        text = self.file(service, f"/var/lib/mrbt/{service.upper()}.log")
        return [json.loads(line) for line in text.splitlines()]

    def is_well(self, service: str) -> bool:
        """What the health check of a running container says now; the engine asks every 10 s."""
        container = self.container(service)
        kind, command = json.loads(
            self.docker("inspect", "--format", "{{json .Config.Healthcheck.Test}}", container)
        )
        assert kind == "CMD-SHELL"
        done = subprocess.run(
            ["docker", "exec", container, "sh", "-c", command], env=self._environment, check=False
        )
        return done.returncode == 0

    def hold(self, *names: str) -> None:
        """From now on these tasks are started and not gone on with; none: all go on."""
        (self._folder / HOLD_FOLDER / HOLD_FILE).write_text("".join(f"{n}\n" for n in names))

    def wait_until(self, holds: Callable[[], Any], what: str) -> None:
        for _ in range(int(WAIT_S / POLL_S)):
            if holds():
                return
            self._tick.wait(POLL_S)
        raise AssertionError(f"never came true: {what}")

    def clean(self) -> None:
        """`down -v`, and an end to everything that was started."""
        for follower in self._followers:
            follower.kill()
            follower.wait()
            if follower.stdout is not None:
                follower.stdout.close()
        profiles = ("--profile", "router", "--profile", "metrics", "--profile", "vda5050")
        self(*profiles, "down", "--volumes", "--timeout", "5", timeout_s=WAIT_S)


class Lines:
    """A stream of the observer's lines."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.seen: list[str] = []

    def until(self, pattern: str) -> re.Match[str]:
        """Read on until a line matches; the test's own time limit applies."""
        (found,) = self.until_all(pattern)
        return found

    def until_all(self, *patterns: str) -> list[re.Match[str]]:
        """Read on until each pattern has matched a line, in any order, since that of different
        robots' lines is not fixed. Returns each pattern's first match.
        """
        assert self._process.stdout is not None
        found: dict[str, re.Match[str]] = {}
        for line in self._process.stdout:
            sys.stdout.write(line)
            self.seen.append(line.rstrip())
            for pattern in patterns:
                match = re.search(pattern, line)
                if match is not None:
                    found.setdefault(pattern, match)
            if len(found) == len(patterns):
                return [found[pattern] for pattern in patterns]
        missing = [pattern for pattern in patterns if pattern not in found]
        raise AssertionError(f"no line with {missing} in:\n" + "\n".join(self.seen))
