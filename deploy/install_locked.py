"""Install what a lock file names into the environment of this Python, and show how far it is.

.venv/bin/python deploy/install_locked.py requirements.lock
"""

import re
import subprocess
import sys
from pathlib import Path

PIP = (
    *(sys.executable, "-m", "pip", "install", "--disable-pip-version-check", "--no-compile"),
    *("--progress-bar", "off", "--require-hashes", "-r"),
)
# Of some packages the lock has a version per Python: they are one package.
LOCKED = re.compile(r"^([A-Za-z0-9._-]+)==", re.MULTILINE)
# From an index, or a wheel in a folder.
COLLECTING = re.compile(r"(?:Collecting |Processing (?:.*/)?)([\w.]+(?:-[a-zA-Z]\w*)*)")


def main(lock: str) -> int:
    """Run pip; returns its exit status. What pip says is shown only if it fails."""
    total = len(set(LOCKED.findall(Path(lock).read_text(encoding="utf-8"))))
    print(
        f"installing the {total} packages of {lock}: a minute, or as long as they take to download"
    )
    pip = subprocess.Popen(
        [*PIP, lock], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    )
    assert pip.stdout is not None
    output, collected = [], 0
    for line in pip.stdout:
        output.append(line)
        if found := COLLECTING.match(line):
            collected += 1
            _show(f"{collected} of {total}: {found[1]}", is_last=False, is_due=collected % 10 == 0)
        elif line.startswith("Installing collected packages"):
            _show(f"{collected} of {total}, unpacking them", is_last=True)
    if pip.wait() != 0:
        print(*output[-30:], sep="", file=sys.stderr)
    return pip.returncode


def _show(text: str, is_last: bool, is_due: bool = True) -> None:
    """On a terminal each package, on one line; elsewhere a line for every ten."""
    if sys.stdout.isatty():
        print(f"\r\x1b[K  {text}", end="\n" if is_last else "", flush=True)
    elif is_due:
        print(f"  {text}", flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
