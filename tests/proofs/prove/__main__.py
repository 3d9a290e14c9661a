"""The command `python -m tests.proofs.prove`; see `proof`."""

from tests.proofs.command_line import main
from tests.proofs.prove import proof

if __name__ == "__main__":
    main(proof.main)
