"""The command `python -m tests.proofs.models`; see `proof`."""

from tests.proofs.command_line import main
from tests.proofs.models import proof

if __name__ == "__main__":
    main(proof.main)
