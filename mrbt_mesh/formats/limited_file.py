"""Read files that people name, within limits."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.formats.problems import whole_file_error


def read_limited(path: Path, limit_bytes: int) -> bytes:
    """The bytes of a file that people name; raises MissionError, also for one that is too large."""
    file = str(path)
    try:
        if not path.exists():
            raise whole_file_error(file, "there is no such file")
        # Reading a pipe or a device could block, or never end.
        if not path.is_file():
            raise whole_file_error(file, "not a file; give the file itself")
        with path.open("rb") as stream:
            content = stream.read(limit_bytes + 1)
    except OSError as error:
        raise whole_file_error(file, f"cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise whole_file_error(file, f"cannot be read: {error}") from None
    if len(content) > limit_bytes:
        raise whole_file_error(file, f"larger than the limit of {limit_bytes} bytes")
    return content
