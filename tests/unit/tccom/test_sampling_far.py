"""Samples of an object on another bus session: they come, stop with its provider, and come again with the next one."""

from queue import Queue

from bridge.core.hresult import ADS_E_NOTFOUND, ADS_E_TIMEOUT
from bridge.edges.bus import BusConfig, open_bus
from bridge.tccom.calls import Access
from bridge.tccom.general import IWatchSource
from bridge.tccom.proxy import RemoteObjects
from bridge.tccom.sampling import Sampler
from bridge.tccom.server import ObjectServer
from bridge.tccom.service import ObjectService
from bridge.tccom.states import State
from tests.unit.tccom.tccom_stories import Calculation

PATIENCE_S = 30.0
OBJECT_ID = 0x71010042


def test_a_sampler_outlives_the_object_it_samples(bus_config: BusConfig) -> None:
    """Reading is all it needs. A provider that goes is told once; what its successor has instead is told when it is there."""
    told: Queue[object] = Queue()
    with open_bus(bus_config) as far, open_bus(bus_config) as near, RemoteObjects(near, "plc1") as plc1:
        with ObjectServer() as server, ObjectService(server, far, "plc1", allow=[Access.READ, Access.CALL]):
            server.add(Calculation(), object_id=OBJECT_ID, parameters={"offset": 5}, state=State.OP)
            reference = plc1.get(OBJECT_ID, IWatchSource)
            sampler = Sampler(
                reference.interface,
                ["offset"],
                lambda _, value: told.put(value),
                failed=lambda error: told.put(error.code),
                every_s=0.01,
            )
            assert told.get(timeout=PATIENCE_S) == 5
            server.set_parameter(OBJECT_ID, "offset", 6)
            assert told.get(timeout=PATIENCE_S) == 6
        assert told.get(timeout=PATIENCE_S) in (ADS_E_NOTFOUND, ADS_E_TIMEOUT)
        with ObjectServer() as server:
            server.add(Calculation(), object_id=OBJECT_ID, parameters={"offset": 7}, state=State.OP)
            with ObjectService(server, far, "plc1"):
                assert told.get(timeout=PATIENCE_S) == 7
                sampler.close()
                reference.safe_release()
        assert told.empty()
