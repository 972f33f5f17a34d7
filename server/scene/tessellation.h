// Shapes that are meshes without a file.
#pragma once

#include "scene/mesh.h"

namespace fogbank::scene {

/// The square [-1, 1]^2 at z = 0, normal +z, uv = (x + 1, y + 1) / 2.
Mesh rectangle_mesh();

/// The cube [-1, 1]^3 with outward normals; every face has uv in [0, 1]^2, laid out as Mitsuba's.
Mesh cube_mesh();

/// Moves a mesh. Normals follow by the inverse transpose. A mirroring transform turns triangles inside out;
/// where the mesh has normals the order of vertices is then reversed, so that both still agree.
void transform_mesh(Mesh& mesh, const Mat4d& to_world);

/// Sum of the triangles' areas.
double surface_area(const Mesh& mesh);

}  // namespace fogbank::scene
