"""python -m tests.proofs.flash: see `proof`, which its processes import."""

from tests.proofs.command_line import main
from tests.proofs.flash import proof

if __name__ == "__main__":
    main(proof.main)
