"""TOML text gives back the settings that it was made from."""

from __future__ import annotations

import tomllib

from descriptions import DESCRIPTIONS
from hypothesis import given
from hypothesis import settings as examples
from icymoon.settings import description as settings
from icymoon.settings import toml_text


@examples(max_examples=25)  # of hundreds of numbers each
@given(DESCRIPTIONS)
def test_toml_gives_back_what_was_written(description):
    canonical = settings.check(description, "test")
    assert settings.check(tomllib.loads(toml_text.to_toml(canonical)), "test") == canonical
