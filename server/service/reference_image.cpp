#include "service/reference_image.h"

#include "core/error.h"
#include "core/files.h"
#include "scene/exr_header.h"
#include "scene/texture_library.h"
#include "service/field_errors.h"
#include "service/names.h"
#include "service/rpc_error.h"
#include "service/sandbox/sandboxed_files.h"

namespace fogbank::service {
namespace {

constexpr const char* field = "settings.reference_sha256";

std::vector<float> read_rgb(const BlobStore::Blob& blob, const scene::Window& window, ReaderHost& readers) {
  // The server reads the window itself, since images of scenes have none.
  constexpr int64_t most_header_bytes = 1 << 20;
  const scene::ExrSize size = scene::read_exr_size(read_range(blob.path, 0, most_header_bytes));
  if (!size.is_valid) refuse_field(field, "it is no OpenEXR image");
  if (size.x != window.x || size.y != window.y || size.width != window.width || size.height != window.height)
    refuse_field(field, "its data window is another one");
  SandboxedFiles files(readers, scene::blob_source({{"reference.exr", blob.path.string()}}));
  scene::Image image =
      files.image("reference.exr", true, {.file = "the reference image", .line = 0, .element = ""});
  const size_t values = static_cast<size_t>(window.width) * static_cast<size_t>(window.height) * 3;
  if (image.channels != 3 || image.data.size() != values) refuse_field(field, "it has no channels R, G, B");
  return std::move(image.data);
}

}  // namespace

std::shared_ptr<const render::ReferenceImage> load_reference(const std::string& sha256,
                                                             const scene::Window& window, BlobStore& blobs,
                                                             ReaderHost& readers) {
  check_sha256(sha256);
  blobs.query(sha256);  // counts as a use
  const auto blob = blobs.find_intact(sha256);
  if (!blob) {
    throw RpcError(grpc::StatusCode::FAILED_PRECONDITION, "BLOBS_MISSING",
                   "the reference image is not uploaded", {{"sha256", sha256}});
  }
  try {
    return std::make_shared<const render::ReferenceImage>(
        render::ReferenceImage{.window = window, .rgb = read_rgb(*blob, window, readers)});
  } catch (const Error& error) {
    refuse_field(field, error.what());
  }
}

}  // namespace fogbank::service
