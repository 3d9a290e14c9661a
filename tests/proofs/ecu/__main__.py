"""python -m tests.proofs.ecu hostile: the ECU and the vehicle on a bad bus, for long."""

from tests.proofs.command_line import main
from tests.proofs.ecu import hostile

if __name__ == "__main__":
    main({"hostile": hostile.main})
