#include "service/reference_image.h"

#include "core/error.h"
#include "core/files.h"
#include "render/exr_reader.h"
#include "service/field_errors.h"
#include "service/names.h"
#include "service/rpc_error.h"

namespace fogbank::service {

std::shared_ptr<const render::ReferenceImage> load_reference(const std::string& sha256,
                                                             const scene::Window& window, BlobStore& blobs) {
  check_sha256(sha256);
  blobs.query(sha256);  // counts as a use
  const auto blob = blobs.find_intact(sha256);
  if (!blob) {
    throw RpcError(grpc::StatusCode::FAILED_PRECONDITION, "BLOBS_MISSING",
                   "the reference image is not uploaded", {{"sha256", sha256}});
  }
  try {
    return std::make_shared<const render::ReferenceImage>(render::ReferenceImage{
        .window = window, .rgb = render::decode_rgb(read_file(blob->path, blob->size), window)});
  } catch (const Error& error) {
    refuse_field("settings.reference_sha256", error.what());
  }
}

}  // namespace fogbank::service
