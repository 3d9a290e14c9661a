"""The live page in a browser, on a real server and a loop whose flow takes no time to compute.

What the loop has is read from its messages, which the page keeps as they came; what a viewer sees is read from the
page. Every test leaves the loop as it found it.
"""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from queue import Queue
from typing import Any

import numpy as np
import pytest

from can_bridge.wire.messages import Mode
from ecu.fail_safe import OperatingMode
from firmware_sim.live.loop.live_run import pack_field
from firmware_sim.live.serving.server import serve
from firmware_sim.live.settings import WEIGHT, LiveSettings
from tests.browser import PHONE, Visit, chromium, visit
from tests.firmware_sim.bench.harness import NAMES
from tests.firmware_sim.live.harness import CONFIG, make_shown

pytestmark = pytest.mark.browser
PATIENCE_S = 60.0
START = LiveSettings(enable=True)  # once control has begun and nothing is disturbed
_WARMTH = """() => {
    const canvas = document.querySelector('#wake canvas');
    const [x, width, height] = [canvas.width >> 1, canvas.width >> 2, Math.floor(canvas.height / 3)];
    return [0, canvas.height - height].map((y) => {
        const {data} = canvas.getContext('2d').getImageData(x, y, width, height);
        let sum = 0;
        for (let i = 0; i < data.length; i += 4) sum += data[i] - data[i + 2];
        return sum / (data.length / 4);
    });
}"""
"""Red less blue, of 0 to 255, in the upper and the lower third of the wake, in the mean."""
_PAINTED = """() => [...document.querySelectorAll('canvas')].every((canvas) => {
    const {data} = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
    return data.some((value) => value > 0);
})"""
CHOSEN = {"dead": NAMES[2], "biased": NAMES[0], "controller": "off", "plant": "recording"}
PRESSED = {"noise": ("End", "1"), "bias": ("Home", "-3"), "loss": ("End", "1"), "delay_ms": ("End", "200")}


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    stop, urls = threading.Event(), Queue[str]()
    serving = serve(make_shown, port=0, is_stopped=stop.is_set, ready=urls.put, report=lambda line: None)
    thread = threading.Thread(target=asyncio.run, args=(serving,))
    thread.start()
    yield urls.get(timeout=PATIENCE_S)
    stop.set()
    thread.join(PATIENCE_S)


@pytest.fixture(scope="module")
def opened(server) -> Iterator[Callable[..., Visit]]:
    with chromium() as browser:

        def opened(tail: str = "", **window: Any) -> Visit:
            seen = visit(browser, server + tail, home=server, **window)
            seen.page.set_default_timeout(1e3 * PATIENCE_S)
            return seen

        yield opened


@pytest.fixture(scope="module")
def first(opened) -> Visit:
    """The viewer of most tests, who has come before control began."""
    found: Visit = opened()
    wait_for(found, "#headline .pill >> text=CONTROL")
    return found


@pytest.fixture
def live(first) -> Iterator[Visit]:
    yield first
    ask(first, clear=True)
    ask(first, set={"controller": "python", "plant": "wake", "enable": True})
    wait_for_settings(first, START)
    assert not first.troubles


def wait_for(seen: Visit, selector: str) -> None:
    seen.page.locator(selector).first.wait_for()


def wait_for_settings(seen: Visit, settings: LiveSettings) -> None:
    until(lambda: seen.page.evaluate("stillwake.page.settings") == asdict(settings))


def ask(seen: Visit, **request: Any) -> dict[str, Any]:
    answer: dict[str, Any] = seen.page.evaluate("request => stillwake.page.requests.ask(request)", request)
    assert "error" not in answer, answer
    return answer


def until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.05)


def test_a_newcomer_reads_what_is_seen(live):
    live.page.locator("#headline", has_text="The ECU controls with 4").wait_for()
    assert live.page.locator(".states-drawing .present").text_content() == "CONTROL"
    assert live.page.locator("#speed").text_content() != ""
    live.page.locator("#bus tbody tr", has_text="JetCommand").wait_for()
    assert live.page.locator("#curves canvas").count() == 3
    # The wake moves. Counter-clockwise, which is above, has the warm colours.
    upper, lower = live.page.evaluate(_WARMTH)
    assert upper > 20 and lower < -20
    until(lambda: live.page.evaluate(_WARMTH) != [upper, lower])


def test_each_control_acts_on_the_loop_by_keyboard_alone(live):
    def becomes(selector: str, shown: str, **changed: Any) -> None:
        wait_for_settings(live, replace(START, **changed))
        until(lambda: live.page.locator(selector).input_value() == shown)
        ask(live, clear=True)
        ask(live, set={"controller": "python", "plant": "wake"})
        # The page may be behind the loop, which starts again with another plant.
        wait_for_settings(live, START)

    for name, choice in CHOSEN.items():
        live.page.locator(f"[data-setting={name}]").select_option(choice)
        becomes(f"[data-setting={name}]", choice, **{name: choice})
    for name, (key, value) in PRESSED.items():
        live.page.locator(f"[data-setting={name}]").press(key)
        becomes(f"[data-setting={name}]", value, **{name: float(value)})
    live.page.locator("[data-weight=lift]").press("End")
    becomes("[data-weight=lift]", "100", weights=replace(CONFIG.mpc.weights, lift=WEIGHT.greatest))
    live.page.locator("[data-setting=babble]").press("Space")
    becomes("[data-setting=babble]", "on", babble=True)
    # A fault that is still latched would not end in ARMED.
    wait_for(live, "#headline .pill >> text=CONTROL")
    live.page.locator("[data-setting=enable]").press("Space")
    wait_for_settings(live, LiveSettings())
    wait_for(live, "#headline .pill >> text=ARMED")


def test_a_fault_shows_what_the_ecu_does_and_one_button_ends_it(live):
    live.page.locator("[data-setting=loss]").press("End")
    wait_for(live, "#headline >> text=The ECU has shut the jets: no pressures arrived")
    wait_for(live, ".event-list >> text=to FAULT")
    wait_for(live, ".states-drawing .present[data-state=FAULT]")
    live.page.locator("#clear").click()
    wait_for_settings(live, START)
    wait_for(live, "#headline .pill >> text=CONTROL")
    assert live.page.locator("[data-setting=loss]").input_value() == "0"
    live.page.locator("[data-setting=dead]").select_option(NAMES[2])
    wait_for(live, f".event-list >> text={NAMES[2]} is dead")
    wait_for(live, f'#wake .sensors li:has-text("{NAMES[2]}") >> text=dead, reads 0.00')
    live.page.locator("[data-request=power_cycle]").click()
    wait_for(live, ".event-list >> text=to BOOT")
    run = live.page.evaluate("stillwake.page.stream.hello.run")
    live.page.locator("[data-request=restart]").press("Enter")
    until(lambda: live.page.evaluate("stillwake.page.stream.hello.run") == run + 1)
    assert live.page.evaluate("document.activeElement.dataset.request") == "restart"
    wait_for(live, "#headline .pill >> text=CONTROL")


def test_a_refusal_is_shown(live):
    live.page.evaluate("stillwake.page.ask({set: {noise: 7}})")
    wait_for(live, "#toast >> text=Not done: live setting noise = 7: must be in 0..1")
    live.page.locator("#toast-done").click()
    assert live.page.locator("[data-setting=noise]").input_value() == "0"
    assert not live.page.locator("#toast").is_visible()


@pytest.mark.proofs  # of the page in two windows, the wide one stays
def test_every_viewer_can_use_it_on_a_phone_too(live, opened):
    phone = opened("?token=a+b", width=PHONE, height=844, dark=True)
    wait_for_settings(phone, START)
    wait_for(phone, ".states-list .present")
    assert not phone.is_wider_than_its_window
    assert phone.page.locator("#intro").bounding_box()["height"] < 844 / 8
    assert not phone.violations()
    assert not phone.troubles
    # What is out of sight is drawn as well.
    until(lambda: phone.page.evaluate(_PAINTED))
    # The wide page in the other colours, and a token that goes with both channels.
    assert not live.violations()
    urls = phone.page.evaluate("[stillwake.page.channel.url, stillwake.page.requests.channel.url]")
    assert urls == [live.home.replace("http", "ws") + name + "?token=a+b" for name in ("stream", "control")]
    phone.page.context.close()


def test_page_and_loop_mean_the_same_numbers(live):
    levels = np.arange(-8, 7, dtype=np.int8).reshape(3, 5) * 15
    raw = pack_field(70_000, 2.5, levels)
    read = """bytes => {
        const {levels, ...head} = stillwake.unpackField(new Uint8Array(bytes).buffer);
        return {...head, levels: Array.from(levels)};
    }"""
    expected = {"k": 70_000, "t": 2.5, "width": 5, "height": 3, "levels": levels.ravel().tolist()}
    assert live.page.evaluate(read, list(raw)) == expected
    shaded = {Mode.CONTROL: "control", Mode.HOLD: "hold", Mode.DECAY: "hold", Mode.FAULT: "fault"}
    assert live.page.evaluate("stillwake.Curves.SHADED") == {str(int(mode)): kind for mode, kind in shaded.items()}
    ticks = "step => stillwake.page.curves.drag.options().axes[1].values(null, [0.9, 0.9 + step], 1, 17, step)"
    assert [live.page.evaluate(ticks, step) for step in (0.05, 0.025)] == [["0.90", "0.95"], ["0.900", "0.925"]]
    states = live.page.evaluate("stillwake.StateMachine.STATES")
    assert sorted(states) == sorted(["UNPOWERED", "BOOT", *OperatingMode.__members__])
    # What has another word on the wire, and so in a run's series.
    others = {mode.name for mode in OperatingMode if mode.on_wire.name != mode.name}
    assert others == set(live.page.evaluate("stillwake.StateMachine.OFF"))
    # A weight that is sent back stays nearly the same: at most half of a slider's step, 12 %, is lost.
    scale = (
        "values => values.map((value) => stillwake.byRatio(1000)).map((scale, i) => scale.from(scale.to(values[i])))"
    )
    given = [0.0, 0.01, 0.02, 0.3, 8.0, 1000.0, *CONFIG.mpc.weights.as_tuple()]
    assert live.page.evaluate(scale, given) == pytest.approx(given, rel=0.075)


def test_it_comes_back_when_its_connection_is_lost(live):
    live.page.evaluate("stillwake.page.channel.socket.close()")
    wait_for(live, "body[data-connection=lost] #headline >> text=The loop cannot be reached")
    live.page.evaluate("stillwake.page.stream.hello = null")
    wait_for(live, "body[data-connection=live] #headline .pill >> text=CONTROL")
    assert live.page.evaluate("stillwake.page.stream.hello.run") >= 1


def test_a_state_that_passes_in_a_hidden_tab_does_not_stay_lit(live):
    # A hidden tab gets no frames, but its timers go on.
    live.page.evaluate("""async () => {
        const [frame, waiting] = [globalThis.requestAnimationFrame, []];
        globalThis.requestAnimationFrame = (draw) => waiting.push(draw);
        stillwake.page.states.glow('UPDATE');
        await new Promise((over) => setTimeout(over, 1600));
        globalThis.requestAnimationFrame = frame;
        waiting.forEach((draw) => frame(draw));
    }""")
    wait_for(live, ".states-drawing .passed[data-state=UPDATE]")
    until(lambda: live.page.locator(".passed[data-state=UPDATE]").count() == 0)


def test_a_slider_takes_every_key_and_follows_the_loop_once_it_is_released(live):
    slider = live.page.locator("[data-setting=noise]")
    for _ in range(6):
        slider.press("ArrowRight")
    until(lambda: live.page.evaluate("stillwake.page.settings.noise") == 0.3)
    ask(live, clear=True)
    until(lambda: slider.input_value() == "0")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    x, y = box["x"] + 2, box["y"] + box["height"] / 2
    live.page.mouse.move(x + 6, y)
    live.page.mouse.down()
    for to in (x + 80, x):
        live.page.mouse.move(to, y, steps=5)
    live.page.mouse.up()
    ask(live, set={"noise": 0.5})
    until(lambda: slider.input_value() == "0.5")
