// Readers of mesh files. Each takes the file's bytes; `where` is the shape element, for messages.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "core/error.h"
#include "scene/mesh.h"

namespace fogbank::scene {

struct MeshReadOptions {
  std::string path;              ///< the file's logical path, for messages
  bool face_normals = false;     ///< drop vertex normals
  bool flip_tex_coords = false;  ///< v becomes 1 - v
  /// Vertex normals are computed anew, and edges whose faces meet at more than this many degrees stay sharp.
  std::optional<double> max_smooth_angle_degrees;
};

/// Meshes in the file's own space. `normals` is empty where the file has none and `max_smooth_angle_degrees`
/// is not given: `complete_vertex_normals` (mesh_normals.h) makes them once the mesh is in world space.
/// Triangles of no area are left out and counted in `Mesh::dropped_triangles`. All throw SceneError:
/// DAMAGED_MESH for malformed or truncated bytes, indices out of range or values that are not finite;
/// EMPTY_MESH without a triangle; resource_exhausted "TOO_MANY_TRIANGLES" above LoadLimits::triangles,
/// checked before memory is spent.

/// Wavefront OBJ: all groups and objects as one mesh, polygons triangulated; materials are ignored.
Mesh read_obj(const std::string& bytes, const MeshReadOptions& options, const SourceLocation& where);
/// PLY 1.0, ascii or binary of either byte order; vertex properties x y z, nx ny nz, u v (or s t, or
/// texture_u texture_v).
Mesh read_ply(const std::string& bytes, const MeshReadOptions& options, const SourceLocation& where);
/// Mitsuba's .serialized (versions 3 and 4); `shape_index` counts from 0. Throws SHAPE_INDEX_OUT_OF_RANGE.
Mesh read_serialized(const std::string& bytes, int64_t shape_index, const MeshReadOptions& options,
                     const SourceLocation& where);

struct MeshFileRequest;
/// By the request's type.
Mesh read_mesh(const std::string& bytes, const MeshFileRequest& request, const SourceLocation& where);

}  // namespace fogbank::scene
