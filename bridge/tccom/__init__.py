"""TcCOM: modules with identity, interfaces and a life cycle. These are the names that the author of a module needs."""

from bridge.core.hresult import AdsError
from bridge.tccom.declarations import DataArea, InterfacePointer, Parameter, Resolved, Settable
from bridge.tccom.interfaces import DONE, Answer, interface
from bridge.tccom.module import Module
from bridge.tccom.references import Reference
from bridge.tccom.registered import RegisteredModule
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from bridge.tccom.tasks import CyclicModule

__all__ = [
    "DONE",
    "AdsError",
    "Answer",
    "CyclicModule",
    "DataArea",
    "InterfacePointer",
    "Module",
    "ObjectServer",
    "Parameter",
    "Reference",
    "RegisteredModule",
    "Resolved",
    "Settable",
    "State",
    "interface",
]
