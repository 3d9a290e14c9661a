from can_bridge.bus.backends.python_can import PythonCanBus
from can_bridge.bus.backends.receive_thread import ReceiveThread
from contract.errors import BusError
from tests.can_bridge.bus.backends.ptys import PATIENCE_S
from tests.can_bridge.bus.backends.test_python_can import SOUND, ScriptedBus
from tests.refused import refused


def test_what_ends_the_thread_is_kept_and_raised():
    for error in [OSError(19, "No such device"), MemoryError("out of memory"), RuntimeError("bug")]:
        scripted = ScriptedBus([error, SOUND])
        with ReceiveThread(PythonCanBus(scripted), lambda frame: None) as thread:
            thread._thread.join(PATIENCE_S)
            assert not thread._thread.is_alive(), error
            with refused(BusError, "CAN reception ended"):
                thread.check()
        assert scripted.script == [SOUND], error
