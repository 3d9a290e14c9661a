"""The commands that run in `make test`, each within about a second."""

from typing import Final

from tests.docs.blocks.plan import Run

ON_A_BUS: Final = "--set bus.interface=virtual --set bus.channel=page"
"""A bus within the process, in place of the one that the page says."""
_ITS_BUS: Final = ((r"--set\nbus\.(interface|channel)=[^\n]+", ""),)

QUICK: Final = (
    Run(form=r"stillwake can keygen \S+"),
    # Beside nine tenths of other traffic a message can be late, which is status 3.
    Run(form=r"stillwake can load .*load=0\.9.*", statuses=(0, 3)),
    Run(form=r"stillwake can load( (?!.*load=0\.9).*)?"),
    Run(form=r"stillwake can decode .*"),
    Run(form=r"stillwake can monitor --log .*", shortened=((r"--speed\n0\.5", "--speed\n1000"),)),
    Run(form=r"stillwake can monitor( --dbc .*)?", added=f"--once {ON_A_BUS}"),
    Run(form=r"stillwake can monitor --set .*", shortened=_ITS_BUS, added=f"--once {ON_A_BUS}"),
    Run(
        form=r"stillwake can record .*",
        shortened=((r"--for\n60", ""),),
        added=f"--for 0.2 {ON_A_BUS}",
        # Nothing is sent on that bus, and the lines behind read what was recorded.
        instead=("drive", 3),
        replaced=True,
    ),
    Run(
        form=r"stillwake can replay .*",
        # A loop ends by a signal alone: tests/stillwake/commands/can/test_log.py sends it.
        shortened=(*_ITS_BUS, (r"--speed\n0\.5", ""), (r"--loop", "")),
        added=f"--speed 1000 {ON_A_BUS}",
    ),
    Run(form=r"stillwake can send .*", shortened=((r"--count\n50", "--count\n2"),), added=ON_A_BUS),
    Run(form=r"stillwake bundle (keygen|keylist|renew|inspect|verify) .*"),
    # Two bundles that differ: status 3 would be of another one.
    Run(form=r"stillwake bundle diff A B", statuses=(0, 1)),
    Run(form=r"stillwake ecu provision .*"),
    Run(form=r"stillwake calibrate --a2l \S+"),
    Run(form=r"stillwake campaign --list"),
    # A plan of one's own is read, and its runs are not made.
    Run(form=r"stillwake campaign runs/mine --scenarios .*", added="--list"),
    # A page that shows two ways to one data set: here one after the other.
    Run(form=r"stillwake dataset import .*--train (runs/a/frames\.log|a\.csv) .*", added="--overwrite"),
    Run(form=r"stillwake dataset (import|show) .*"),
    # The three sensors that the page shows are one too few for the release's encoder.
    Run(form=r"stillwake dataset check my\.h5", added="--set train.sensors=3"),
    Run(form=r"stillwake dataset check (?!my).*"),
    Run(form=r"stillwake picture vorticity \S+"),
    Run(form=r"stillwake report .*"),
)
