"""The long run of `bundle_fuzz`: `python -m tests.proofs.release --json results/bundle_fuzz.json`."""

from tests.proofs.command_line import main
from tests.proofs.release import bundle_fuzz

if __name__ == "__main__":
    main(bundle_fuzz.main)
