"""Stand-ins, made by code, for the textures and meshes of the GUISS paper, which only its authors have."""
