"""Opens a landed day, a simulated mission whose steps your program chooses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..support.errors import IcyMoonError

if TYPE_CHECKING:
    from ..stereo.landed_day.day import LandedDay


#: Largest number of a ground. It is limited because all grounds before it are drawn too.
_MAX_NUMBER = 99_999


def open_landed_day(
    number: int = 0,
    seed: int = 0,
    method: str = "sgbm",
    *,
    ground: str | Path | None = None,
    lander: Mapping[str, Mapping[str, Any]] | str | Path | None = None,
    rules: str | Path | None = None,
    most_energy_wh: float = 1000.0,
) -> LandedDay:
    """Open a day on the ground of this number. Its steps are ``step("look")``, ``step("choose")``, ``step("dig")``, ….

    Equal arguments and steps give equal observations, to the bit. ``method`` is the lander's matcher, as in
    ``evaluate``. ``ground`` is a preset or a TOML file from which the grounds take their terrain and rocks; by default
    they are several gentle terrains. ``lander`` are changes by topic, or a preset or TOML file, of its camera, sensor,
    workspace, scoop and place on the moon. ``rules`` is a file of rules for sites, and ``most_energy_wh`` the energy in
    Wh that the day may spend. Close the day, or use it by ``with``. Raises IcyMoonError for unknown names and values
    out of range, and for ground that rays cannot make.
    """
    # Matchers and rays are imported here, so that ``import icymoon`` stays fast.
    from ..settings.description import check
    from ..settings.preset_files import load_named
    from ..stereo.decisions.rules import read_rules
    from ..stereo.design.default_lander import GENTLE_TERRAINS
    from ..stereo.design.made_workspaces import draw_recipes
    from ..stereo.landed_day.day import LandedDay
    from ..stereo.landed_day.episodes import change_lander, draw_start, read_method
    from ..stereo.learning.grounds import Variety
    from ..stereo.training_data import read_ground

    for name, value in (("number", number), ("seed", seed)):
        if not isinstance(value, int) or not 0 <= value <= _MAX_NUMBER:
            raise IcyMoonError(f"The {name} is {value!r}; give a whole number from 0 to {_MAX_NUMBER}.")
    matcher = read_method(method)
    own = None if ground is None else read_ground(str(ground), "ground ")
    changes = load_named(str(lander)) if isinstance(lander, str | Path) else check(dict(lander or {}), "lander")
    changed = change_lander(changes)
    recipe = draw_recipes(seed, "ground", number + 1, Variety(GENTLE_TERRAINS, own=own))[-1]
    asked = read_rules(None if rules is None else Path(rules))
    return LandedDay(recipe, draw_start(changed, recipe), matcher, most_energy_wh, asked)
