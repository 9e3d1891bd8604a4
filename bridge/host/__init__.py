"""A plant from one file: loggers, recorders, gateways and a user's own modules as modules, up and down in order."""

from bridge.host.event_log import IEventLog
from bridge.host.host import Host
from bridge.host.plan import Plan, make_plan
from bridge.host.surroundings import Surroundings

__all__ = ["Host", "IEventLog", "Plan", "Surroundings", "make_plan"]
