"""What a viewer has set, in words for the list of events."""

from collections.abc import Iterator, Mapping

from contract.config.controller import CostWeights
from contract.controller.calibration import WEIGHTS
from firmware_sim.live.settings import LiveSettings


def changes(before: LiveSettings, now: LiveSettings, own: CostWeights, controllers: Mapping[str, str]) -> Iterator[str]:
    """A text for each setting that changed; `own` are the release's weights, `controllers` labels by name."""
    if now.enable != before.enable:
        yield "control is requested" if now.enable else "the request for control is taken back"
    if now.controller != before.controller:
        yield f"controller: {controllers[now.controller]}"
    if now.plant != before.plant:
        yield f"plant: {now.plant}"
    if now.noise != before.noise:
        yield f"noise of {now.noise:g} deviations on every sensor" if now.noise else "no noise on the sensors"
    if now.dead != before.dead:
        yield f"{now.dead} is dead: it reads 0" if now.dead else f"{before.dead} reads the pressure again"
    if (now.biased, now.bias) != (before.biased, before.bias):
        yield from _bias(before, now)
    if now.loss != before.loss:
        share = f"{100 * now.loss:g} % of the pressure frames do not reach the ECU"
        yield share if now.loss else "all pressure frames reach the ECU"
    if now.delay_ms != before.delay_ms:
        yield f"jet commands reach the vehicle {now.delay_ms:g} ms late" if now.delay_ms else "no delay to the jets"
    if now.babble != before.babble:
        yield "a node babbles at the highest priority" if now.babble else "no node babbles"
    if now.weights != before.weights:
        yield weights_text(before, now, own)


def weights_text(before: LiveSettings, now: LiveSettings, own: CostWeights) -> str:
    """The cost weights that are others; `own` are the release's."""
    old, new = before.weights or own, now.weights or own
    changed = [f"{name} {getattr(new, name):g}" for name in WEIGHTS if getattr(old, name) != getattr(new, name)]
    return f"calibration of the cost: {', '.join(changed)}"


def _bias(before: LiveSettings, now: LiveSettings) -> Iterator[str]:
    if now.biased:
        yield f"{now.biased} reads {now.bias:+g} deviations wrong"
    elif before.biased:
        yield f"{before.biased} has no bias"
