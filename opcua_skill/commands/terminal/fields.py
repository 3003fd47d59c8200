"""Words a person wrote, turned into one of the client's values, field by field."""

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

Made = TypeVar("Made")


def made_of(kind: type[Made], given: Mapping[str, Any]) -> Made:
    """Return a dataclass from named fields; raises ValueError that names the field and what it should be."""
    names = [field.name for field in dataclasses.fields(kind)]  # pyright: ignore[reportArgumentType]
    for name in given:
        if name not in names:
            raise ValueError(f"{name or 'a field without a name'} is unknown: there are {', '.join(names)}")
    try:
        return TypeAdapter(kind).validate_python(dict(given))
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
