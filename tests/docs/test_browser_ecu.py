"""The page with the ECU in WebAssembly: its commands equal those of the ECU in C here, and people can use it."""

from functools import partial
from typing import Any

import pytest

from can_bridge.e2e.profiles import E2eSender
from can_bridge.wire.frame import Frame
from can_bridge.wire.message_sets import message_set
from can_bridge.wire.messages import Pressure, VehicleSpeed
from contract.config.loading import load_config
from contract.controller.c_folder import ECU_SETTINGS
from contract.controller.calibration import LARGEST_WEIGHT, Calibration
from contract.controller.image_payload import with_layout
from contract.recording import dataset
from contract.release.manifest import SpeedRange
from contract.shipped import recording
from docs.site.browser_ecu import PERIODS, write_page
from ecu.in_c.c_ecu import CEcu, ecu_sources
from ecu.in_c.c_settings import ecu_settings
from ecu.in_c.compiler import zig_compiler
from tests.browser import PHONE, Visit, visit
from tests.docs.test_site import SITE
from tests.ecu.in_c.exported import CONFIG

pytestmark = [
    pytest.mark.browser,
    pytest.mark.compiler,
    pytest.mark.skipif(zig_compiler() is None, reason="ziglang is not installed (extra mcu)"),
]
RATIO = 2**-10  # a weight that a float32 has exactly
CHANGES: dict[int, dict[str, Any]] = {
    40: {"request": True},
    120: {"values": {1: 64 * RATIO, 5: 2048 * RATIO}},
    200: {"speed": 31.0},
    300: {"sensor": 2, "fault": "stuck"},
    360: {"sensor": 1, "fault": "invalid"},
    380: {"sensor": 0, "fault": "zero"},
    440: {"sensor": -1, "lost": 0.1, "damaged": 0.05},
    520: {"lost": 0.9, "request": False},
    560: {"lost": 0.0, "damaged": 0.0, "request": True},
    620: {"values": {"limit": True}},
}
"""What a reader changes before a period of the compared drive."""
_DRIVE = """async ([changes, periods]) => {
    stillwake.page.show = () => {};
    const ecu = await stillwake.EcuInWasm.load(stillwakeProgram);
    const vehicle = new stillwake.Vehicle(ecu);
    const values = [...ecu.facts.calibration];
    const hex = ({id, data}) => [id, [...data].map((byte) => byte.toString(16).padStart(2, '0')).join('')];
    const told = [];
    for (let k = 0; k < periods; k += 1) {
        const {values: changed, ...settings} = changes[k] || {};
        Object.assign(vehicle.settings, settings);
        if (changed && changed.limit) values[values.length - 3] /= 2;
        else Object.assign(values, changed);
        const refused = changed ? ecu.calibrate(values) : 0;
        const received = vehicle.frames();
        const sent = ecu.step(k, received);
        told.push([received.map(hex), sent.map(hex), ecu.state, changed ? [...values] : null, refused]);
    }
    return told;
}"""
"""A drive without the page's clock: [received, sent, operating mode, calibration, refusal] of each period."""
_CUT = """async () => {
    const {plot} = Object.assign(stillwake.page, {show() {}}).command;
    stillwake.page.command.window(9992, 10000);
    plot.setData(plot.data);
    await new Promise((drawn) => setTimeout(drawn, 100));
    const {width, height} = plot.ctx.canvas;
    return plot.ctx.getImageData(width - 1, height / 2, 1, height / 2).data.some((byte) => byte > 0);
}"""
"""Whether the longest last label of the time axis reaches the picture's edge."""
_TO_CONTROL = "for (let i = 0; i < 500 && stillwake.page.state !== 'CONTROL'; i += 1) stillwake.page.period()"


@pytest.fixture(scope="module")
def small(release, tmp_path_factory):
    """Sources of a small release for a range of speeds, the folder of its page, and its sensors."""
    root = tmp_path_factory.mktemp("site")
    release = release.serving(SpeedRange(slowest=0.6, fastest=1.4))
    sources = ecu_sources(release.folder, release.bundle, CONFIG)
    write_page(root / "try", sources, release.bundle, CONFIG)
    return sources, root, release.bundle.manifest.sensors


def try_page(browser, home: str) -> Visit:
    """The page, once the browser has compiled the ECU."""
    opened = visit(browser, f"{home}/try/index.html", home=home)
    opened.page.wait_for_function("stillwake.page")
    return opened


def drive(browser, root) -> list[Any]:
    opened = try_page(browser, root.as_uri())
    told: list[Any] = opened.page.evaluate(_DRIVE, [CHANGES, 700])
    assert opened.troubles == []
    opened.page.context.close()
    return told


def assert_equal_to_the_host(told, sources) -> set[str]:
    """The modes that the drive went through."""
    ecu, seen = CEcu(sources, flags=("-O1", "-ffp-contract=off")), set()
    for k, (received, sent, state, values, refused) in enumerate(told):
        now_ns = k * CONFIG.period_ns
        if values is not None:
            assert refused == 0
            ecu.calibrate(Calibration.of(values))
        frame = partial(Frame, timestamp_ns=now_ns, is_fd=True)
        answers = ecu.step(now_ns, [frame(frame_id=number, data=bytes.fromhex(data)) for number, data in received])
        assert [[one.frame_id, one.data.hex()] for one in answers] == sent, k
        assert ecu.state.fail_safe.mode.name == state, k
        seen.add(state)
    return seen


def test_each_command_equals_the_host_s_bit_for_bit_and_each_frame_the_bridge_s(small, browser):
    sources, root, sensors = small
    told = drive(browser, root)
    assert {"ARMED", "CONTROL", "HOLD", "DECAY", "FAULT"} <= assert_equal_to_the_host(told, sources)
    # Until period 200 the vehicle has the recording's pressures and the design speed.
    data, point, messages = dataset.read(recording()), CONFIG.operating_point, message_set(CONFIG.bus)
    (episode,) = (one for one in data.episodes if one.name == "controlled_2_0")
    assert len(episode) >= PERIODS
    rows = episode.series["Cp"][:, data.layout.indices(sensors)] * point.dynamic_pressure
    pressure, speed = E2eSender(messages.pressure.spec), E2eSender(messages.speed.spec)
    cruise = VehicleSpeed(speed_m_per_s=point.speed, age_ns=0, density_kg_per_m3=None)
    for k, (received, *_) in enumerate(told[:200]):
        wanted = Pressure(pressure_pa=tuple(rows[k].tolist()), valid=(True,) * 4, enable_request=k >= 40, age_ns=0)
        sent = (pressure, messages.pressure.emit(wanted)), (speed, messages.speed.emit(cruise))
        frames = (sender.frame(payload, now_ns=0) for sender, payload in sent)
        assert received == [[one.frame_id, one.data.hex()] for one in frames], k


def test_a_reader_breaks_and_mends_it_with_the_keyboard(small, browser):
    _, root, _ = small
    opened = try_page(browser, root.as_uri())
    page = opened.page
    page.locator("#pause").focus()
    page.keyboard.press("Space")
    assert page.locator("#pause").get_attribute("aria-pressed") == "true"
    page.evaluate(_TO_CONTROL)
    assert page.locator(".event-list li", has_text="→ CONTROL").count()
    played = "for (let i = 0; i < 30; i += 1) stillwake.page.one()"

    def press(setting: str, *keys: str) -> None:
        page.locator(f"[data-setting={setting}]").focus()
        for key in keys:
            page.keyboard.press(key)
        page.evaluate(played)

    press("lost", "End")
    assert page.locator("#headline .pill").inner_text() == "FAULT"
    assert "0.00 m²/s" in page.locator("#command .readout").inner_text()
    press("lost", "Home")
    press("request", "Space")
    press("request", "Space")
    assert page.locator("#headline .pill").inner_text() in ("WARMUP", "CONTROL")
    before = page.locator("[data-setting=speed]").input_value()
    press("speed", "ArrowRight", "ArrowRight")
    assert float(page.locator("[data-setting=speed]").input_value()) > float(before)
    press("sensor", "ArrowDown", "ArrowDown")
    press("fault", "ArrowDown", "ArrowDown")
    assert page.evaluate("stillwake.page.vehicle.settings").items() >= {"sensor": 1, "fault": "invalid"}.items()
    page.locator("#goal input").first.focus()
    page.keyboard.press("End")
    assert page.evaluate("stillwake.page.values[0]") == pytest.approx(LARGEST_WEIGHT)
    page.locator("#own").press("Enter")
    page.locator("#clear").press("Enter")
    page.evaluate(played)
    sound = page.evaluate("stillwake.page.vehicle.settings")
    assert (sound["sensor"], sound["lost"], sound["request"]) == (-1, 0, True)
    assert "do not change when the jets" in page.locator(".told").inner_text()
    assert opened.troubles == []


def assert_everyone_can_use(browser, home: str) -> None:
    opened = try_page(browser, home)
    opened.page.evaluate(f"stillwake.page.pause(true); {_TO_CONTROL}; stillwake.page.show()")
    assert opened.page.locator(".event-list li", has_text="requests").count()
    assert opened.troubles == []
    for dark, width in ((True, 1280), (False, PHONE)):
        opened.page.emulate_media(color_scheme="dark" if dark else "light")
        opened.page.set_viewport_size({"width": width, "height": 900})
        assert not opened.page.evaluate(_CUT), width
        assert not opened.is_wider_than_its_window, width
        # axe asks for the style sheets by requests that a browser refuses for files: troubles of its own.
        assert opened.violations() == [], (dark, width)
    opened.page.context.close()


def test_everyone_can_use_it(small, browser):
    assert_everyone_can_use(browser, small[1].as_uri())


@pytest.mark.proofs
@pytest.mark.skipif(not (SITE / "try" / "index.html").exists(), reason="the site is not built: make docs")
def test_the_site_s_page_has_the_shipped_release(browser):
    from tests.replay.judging import c_library
    from tests.replay.recording import shipped

    sources = with_layout(c_library() | {ECU_SETTINGS: ecu_settings(shipped(), load_config())})
    seen = assert_equal_to_the_host(drive(browser, SITE), sources)
    assert {"CONTROL", "HOLD", "FAULT"} <= seen
    assert_everyone_can_use(browser, SITE.as_uri())
