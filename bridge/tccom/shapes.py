"""What types look like to whoever calls an interface, so that two declarations can be compared: a fingerprint.

Rule 1: what a caller could notice counts: names, order, types, limits, defaults, members of enumerations. Names of classes,
titles and docstrings do not.
Rule 2: the fingerprint is made of our own text, not of a library's schema: it survives an update of the library on one side.
"""

import hashlib
from collections.abc import Sequence

import msgspec
from msgspec import inspect


def fingerprint(methods: Sequence[tuple[str, type[msgspec.Struct], object]]) -> str:
    """16 hexadecimal digits for a table of methods: name, parameters as a struct, output. TypeError for a type without a
    plain form.
    """
    shapes = [(name, _shape(arguments, ()), _shape(output, ())) for name, arguments, output in methods]
    text = msgspec.json.encode(shapes, order="sorted")
    return hashlib.sha256(text).hexdigest()[:16]


def _shape(kind: object, inside: tuple[object, ...]) -> object:
    return _of(inspect.type_info(kind), inside)


def _of(value: object, inside: tuple[object, ...]) -> object:
    match value:
        case inspect.StructType() | inspect.DataclassType() | inspect.TypedDictType() | inspect.NamedTupleType():
            if value.cls in inside:
                return ["again", inside.index(value.cls)]
            inner = (*inside, value.cls)
            tag = getattr(value, "tag", None)
            return ["record", tag, [[one.encode_name, _of(one.type, inner), _default(one)] for one in value.fields]]
        case inspect.EnumType():
            return ["enum", sorted((member.value for member in value.cls), key=str)]
        case inspect.UnionType():
            return ["union", sorted((_of(one, inside) for one in value.types), key=msgspec.json.encode)]
        case inspect.Metadata():
            return _of(value.type, inside)
        case inspect.CustomType():
            if value.cls is not object:
                raise TypeError(f"{value.cls.__name__} has no plain form that could be sent")
            return "AnyType"
        case inspect.Type():
            told = {name: _of(getattr(value, name), inside) for name in value.__struct_fields__}
            return [type(value).__name__, {name: one for name, one in told.items() if one not in (None, [])}]
        case tuple():
            return [_of(one, inside) for one in value]
        case _:
            return value


def _default(field: inspect.Field) -> object:
    if field.required:
        return "required"
    made = field.default_factory
    return msgspec.to_builtins([field.default if made is msgspec.NODEFAULT or made is None else made()])
