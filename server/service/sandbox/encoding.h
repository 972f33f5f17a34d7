// What the reading process and the server tell each other, as bytes. The server trusts none of those that
// come from the reading process, which a hostile file may have taken over.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "core/error.h"
#include "scene/loader.h"
#include "scene/scene_file_reader.h"
#include "scene/xml/parser.h"

namespace fogbank::service {

/// Bytes that no reader of ours writes.
class BadMessage : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class RequestKind : uint32_t { parse, references, mesh, image };
/// `exists` and `open` are questions of the reading process while it parses; the others are its answers.
enum class AnswerKind : uint32_t { exists, open, scene, references, mesh, image, error };

struct ParseRequest {
  std::string main_path;
  scene::LoadOptions options;
};
struct MeshRequest {
  scene::MeshFileRequest file;
  SourceLocation where;
};
struct ImageRequest {
  std::string path;
  bool raw = false;
  SourceLocation where;
};

std::string encode(const ParseRequest& request);
std::string encode(const MeshRequest& request);
std::string encode(const ImageRequest& request);
std::string encode(const scene::ParsedScene& scene);
std::string encode(const std::vector<std::string>& texts);
/// `where` of a SceneError is kept.
std::string encode(const Error& error);

// All of these throw BadMessage.
ParseRequest decode_parse_request(std::string_view bytes);
MeshRequest decode_mesh_request(std::string_view bytes);
ImageRequest decode_image_request(std::string_view bytes);
/// Objects nest at most as deep as the parser lets them, without cycles; texts are UTF-8.
scene::ParsedScene decode_scene(std::string_view bytes);
std::vector<std::string> decode_texts(std::string_view bytes);
[[noreturn]] void throw_decoded_error(std::string_view bytes);

/// Precedes a mesh's arrays: positions, normals, uvs, triangles.
struct MeshHeader {
  uint64_t positions = 0;
  uint64_t normals = 0;
  uint64_t uvs = 0;
  uint64_t triangles = 0;
  uint64_t dropped_triangles = 0;
  uint64_t faceted = 0;

  /// Of the arrays.
  uint64_t bytes() const;
};
MeshHeader header_of(const scene::Mesh& mesh);
/// Throws BadMessage for counts that no mesh has.
void check(const MeshHeader& header);
/// Throws BadMessage unless indices are in range and numbers finite.
void check(const scene::Mesh& mesh);

/// Precedes an image's values.
struct ImageHeader {
  int32_t width = 0;
  int32_t height = 0;
  int32_t channels = 0;
  uint32_t is_bytes = 0;  ///< values of 8 bits, else floats

  uint64_t values() const;
};
ImageHeader header_of(const scene::Image& image);
void check(const ImageHeader& header);
/// Fills in what follows from the values, and throws BadMessage unless they are finite.
void complete(scene::Image& image, bool raw);

}  // namespace fogbank::service
