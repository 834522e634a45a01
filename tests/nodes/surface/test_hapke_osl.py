"""The compiled shader of Hapke's law."""

from icymoon.nodes.surface import hapke_osl


def test_every_compilation_gives_the_same_code_without_a_folder_of_this_machine():
    codes = set()
    for _ in range(2):
        hapke_osl.compile_source.cache_clear()
        codes.add(hapke_osl.compile_source())
    (code,) = codes
    assert code.startswith("OpenShadingLanguage")
    assert "shader hapke" in code
    assert hapke_osl.SOURCE.name not in code
    assert "stdosl.h" not in code
    assert "/tmp" not in code
