"""All settings of a scene, as one type: ``settings.terrain.hurst`` is a number that the type checker knows.

A description is plain data: each table is a dictionary, and a partial description, such as a preset's, has the same
types and lacks some of the tables and keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_type_hints

from .camera import CalibrationErrorSettings, LeftEyeSettings, RightEyeSettings, RigSettings, SensorSettings
from .data_set import DatasetSettings
from .declaration import AttributeDict, Parts, Table, Topic
from .excavation import ExcavationSettings
from .ground import HillsSettings, MeshSettings, SourceSettings, TerrainSettings
from .lander import ArmSettings, LanderSettings, WorkspaceSettings
from .landforms import (
    ChaosSettings,
    CracksSettings,
    CratersSettings,
    HollowsSettings,
    MantleSettings,
    PenitentesSettings,
    PitsSettings,
    RidgesSettings,
    TalusSettings,
)
from .light import LightSettings, VeilSettings
from .rendering import QualitySettings
from .rocks import RocksSettings
from .surfaces import HapkeSettings, RockSurfaceSettings, SurfaceSettings, TexturesSettings


class Settings(AttributeDict):
    """All settings of a scene, in the order of the sidebar."""

    __slots__ = ()
    source: SourceSettings
    terrain: TerrainSettings
    mesh: MeshSettings
    ridges: RidgesSettings
    cracks: CracksSettings
    chaos: ChaosSettings
    craters: CratersSettings
    hollows: HollowsSettings
    penitentes: PenitentesSettings
    pits: PitsSettings
    hills: HillsSettings
    mantle: MantleSettings
    talus: TalusSettings
    excavation: ExcavationSettings
    surface: SurfaceSettings
    hapke: HapkeSettings
    textures: TexturesSettings
    rocks: RocksSettings
    rock_surface: RockSurfaceSettings
    light: LightSettings
    veil: VeilSettings
    rig: RigSettings
    left_eye: LeftEyeSettings
    right_eye: RightEyeSettings
    calibration_error: CalibrationErrorSettings
    lander: LanderSettings
    arm: ArmSettings
    workspace: WorkspaceSettings
    sensor: SensorSettings
    quality: QualitySettings
    dataset: DatasetSettings


#: The type of each table, by topic. Landforms of plug-ins have none.
TABLES: dict[str, type[Table]] = get_type_hints(Settings)
#: The type of each entry, by topic and key of a list of tables.
ENTRIES: dict[str, dict[str, type[Table]]] = {
    topic: {setting.key: setting.entry for setting in table.fields if setting.entry} for topic, table in TABLES.items()}
#: Our own topics, from which the manual's pages are made.
OUR_TOPICS: dict[str, Topic] = {key: table.topic for key, table in TABLES.items()}


def typed(tables: Parts) -> Settings:
    """A copy of a description whose tables and entries of lists have their declared types."""
    return Settings({topic: copy_typed_table(topic, values) for topic, values in tables.items()})


def copy_typed_table(topic: str, values: Mapping[str, Any]) -> AttributeDict:
    """A copy of one table with its declared type. The table of an unknown topic keeps undeclared keys."""
    table: AttributeDict = TABLES.get(topic, AttributeDict)(values)
    for key, entry in ENTRIES.get(topic, {}).items():
        if key in table:
            table[key] = [entry(each) for each in table[key]]
    return table
