// Vertex normals that the file does not give.
#pragma once

#include "scene/mesh.h"

namespace fogbank::scene {

/// Gives every vertex without a normal (all of them when `mesh.normals` is empty, else those whose entry is
/// zero) the mean of its faces' normals weighted by the angle each face has at the vertex (Thuermer and
/// Wuethrich 1998, "Computing Vertex Normals from Polygonal Facets"). Vertices without a face get +z. Leaves
/// faceted meshes alone.
///
/// Mitsuba 3.9.1 does this for obj, ply and serialized meshes without normals unless `face_normals` is set,
/// after `to_world` was applied (so that the normals of a mirrored mesh follow its mirrored vertex order) and
/// for vertices as they are indexed (so a texture seam is a crease). Found by experiment; the test holds its
/// numbers.
void complete_vertex_normals(Mesh& mesh);

/// Computes all normals anew, with a crease wherever neighbouring faces' normals differ by more than
/// `degrees`: vertices are duplicated there. Faces are neighbours at a position, whether or not they share
/// the vertex.
void smooth_up_to_angle(Mesh& mesh, double degrees);

}  // namespace fogbank::scene
