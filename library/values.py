"""What every stored value has in common: frozen, camelCase in JSON, checked, with refusals an operator understands."""

import re
from datetime import UTC, datetime
from typing import Annotated, Any, Self

from annotated_types import Ge, Gt, Le, Lt
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from library.errors import InvalidValue
from library.names import normal

MAX_NAME = 128
MAX_RECIPE_ID = 160
MAX_TEXT = 4000

_UNSTORABLE = re.compile(r"[\x00\ud800-\udfff]")
_INVISIBLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")


def check_text(text: str, field: str, longest: int = MAX_TEXT) -> str:
    """Return ``text``, or raise InvalidValue if a database or a foreign client could not give it back unchanged."""
    problem = _text_problem(text, longest)
    if problem:
        raise InvalidValue(field, text, problem)
    return text


def check_name(name: str, field: str, longest: int = MAX_NAME) -> str:
    """Return ``name`` in normal form, or raise InvalidValue.

    Names are parts of node addresses, so no ``/`` and nothing invisible.
    """
    problem = _name_problem(name, longest)
    if problem:
        raise InvalidValue(field, name, problem)
    return normal(name)


def as_utc(moment: datetime) -> datetime:
    """Return ``moment`` in UTC; one without a zone is taken to be UTC already, as OPC UA means it."""
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def now() -> datetime:
    """Return the time in UTC."""
    return datetime.now(UTC)


def _text_problem(text: str, longest: int) -> str:
    if len(text) > longest:
        return f"at most {longest} characters are allowed, these are {len(text)}"
    if _UNSTORABLE.search(text):
        return "text must not hold NUL characters or lone surrogates"
    return ""


def _name_problem(name: str, longest: int) -> str:
    if len(name) > longest:
        return _text_problem(name, longest)
    if not name or name != name.strip():
        return f"a name has 1 to {longest} characters and no space at either end"
    if _INVISIBLE.search(name) or "/" in name:
        return "a name must not hold '/' or control characters"
    return _text_problem(name, longest)


def _valid_name(name: str) -> str:
    return normal(_or_refuse(name, _name_problem(name, MAX_NAME)))


def _valid_recipe_id(name: str) -> str:
    return normal(_or_refuse(name, _name_problem(name, MAX_RECIPE_ID)))


def _valid_text(text: str) -> str:
    return _or_refuse(text, _text_problem(text, MAX_TEXT))


def _or_refuse(text: str, problem: str) -> str:
    if problem:
        raise ValueError(problem)
    return text


Name = Annotated[str, Field(min_length=1, max_length=MAX_NAME), AfterValidator(_valid_name)]
RecipeId = Annotated[str, Field(min_length=1, max_length=MAX_RECIPE_ID), AfterValidator(_valid_recipe_id)]
Text = Annotated[str, Field(max_length=MAX_TEXT), AfterValidator(_valid_text)]
Moment = Annotated[datetime, AfterValidator(as_utc)]


class Value(BaseModel):
    """A frozen value. Python names are snake_case, JSON keys camelCase; unknown keys, NaN and infinity are refused.

    Whatever is wrong is raised as InvalidValue, which names the field, shows the value and says what is allowed.
    """

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        alias_generator=to_camel,
        validate_by_name=True,
        validate_by_alias=True,
        allow_inf_nan=False,
        protected_namespaces=(),
    )

    def __init__(self, **fields: Any) -> None:
        try:
            super().__init__(**fields)
        except ValidationError as error:
            raise _refusal(type(self), error) from None

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the value written as JSON in ``text``, or raise InvalidValue."""
        try:
            return cls.model_validate_json(text)
        except ValidationError as error:
            raise _refusal(cls, error) from None

    def to_json(self) -> str:
        """Return the value as JSON; a float is written with the fewest digits that give the same bits back."""
        return self.model_dump_json(by_alias=True)


def _refusal(value_type: type[Value], error: ValidationError) -> InvalidValue:
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"]) or "content"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    message = first["msg"].removeprefix("Value error, ")
    message = _range(value_type, first["loc"], first["type"]) or message[:1].lower() + message[1:]
    return InvalidValue(place, first["input"], message + more)


def _range(value_type: type[Value], place: tuple[int | str, ...], problem: str) -> str:
    """Return the whole range of a number where only one end of it was passed."""
    if len(place) != 1 or problem not in {"greater_than", "greater_than_equal", "less_than", "less_than_equal"}:
        return ""
    words = {Ge: "at least {0.ge:g}", Gt: "above {0.gt:g}", Le: "at most {0.le:g}", Lt: "below {0.lt:g}"}
    fields = {alias: field for name, field in value_type.model_fields.items() for alias in (name, field.alias)}
    limits = [words[type(limit)].format(limit) for limit in fields[str(place[0])].metadata if type(limit) in words]
    return f"it has to be {' and '.join(limits)}"
