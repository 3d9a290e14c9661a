"""Run a command and print what it cost. Its status is the command's: a slow machine fails nobody, unless `--hold`.

python tests/measured.py --wall-s 60 COMMAND [ARGUMENT ...]
python tests/measured.py --hold --cpu-minutes 9 COMMAND [ARGUMENT ...]
"""

import argparse
import os
import subprocess
import sys
import time


def main() -> int:
    """The command's status; 1 if that was good, and the command too expensive where the budget is held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cpu-minutes", type=float, default=float("inf"), help="of the command and all its children")
    parser.add_argument("--wall-s", type=float, default=float("inf"), help="by the clock")
    parser.add_argument("--hold", action="store_true", help="fail beyond the budget")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    began = time.monotonic()
    status = subprocess.run(options.command, check=False).returncode
    wall_s, times = time.monotonic() - began, os.times()
    cpu_minutes = (times.children_user + times.children_system) / 60
    sys.stderr.write(f"{wall_s / 60:.1f} min by the clock, {cpu_minutes:.1f} CPU minutes\n")
    allowed = [f"{options.cpu_minutes:g} CPU minutes"] if cpu_minutes > options.cpu_minutes else []
    allowed += [f"{options.wall_s:g} s by the clock"] if wall_s > options.wall_s else []
    if status or not allowed:
        return status
    budget = f"{' and '.join(allowed)} are the budget on two quiet cores"
    if not options.hold:
        sys.stderr.write(f"ALL PASSED. It took longer than planned ({budget}): this machine is slower or busy\n")
        return 0
    sys.stderr.write(f"OVER BUDGET, all passed: {budget}; whoever adds a slow test takes one out\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
