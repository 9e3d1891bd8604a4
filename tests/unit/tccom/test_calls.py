"""What calls over the bus need, and what the page of the wire says about them."""

from pathlib import Path
from typing import Protocol

import msgspec
import pytest

from bridge.tccom import general
from bridge.tccom.calls import Access, Call, CallAnswer, Create, Describe, Held, Hold, Release, access_of
from bridge.tccom.interfaces import Answer, describe, interface

PAGE = (Path(__file__).parents[3] / "docs" / "wire.md").read_text(encoding="utf-8")
SECTION = PAGE.partition("## Calls to objects\n")[2].partition("\n## ")[0]
NEEDS = {
    "IObject": {
        "get_object_id": "read",
        "get_object_name": "read",
        "set_object_name": "set",
        "get_parent_id": "read",
        "set_parent_id": "set",
        "get_state": "read",
        "set_state": "state",
        "get_parameter": "read",
        "set_parameter": "set",
    },
    "IDataAreas": {"read_symbol": "read", "write_symbol": "set"},
    "IWatchSource": {"read_values": "read"},
    "IObjectServer": {
        "objects": "read",
        "object_info": "read",
        "classes": "read",
        "class_info": "read",
        "create_instance": "state",
        "delete_instance": "state",
    },
    "ICyclic": {"cycle_update": "call"},
    "ICyclicCaller": {"add_module": "call", "remove_module": "call"},
    "ITask": {"task_info": "read"},
    "IUnknown": {},
}


def test_every_method_of_a_general_interface_has_its_access() -> None:
    """A method that is added must be placed here too: by default it would need no more than a call."""
    found = {
        name: {method: str(access_of(describe(one).id, method)) for method in describe(one).methods}
        for name, one in vars(general).items()
        if name.startswith("I") and hasattr(one, "__tccom_interface__") and one.__module__ == general.__name__
    }
    assert found == NEEDS


def test_methods_of_others_are_calls() -> None:
    """Whatever they are called."""
    assert access_of("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d0001", "get_state") is Access.CALL


def test_a_derived_interface_needs_what_its_base_needs() -> None:
    """Else a class that derives from IObject could be moved by whoever may only call."""

    @interface("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d0c01")
    class IDerived(general.IObject, Protocol):
        def work(self) -> Answer[None]: ...

    info = describe(IDerived)
    needs = {method: str(access_of(info.id, method)) for method in info.methods}
    assert needs == NEEDS["IObject"] | {"work": "call"}


@pytest.mark.parametrize("kind", [Call, Hold, Create, Release, Describe, Held, CallAnswer])
def test_the_page_names_every_field(kind: type[msgspec.Struct]) -> None:
    """Of each question and answer."""
    for name in kind.__struct_fields__:
        assert f"`{name}`" in SECTION
