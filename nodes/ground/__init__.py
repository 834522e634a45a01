"""The ground and its rocks as meshes."""
