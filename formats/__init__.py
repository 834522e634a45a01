"""File formats, read and written from their bytes: meshes, GeoTIFF, OpenEXR, lines of TOML."""
