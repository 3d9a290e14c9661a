"""The plants and the ECUs of a live loop, by name. A plant or an ECU that takes seconds to build is built only when it
is selected."""

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from contract.config.tree import Config
from contract.errors import StillwakeError
from contract.release.checks import Bundle
from contract.runtime.onnx_session import OnnxController
from stillwake.console.endings import missing
from stillwake.parts.c_release import library_folder
from stillwake.parts.releases import open_release

if TYPE_CHECKING:
    from ecu.stepped import LoopEcu
    from firmware_sim.live.loop.messages import Choice
    from firmware_sim.live.session import LiveSession
    from firmware_sim.live.settings import LiveSettings
    from wake.plant.protocol import LoopPlant

MAKING: Final = "the C library of the shipped model is being built (one minute); the loop continues"
COMPILING: Final = {
    "c": "the ECU in C is being compiled; the loop continues",
    "mcu": "the ECU in C is being compiled for the emulated microcontroller; the loop continues",
}
_MAKES_LIBRARY: Final = ("safetensors", "onnx")
_EMULATES: Final = ("ziglang", "unicorn", "capstone", "elftools")
_TOLD_EVERY: Final = 10.0
"""Time in t_c between two messages to the user while an initial state of another grid settles on the present grid."""


@dataclass(frozen=True, kw_only=True)
class LiveParts:
    """The parts of one live loop; the process of the loop gets this object at its start. Without a bundle or a state,
    the shipped one is used; without a library, the library of the shipped bundle is made when it is needed. `lead_in`
    is the time in t_c until control is requested."""

    bundle: Path | None
    library: Path | None
    config: Config
    state: Path | None
    settings: "LiveSettings"
    lead_in: float

    def __call__(self, tell: Callable[[str], None]) -> "LiveSession":
        """Build the loop. `tell` is called with a description of the work for which the user waits. Raises
        StillwakeError if plant or ECU is not available, or if plant and ECU do not fit each other."""
        from firmware_sim.live.session import LiveSession

        release = open_release(self.bundle)
        ecus = Ecus(release, self.config, self.library, tell)
        return LiveSession(
            bundle=release,
            config=self.config,
            wake=lambda name: self._plant(name, tell),
            ecu=ecus,
            ahead=ecus.ahead,
            controllers=controllers(release, self.library),
            plants=plants(self.state),
            settings=self.settings,
            lead_in=self.lead_in,
        )

    def _plant(self, name: str, tell: Callable[[str], None]) -> "LoopPlant":
        if name == "recording":
            from contract.recording.dataset import read
            from contract.shipped import recording
            from wake.recorded_wake import RecordedWake

            dataset = read(recording())
            # An episode without actions is preferred, because the effect of the recorded jets would not fit the actions
            # of the live jets.
            calm = (episode for episode in dataset.episodes if not episode.series["action"].any())
            return RecordedWake(next(calm, dataset.episodes[0]), dataset.layout, self.config.flow)
        from wake.plants import own_wake

        def settling(t: float, total: float) -> None:
            if t % _TOLD_EVERY < self.config.flow.control_period:
                tell(f"the start settles on this grid: {t:.0f} of {total:.0f} t_c")

        return own_wake(self.config, settling, start=self.state)


class Ecus:
    """The ECUs of one release in one vehicle, by the names of their controllers. An ECU in C is built only once."""

    def __init__(self, release: Bundle, config: Config, library: Path | None, tell: Callable[[str], None]) -> None:
        self._release, self._config, self._library, self._tell = release, config, library, tell
        self._in_c: dict[str, LoopEcu] = {}

    def __call__(self, name: str) -> "LoopEcu":
        """Return the ECU of a controller. An ECU in Python is new and just powered on; an ECU in C is always the same
        object, which the session also stores. Raises StillwakeError if the ECU is not available."""
        from can_bridge.secoc.securing import authentication_in_virtual_time
        from ecu.ecu import Ecu
        from ecu.stepped import LoopEcu

        if name in COMPILING:
            self.prepare(name)
            return self._in_c[name]
        authentication = authentication_in_virtual_time(self._config.bus)
        ecu = Ecu(self._release, self._graph, self._config, authentication=authentication)
        return LoopEcu(ecu=ecu, kind="python", computed_by=self._graph.description)

    def ahead(self, name: str) -> Callable[[], None] | None:
        """Return a function that builds an ECU in C, to be called while the loop runs; None if no ECU must be built."""
        return partial(self.prepare, name) if name in COMPILING and name not in self._in_c else None

    def prepare(self, name: str) -> None:
        """Build an ECU in C unless it exists; this takes seconds. Raises StillwakeError if the ECU cannot be built."""
        from can_bridge.secoc.key import read_secret
        from firmware_sim.bench.ecus import loop_ecu

        if name not in self._in_c:
            key = self._config.bus.key
            sources = self._sources
            self._tell(COMPILING[name])
            self._in_c[name] = loop_ecu(name, sources, secret=read_secret(Path(key)) if key else None)

    @cached_property
    def _graph(self) -> OnnxController:
        from firmware_sim.bench.simulation import WARM_UP_PLANS

        graph = OnnxController.of(self._release)
        graph.warm_up(WARM_UP_PLANS)
        return graph

    @cached_property
    def _sources(self) -> dict[str, bytes]:
        from ecu.in_c.c_ecu import ecu_sources

        if self._library is None:
            self._tell(MAKING)
        with library_folder(self._library) as folder:
            return ecu_sources(folder, self._release, self._config)


def controllers(release: Bundle, library: Path | None) -> "list[Choice]":
    """Return the controllers of the live loop with this release, in the order of the page's `CONTROLLERS`."""
    from ecu.in_c.compiler import host_compiler

    precision, no_library = release.manifest.precision, _no_library(release, library)
    rows = (
        ("python", f"Python, {precision} ONNX graph", None),
        ("c", f"C, {precision}", no_library or _error_of(host_compiler)),
        ("mcu", f"emulated Cortex-M7, {precision}", no_library or _lacks(_EMULATES)),
        ("off", "off: no supply", None),
    )
    return [{"name": name, "label": label, "missing": lacks} for name, label, lacks in rows]


def plants(state: Path | None = None) -> "list[Choice]":
    """Return the plants of the live loop, in the order of `firmware_sim.live.settings.PLANTS`. `state` is the initial
    state of the flow; None means the shipped state, which may not be installed."""
    from contract import shipped

    missing_state = None if state is not None else _error_of(shipped.developed)
    return [
        {"name": "wake", "label": "wake: responds to the jets", "missing": missing_state},
        {"name": "recording", "label": "recording: does not respond", "missing": _error_of(shipped.recording)},
    ]


def _no_library(release: Bundle, library: Path | None) -> str | None:
    if library is not None:
        return None
    if release.digest != open_release(None).digest:
        return "name the bundle's C library with --library (`stillwake export --c`)"
    return _lacks(_MAKES_LIBRARY)


def _error_of(get: Callable[[], object]) -> str | None:
    """Return the reason why `get` fails; None if it succeeds."""
    try:
        get()
    except StillwakeError as error:
        return str(error)
    return None


def _lacks(modules: tuple[str, ...]) -> str | None:
    found = (name for name in modules if importlib.util.find_spec(name) is None)
    return next((missing(name) for name in found), None)
