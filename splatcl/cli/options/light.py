"""``--light``: a light as a text, such as kind=spot,vector=0:2:1,direction=0:-1:0,shadow=pcf (docs/guide/lights.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Annotated, Any

from cyclopts import Parameter

from splatcl.cli.options.groups import SETTINGS
from splatcl.errors import SettingsError
from splatcl.scene.lights import Light
from splatcl.scene.settings import RenderSettings

VECTORS = ("vector", "color", "direction")
WORDS = ("kind", "shadow")
NAMES = tuple(field.name for field in fields(Light))

LightOption = Annotated[
    list[str] | None,
    Parameter(
        group=SETTINGS,
        consume_multiple=False,
        metavar="LIGHT",
        help="Light such as kind=point,vector=0:2:1,shadow=pcf (docs/guide/lights.md). "
        "Repeat the option for each light. These lights replace all others.",
    ),
]


def light_changes(texts: Sequence[str] | None) -> dict[str, Any]:
    """Return the setting that the texts of ``--light`` give, if there are any."""
    return {"lights": tuple(map(parse_light, texts))} if texts else {}


def parse_light(text: str) -> Light:
    """Return the light that NAME=VALUE,NAME=VALUE... describes.

    Raises
    ------
    SettingsError
        The text is no light; the message quotes it.
    """
    given: dict[str, Any] = {}
    try:
        for part in text.split(","):
            name, _, value = (word.strip() for word in part.partition("="))
            if not name or not value:
                raise SettingsError(f"{part!r} must be NAME=VALUE")
            if name not in NAMES:
                raise SettingsError(f"a light has no {name!r}; it has {', '.join(NAMES)}")
            if name in given:
                raise SettingsError(f"{name} appears twice; give it once")
            given[name] = _value(name, value)
        light = Light(**given)
        RenderSettings(lights=(light,))
    except SettingsError as error:
        raise SettingsError(f"--light {text}: {error}") from None
    return light


def _value(name: str, text: str) -> Any:
    if name in WORDS or (name == "bias" and text == "auto"):
        return text
    try:
        numbers = tuple(map(float, text.split(":")))
    except ValueError:
        numbers = ()
    if len(numbers) != (3 if name in VECTORS else 1):
        wanted = "three numbers such as 0:1.5:2" if name in VECTORS else "a number"
        raise SettingsError(f"{name} {text!r} must be {wanted}")
    if name in VECTORS:
        return numbers
    return int(numbers[0]) if name == "map_size" and numbers[0].is_integer() else numbers[0]
