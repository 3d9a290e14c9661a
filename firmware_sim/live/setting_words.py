"""What a viewer has set, in words for the list of events."""

from collections.abc import Iterator, Mapping

from contract.config.controller import CostWeights
from contract.controller.calibration import WEIGHTS
from firmware_sim.live.settings import LiveSettings


def changes(before: LiveSettings, now: LiveSettings, own: CostWeights, controllers: Mapping[str, str]) -> Iterator[str]:
    """A text for each setting that changed; `own` are the release's weights, `controllers` labels by name."""
    all_frames = "all pressure frames reach the ECU"
    percent, late = f"{100 * now.loss:g} %", f"{now.delay_ms:g} ms late"
    bias_before, bias = ((one.biased and (one.biased, one.bias)) for one in (before, now))
    rows: tuple[tuple[object, object, str, str], ...] = (
        (before.enable, now.enable, "control is requested", "the request for control is taken back"),
        (before.controller, now.controller, f"controller: {controllers[now.controller]}", ""),
        (before.plant, now.plant, f"plant: {now.plant}", ""),
        (before.noise, now.noise, f"noise of {now.noise:g} deviations on every sensor", "no noise on the sensors"),
        (before.dead, now.dead, f"{now.dead} is dead: it reads 0", f"{before.dead} reads the pressure again"),
        (bias_before, bias, f"{now.biased} reads {now.bias:+g} deviations wrong", f"{before.biased} has no bias"),
        (before.loss, now.loss, f"{percent} of the pressure frames do not reach the ECU", all_frames),
        (before.delay_ms, now.delay_ms, f"jet commands reach the vehicle {late}", "no delay to the jets"),
        (before.babble, now.babble, "a node babbles at the highest priority", "no node babbles"),
    )
    for old, new, set_to, unset in rows:
        if new != old:
            yield set_to if new else unset
    if now.weights != before.weights:
        was, cost = before.weights or own, now.weights or own
        changed = [f"{name} {getattr(cost, name):g}" for name in WEIGHTS if getattr(was, name) != getattr(cost, name)]
        yield f"calibration of the cost: {', '.join(changed)}"
