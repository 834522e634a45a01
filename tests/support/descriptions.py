"""Any description that the table of settings admits, for hypothesis."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st
from icymoon.settings.table import TOPICS
from icymoon.settings.topics.declaration import Setting


def _values(setting: Setting) -> st.SearchStrategy[Any]:
    if setting.kind == "bool":
        return st.booleans()
    if setting.kind == "choice":
        return st.sampled_from([c[0] for c in setting.choices])
    if setting.kind == "text":
        listed = {
            "mark": ["", "none", "-9999", "1e30"],
            "decimal": ["", "0", "-12.5", "1305031102.175304000"],
            "factors": ["", "0", "1, 0.5"],
            "coordinate": ["", "-12.5", "+0.30000000000000004"],
        }
        return st.sampled_from(listed[setting.trust]) if setting.trust in listed else st.text(max_size=30)
    if setting.kind == "list":
        return st.lists(st.fixed_dictionaries({s.key: _values(s) for s in setting.entries}), max_size=2)
    if setting.kind == "int":
        return st.integers(int(setting.minimum), int(setting.maximum))
    return st.floats(setting.minimum, setting.maximum)


#: Complete descriptions, every setting within its limits.
DESCRIPTIONS = st.fixed_dictionaries(
    {topic.key: st.fixed_dictionaries({s.key: _values(s) for s in topic.settings}) for topic in TOPICS.values()}
)
