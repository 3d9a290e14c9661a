"""The proofs at length, by the names of their figures: `python -m tests.proofs flash --json results/flash.json`.

`--help` lists them; pytest runs short ones of each.
"""

from tests.proofs import board_cuts, board_times, command_line
from tests.proofs.bus.proof import bus
from tests.proofs.ecu import hostile
from tests.proofs.ecu_in_c.proof import ecu_in_c
from tests.proofs.flash import cuts
from tests.proofs.loader_in_c import node_states
from tests.proofs.loader_in_c.proof import main as flash_c
from tests.proofs.models.proof import main as models
from tests.proofs.prove.proof import main as proofs
from tests.proofs.release import bundle_fuzz

if __name__ == "__main__":
    command_line.main({
        "bundle_fuzz": bundle_fuzz.main, "bus": bus, "ecu_c": ecu_in_c, "flash": cuts.main,
        "flash_board": board_cuts.main, "flash_c": flash_c, "flash_pieces": board_times.main, "hostile": hostile.main,
        "models": models, "proofs": proofs, "uds_states": node_states.main,
    })  # fmt: skip
