"""Ground as meshes and height maps, without Blender.

The mesh of procedural ground that is graded for the cameras is made in these steps, see ``graded_mesh``:

1. ``vertex_spacing`` measures how far apart vertices may be at every distance, and ``vertex_rings`` places them.
2. ``cut_along_lines`` cuts triangles along crests. Then the vertices are raised to the ground.
3. ``finer_in_view`` determines the size of triangles that the cameras see, and ``split_triangles`` cuts them.
4. ``break_walls`` breaks chips out of steep triangles.

Two further modules refine other meshes: ``hole_for_trench`` makes room for the fine patch of a trench, and
``halve_edges`` cuts the triangles of a mesh from a file, which then carries relief.
"""
