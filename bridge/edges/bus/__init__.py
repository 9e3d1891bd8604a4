"""Bytes on keys, between programs. The only package that imports zenoh."""

from bridge.edges.bus.ends import Answer, Arrival, Question, Receiver, Refusal, Reply, Sender
from bridge.edges.bus.session import DEFAULT_CAPACITY, Bus, Closable, open_bus
from bridge.edges.bus.settings import ALONE, LOCAL, BusConfig, BusError

__all__ = [
    "ALONE",
    "DEFAULT_CAPACITY",
    "LOCAL",
    "Answer",
    "Arrival",
    "Bus",
    "BusConfig",
    "BusError",
    "Closable",
    "Question",
    "Receiver",
    "Refusal",
    "Reply",
    "Sender",
    "open_bus",
]
