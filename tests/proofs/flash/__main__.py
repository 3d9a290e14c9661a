"""python -m tests.proofs.flash: see `cuts`, which its processes import."""

from tests.proofs.command_line import main
from tests.proofs.flash import cuts

if __name__ == "__main__":
    main(cuts.main)
