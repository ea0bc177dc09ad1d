"""`python -m paper`: write docs/data/paper.md and its pictures."""

from __future__ import annotations

import argparse
import sys

from paper.account import ROOT, SEED, AccountError
from paper.document import files


def main() -> int:
    """Write all files and name them; exit status 2 if the run is not the paper's."""
    parser = argparse.ArgumentParser(
        prog="python -m paper",
        description="Run the paper's example and write docs/data/paper.md with its pictures.",
        epilog="example: python -m paper",
    )
    parser.parse_args()
    try:
        written = files(SEED)
    except AccountError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    for path, text in written.items():
        (ROOT / path).parent.mkdir(parents=True, exist_ok=True)
        (ROOT / path).write_text(text, encoding="utf-8")
        sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
