"""A pressure goes to the ECU and a jet command comes back, over a real python-can bus in virtual time."""

from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.e2e import profile5
from can_bridge.e2e.receiver import Check, E2eReceiver, StreamState
from can_bridge.e2e.sender import E2eSender
from can_bridge.wire import codec
from can_bridge.wire.message_specs import JET_COMMAND, PRESSURE
from can_bridge.wire.messages import JetCommand, Mode, Pressure
from contract.config.vehicle import BusConfig

PERIOD_NS = 20_000_000


def test_echoed_counter_tells_the_age_of_what_the_command_rests_on():
    config = BusConfig(interface="virtual", channel="end-to-end")
    pressures, pressures_in = E2eSender(PRESSURE), E2eReceiver(PRESSURE, config.e2e)
    commands, commands_in = E2eSender(JET_COMMAND), E2eReceiver(JET_COMMAND, config.e2e)
    sent_at: dict[int, int] = {}
    with PythonCanBus.open(config) as vehicle, PythonCanBus.open(config) as ecu:
        for step in range(300):
            now_ns = step * PERIOD_NS
            message = Pressure(
                pressure_pa=(float(step), 0.0, -1.0, 2.5), valid=(True,) * 4, enable_request=True, age_ns=0
            )
            frame = pressures.frame(codec.emit_pressure(message), now_ns=now_ns)
            sent_at[profile5.counter_of(frame.data)] = now_ns
            vehicle.send(frame)

            heard = pressures_in.tick(ecu.receive_all()).accepted
            assert heard == frame
            pressure = codec.parse_pressure(heard.data)
            assert pressure is not None
            assert pressure.pressure_pa[0] == step
            answer = JetCommand(
                flow_m2_per_s=0.5,
                mode=Mode.CONTROL,
                enable=True,
                pressure_counter=profile5.counter_of(heard.data),
            )
            ecu.send(commands.frame(codec.emit_jet_command(answer), now_ns=now_ns + 8_000_000))

            reception = commands_in.tick(vehicle.receive_all())
            assert reception.accepted is not None
            command = codec.parse_jet_command(reception.accepted.data)
            assert command is not None
            assert command.pressure_counter is not None
            assert reception.accepted.timestamp_ns - sent_at[command.pressure_counter] == 8_000_000
            assert reception.checks == (Check.OK,)
        assert pressures_in.state.stream is commands_in.state.stream is StreamState.VALID
