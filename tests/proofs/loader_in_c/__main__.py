"""python -m tests.proofs.loader_in_c: see `proof`, which its processes import."""

from tests.proofs.command_line import main
from tests.proofs.loader_in_c import proof

if __name__ == "__main__":
    main(proof.main)
