#include "service/sandbox/reader.h"

#include <new>

#include "scene/image_reader.h"
#include "service/sandbox/encoding.h"

namespace fogbank::service {
namespace {

void answer(const Socket& server, AnswerKind kind, std::string_view bytes) {
  server.send_value(MessageHeader{.kind = static_cast<uint32_t>(kind), .bytes = bytes.size()});
  server.send(bytes);
}

/// Files that the server opens.
class ServerFiles final : public scene::FileSource {
 public:
  explicit ServerFiles(const Socket& server) : server_(server) {}

  bool exists(const std::string& path) const override {
    answer(server_, AnswerKind::exists, path);
    return server_.receive_value<uint8_t>() != 0;
  }
  std::string read(const std::string& path) const override {
    answer(server_, AnswerKind::open, path);
    if (server_.receive_value<uint8_t>() != 0) return scene::read_opened_file(server_.receive_file(), path);
    std::string error(server_.receive_value<uint64_t>(), '\0');
    server_.receive(error.data(), error.size());
    throw_decoded_error(error);
  }

 private:
  const Socket& server_;
};

void answer(const Socket& server, const scene::Mesh& mesh) {
  const MeshHeader header = header_of(mesh);
  server.send_value(MessageHeader{.kind = static_cast<uint32_t>(AnswerKind::mesh),
                                  .bytes = sizeof header + header.bytes()});
  server.send_value(header);
  server.send(mesh.positions.data(), mesh.positions.size() * sizeof(Vec3f));
  server.send(mesh.normals.data(), mesh.normals.size() * sizeof(Vec3f));
  server.send(mesh.uvs.data(), mesh.uvs.size() * sizeof(Vec2f));
  server.send(mesh.triangles.data(), mesh.triangles.size() * sizeof(Vec3u));
}

void answer(const Socket& server, const scene::Image& image) {
  const ImageHeader header = header_of(image);
  const size_t bytes = image.bytes.size() + image.data.size() * sizeof(float);
  server.send_value(
      MessageHeader{.kind = static_cast<uint32_t>(AnswerKind::image), .bytes = sizeof header + bytes});
  server.send_value(header);
  server.send(image.bytes.data(), image.bytes.size());
  server.send(image.data.data(), image.data.size() * sizeof(float));
}

void perform(const Socket& server, RequestKind kind, const std::string& bytes) {
  switch (kind) {
    case RequestKind::parse: {
      const ParseRequest request = decode_parse_request(bytes);
      ServerFiles files(server);
      answer(server, AnswerKind::scene,
             encode(scene::parse_scene(request.main_path, files, request.options)));
      return;
    }
    case RequestKind::references: {
      const ParseRequest request = decode_parse_request(bytes);
      answer(server, AnswerKind::references,
             encode(scene::list_references(request.main_path, std::make_shared<ServerFiles>(server),
                                           request.options)));
      return;
    }
    case RequestKind::mesh: {
      const MeshRequest request = decode_mesh_request(bytes);
      const std::string file = scene::read_opened_file(server.receive_file(), request.file.options.path);
      answer(server, scene::read_mesh(file, request.file, request.where));
      return;
    }
    case RequestKind::image: {
      const ImageRequest request = decode_image_request(bytes);
      const std::string file = scene::read_opened_file(server.receive_file(), request.path);
      answer(server, scene::read_image(file, request.path, request.raw, request.where));
      return;
    }
  }
}

}  // namespace

void read_scene_files(const Socket& server) {
  try {
    while (true) {
      const auto header = server.receive_value<MessageHeader>();
      std::string bytes(header.bytes, '\0');
      server.receive(bytes.data(), bytes.size());
      try {
        perform(server, static_cast<RequestKind>(header.kind), bytes);
      } catch (const Error& error) {
        answer(server, AnswerKind::error, encode(error));
      } catch (const std::bad_alloc&) {
        answer(server, AnswerKind::error,
               encode(Error(ErrorKind::resource_exhausted, "FILE_TAKES_TOO_MUCH_MEMORY",
                            "reading the file takes more memory than a scene's file may")));
      }
    }
  } catch (const SocketClosed&) {  // the scene is loaded
  }
}

}  // namespace fogbank::service
