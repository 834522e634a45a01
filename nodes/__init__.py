"""What is made: meshes, materials, lights. Builders take plain settings and return data-blocks."""
