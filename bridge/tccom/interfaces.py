"""What objects can be asked to do: interfaces, declared once, and the stubs through which their methods are called.

    @interface("6b3f0bcd-3f8c-4d0c-9f39-5f8d7b1d0a11")
    class ICalculation(Protocol):
        def addition(self, a: int, b: int) -> Answer[int]: ...

Rule 1: an interface is a Protocol with an id. A class offers it by naming it among its bases.
Rule 2: every method answers an HRESULT: Answer(value) is S_OK, Answer(value, S_FALSE) informs, AdsError refuses. Whatever
else a method raises reaches its caller as ADS_E_EXCEPTION, SystemExit too: nobody ends another's thread.
Rule 3: under one id an interface never changes. Its fingerprint (method names, parameters, types) is compared wherever two
declarations meet: in one process, with the one written into the decorator, and between two processes at the call.
Rule 4: a new version gets an id of its own and names what it hides. Who offers a derived interface offers its bases too.
"""

import inspect
import typing
from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Final, Generic, TypeAlias, TypeVar

import msgspec

from bridge.core.arguments import guid
from bridge.core.hresult import ADS_E_EXCEPTION, ADS_E_INVALIDPARM, S_OK, AdsError, raise_if_failed
from bridge.tccom.identity import InterfaceId
from bridge.tccom.raised import as_ads_error
from bridge.tccom.shapes import fingerprint as fingerprint_of

T = TypeVar("T")

Interface: TypeAlias = Callable[..., T]
"""A class that interface() has declared, as an argument: mypy takes no Protocol where a type[T] is wanted."""


class Answer(msgspec.Struct, Generic[T], frozen=True):
    """What a method gives back: its output, and an HRESULT that is no failure (negative ones are raised as AdsError)."""

    value: T
    result: int = S_OK


DONE: Final = Answer(None)
"""S_OK, and nothing else to say."""


class Method(msgspec.Struct, frozen=True):
    """One method of an interface: arguments is a struct with its parameters as fields, returns the type of its output."""

    name: str
    arguments: type[msgspec.Struct]
    returns: object

    def bind(self, args: tuple[object, ...], kwargs: Mapping[str, object]) -> msgspec.Struct:
        """The arguments of a call as that struct; AdsError (ADS_E_INVALIDPARM) when they do not fit its parameters."""
        try:
            return self.arguments(*args, **kwargs)
        except TypeError as error:
            raise AdsError(ADS_E_INVALIDPARM, f"{self.name}: {error}") from None


class InterfaceInfo(msgspec.Struct, frozen=True):
    """What was declared. methods includes those of the bases; hides and bases are interface ids; protocol is the class."""

    id: InterfaceId
    name: str
    methods: Mapping[str, Method]
    bases: tuple[InterfaceId, ...]
    hides: tuple[InterfaceId, ...]
    fingerprint: str
    protocol: type


class InterfaceChangedError(TypeError):
    """Two declarations of an interface under one id differ; it needs a new id."""

    def __init__(self, interface_id: InterfaceId, name: str, fingerprint: str, expected: str) -> None:
        self.interface_id, self.name, self.fingerprint, self.expected = interface_id, name, fingerprint, expected
        super().__init__(
            f"{name} ({interface_id}) is not what it was: its fingerprint is {fingerprint}, expected {expected}; "
            "give the changed interface an id of its own and let it hide this one"
        )


_DECLARED: Final[dict[InterfaceId, InterfaceInfo]] = {}
_INFO: Final = "__tccom_interface__"


def _own(kind: object) -> InterfaceInfo | None:
    """What interface() has declared about this very class, not about its bases."""
    info = vars(kind).get(_INFO)
    return info if isinstance(info, InterfaceInfo) else None


def _method(owner: type, name: str, function: object) -> Method:
    where = f"{owner.__name__}.{name}"
    if not isinstance(function, FunctionType) or inspect.iscoroutinefunction(function):
        raise TypeError(f"{where} is no plain method: an interface has nothing else")
    hints = typing.get_type_hints(function, include_extras=True)
    fields: list[tuple[str, object] | tuple[str, object, object]] = []
    for parameter in list(inspect.signature(function).parameters.values())[1:]:
        if parameter.kind is not parameter.POSITIONAL_OR_KEYWORD or parameter.name not in hints:
            raise TypeError(f"{where}: parameter {parameter.name!r} must be a plain one with a type: it may come over a bus")
        field = (parameter.name, hints[parameter.name])
        fields.append(field if parameter.default is parameter.empty else (*field, parameter.default))
    returns = hints.get("return")
    if typing.get_origin(returns) is not Answer:
        raise TypeError(f"{where} must return Answer[...]: every method of an interface answers an HRESULT")
    arguments = msgspec.defstruct(name, fields, forbid_unknown_fields=True, frozen=True)
    return Method(name, arguments, typing.get_args(returns)[0])


def interface(interface_id: str, *, hides: tuple[Interface[object], ...] = (), fingerprint: str = "") -> Callable[[T], T]:
    """Declare a Protocol as an interface; InterfaceChangedError, or TypeError for a method that cannot be called over a bus.

    hides: older interfaces that this one replaces. fingerprint: what the interface must look like, once it is published.
    """

    def declare(protocol: T) -> T:
        assert isinstance(protocol, type)
        bases = [info for info in map(_own, protocol.__mro__) if info is not None]
        methods = {name: method for base in reversed(bases) for name, method in base.methods.items()}
        own = {**dict.fromkeys(inspect.get_annotations(protocol)), **vars(protocol)}
        methods |= {name: _method(protocol, name, value) for name, value in own.items() if not name.startswith("_")}
        mark = fingerprint_of([(one.name, one.arguments, one.returns) for one in methods.values()])
        iid = guid(interface_id)
        known = _DECLARED.get(iid)
        for expected in (fingerprint, "" if known is None else known.fingerprint):
            if expected not in ("", mark):
                raise InterfaceChangedError(iid, protocol.__name__, mark, expected)
        info = InterfaceInfo(
            id=iid,
            name=protocol.__name__,
            methods=methods,
            bases=tuple(base.id for base in bases),
            hides=tuple(describe(old).id for old in hides),
            fingerprint=mark,
            protocol=protocol,
        )
        setattr(protocol, _INFO, _DECLARED.setdefault(iid, info))
        return protocol

    return declare


def describe(declared: Interface[object]) -> InterfaceInfo:
    """What interface() declared about this class; TypeError when it is none."""
    info = _own(declared)
    if info is None:
        raise TypeError(f"{declared!r} is no interface; it needs @interface(...)")
    return info


def known_interface(interface_id: InterfaceId) -> InterfaceInfo | None:
    """The interface of an id, when this process has declared it."""
    return _DECLARED.get(interface_id)


def offered(implementation: type) -> dict[InterfaceId, InterfaceInfo]:
    """The interfaces a class offers, the newest of its own first; hidden ones are at the end."""
    found = [info for info in map(_own, implementation.__mro__) if info is not None]
    hidden = {iid for info in found for iid in info.hides}
    return {info.id: info for info in sorted(found, key=lambda info: info.id in hidden)}


def missing(implementation: type) -> list[str]:
    """The methods of offered interfaces that a class leaves as the interface has them: without a body."""
    return [
        f"{info.name}.{name}"
        for info in offered(implementation).values()
        for name in info.methods
        if _own(next(kind for kind in implementation.__mro__ if name in vars(kind))) is not None
    ]


# Stubs.

Call: TypeAlias = Callable[[Method, msgspec.Struct], Answer[object]]
"""Carries out one call, in this process or in another: the method, and its arguments as fields of method.arguments."""


class _Stub:
    def __init__(self, call: Call) -> None:
        self._call = call


_STUBS: Final[dict[InterfaceId, type[_Stub]]] = {}


def stub(declared: Interface[T], call: Call) -> T:
    """An object with the methods of the interface, each of which `call` carries out."""
    info = describe(declared)
    if info.id not in _STUBS:
        _STUBS[info.id] = type(info.name, (_Stub,), {name: _calling(method) for name, method in info.methods.items()})
    return typing.cast(T, _STUBS[info.id](call))


def _calling(method: Method) -> Callable[..., Answer[object]]:
    def call(self: _Stub, *args: object, **kwargs: object) -> Answer[object]:
        return self._call(method, method.bind(args, kwargs))

    call.__name__ = method.name
    return call


def carry_out(implementation: object, method: Method, arguments: msgspec.Struct) -> Answer[object]:
    """Call the method of an object in this process, by rule 2: an Answer, or AdsError."""
    given = {name: getattr(arguments, name) for name in arguments.__struct_fields__}
    try:
        answer = getattr(implementation, method.name)(**given)
    except AdsError:
        raise
    except (Exception, SystemExit) as error:
        raise as_ads_error(error, method.name) from error
    if not isinstance(answer, Answer):
        raise AdsError(ADS_E_EXCEPTION, f"{method.name} returned {answer!r}; expected Answer(...)")
    raise_if_failed(answer.result, method.name)
    return answer
