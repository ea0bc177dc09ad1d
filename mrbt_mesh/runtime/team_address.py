"""Where a team is and how to reach it: from a run directory, or somewhere on the network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.robot_options import NetworkOptions
from mrbt_mesh.runtime.run_dir import RunDir, RunInfo
from mrbt_mesh.runtime.session_config import AUTO, Certificates, TransportConfig
from mrbt_mesh.runtime.settings import ENCRYPTED

if TYPE_CHECKING:
    from mrbt_mesh.runtime.key_folder import ManifestWatch
    from mrbt_mesh.runtime.member_keys import MemberKeys


class AddressError(InputError):
    """A team's address cannot be right; the message has the remedy."""


@dataclass(frozen=True)
class TeamAddress:
    """Everything that a robot or an observer needs to exchange messages with a team.

    `run_dir`: where the robots' processes are found, if they run on this machine. `keys`: the
    folder with one's key and the team's manifest; None: messages are not signed. `speed`: how many
    times faster than the mission says its simulated robots work, as far as known.
    """

    mission: Mission
    run: str
    timing: Timing
    transport: TransportConfig
    run_dir: RunDir | None = None
    keys: Path | None = None
    speed: float = 1.0


def on_network(mission: Mission, options: NetworkOptions, robot: str = "") -> TeamAddress:
    """Return the address of a mission's team, for a robot or, without one, an observer.

    Raises AddressError, TransportError or KeysError.
    """
    for option, value in (("--team", options.team), ("--run", options.run)):
        if value is not None and not is_robot_id(value):
            text = "1 to 32 letters, digits, '_' or '-', it becomes part of keys"
            raise AddressError(f"{option} {value!r}: {text}")
    multicast = options.multicast
    if multicast is None and not options.listen and not options.connect and not options.routers:
        multicast = AUTO
    return TeamAddress(
        mission,
        options.run or mission.team_digest[:8],
        timing_of(options.beat_s, options.detection_s, mission),
        TransportConfig(
            options.team or mission.name,
            robot,
            tuple(options.listen),
            tuple(options.connect),
            multicast,
            options.transport,
            certificates_of(options.keys, robot),
            len(mission.robots),
            tuple(options.routers),
        ),
        keys=options.keys,
    )


def address_of(run_dir: RunDir) -> TeamAddress:
    """Return the address of a run directory's team, for an observer.

    Raises RunDirError or FileError if it is damaged, TransportError without the team's key.
    """
    info = run_dir.info()
    mission = load_mission(run_dir.mission_path)
    return TeamAddress(
        mission,
        info.run,
        timing_of(info.options.beat_s, info.options.detection_s, mission),
        observer_transport(run_dir, info),
        run_dir,
        keys=None if info.options.insecure else run_dir.keys_path,
        speed=info.options.speed,
    )


def observer_transport(run_dir: RunDir, info: RunInfo) -> TransportConfig:
    """Return how an observer reaches a run: it dials every robot, or a router.

    Raises TransportError or KeysError.
    """
    connect = () if info.options.routers else tuple(info.endpoints.values())
    certificates = None
    if any(endpoint.partition("/")[0] in ENCRYPTED for endpoint in connect):
        certificates = certificates_of(run_dir.keys_path)
    return TransportConfig(
        info.team,
        "",
        connect=connect,
        profile=info.options.transport,
        certificates=certificates,
        robots=len(info.robots),
        routers=tuple(info.options.routers),
    )


def certificates_of(keys: Path | None, robot: str = "") -> Certificates | None:
    """Return the certificates of a robot, or of an observer (no robot). Raises KeysError."""
    if keys is None:
        return None
    # Imported here because the library is large.
    from mrbt_mesh.runtime.key_folder import KeyFolder

    folder = KeyFolder(keys)
    return folder.certificates_of(robot or folder.reader())


def keys_of(keys: Path | None, robot: str = "") -> tuple[MemberKeys | None, ManifestWatch | None]:
    """Return the keys of a robot or an observer, and a watch for a newer manifest.

    Raises KeysError.
    """
    if keys is None:
        return None, None
    from mrbt_mesh.runtime.key_folder import KeyFolder, ManifestWatch

    folder = KeyFolder(keys)
    found = folder.keys_of(robot or folder.reader())
    return found, ManifestWatch(folder, found)


def timing_of(beat_s: float, detection_s: float, mission: Mission) -> Timing:
    """Return the timing of a mission's team.

    Raises AddressError if the times contradict each other.
    """
    try:
        timing = Timing(round(beat_s * SECOND_US), round(detection_s * SECOND_US))
        return timing.of_team(len(mission.robots))
    except ValueError as error:
        raise AddressError(str(error)) from error
