"""Run a command, print what it cost, and fail where it cost more than it may.

python tests/measured.py --wall-s 90 COMMAND [ARGUMENT ...]
python tests/measured.py --cpu-minutes 19 COMMAND [ARGUMENT ...]
"""

import argparse
import os
import subprocess
import sys
import time


def main() -> int:
    """The command's status, or 1 if it was good and too expensive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cpu-minutes", type=float, default=float("inf"), help="of the command and all its children")
    parser.add_argument("--wall-s", type=float, default=float("inf"), help="by the clock")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    began = time.monotonic()
    status = subprocess.run(options.command, check=False).returncode
    wall_s, times = time.monotonic() - began, os.times()
    cpu_minutes = (times.children_user + times.children_system) / 60
    sys.stderr.write(f"{wall_s / 60:.1f} min by the clock, {cpu_minutes:.1f} CPU minutes\n")
    allowed = [
        text
        for over, text in (
            (cpu_minutes > options.cpu_minutes, f"{options.cpu_minutes:g} CPU minutes"),
            (wall_s > options.wall_s, f"{options.wall_s:g} s by the clock on two quiet cores"),
        )
        if over
    ]
    if status == 0 and allowed:
        sys.stderr.write(
            f"all passed, over budget: {' and '.join(allowed)} are allowed; whoever adds a slow test takes one out\n"
        )
        return 1
    return status


if __name__ == "__main__":
    sys.exit(main())
