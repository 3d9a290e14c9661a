"""python -m tests.proofs.ecu_in_c ecu-c: see `proof`, which its processes import."""

from tests.proofs.command_line import main
from tests.proofs.ecu_in_c.proof import ecu_in_c

if __name__ == "__main__":
    main({"ecu-c": ecu_in_c})
