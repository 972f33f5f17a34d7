// The reference image that a job reports its true error against.
#pragma once

#include <memory>
#include <string>

#include "render/render_settings.h"
#include "service/blob_store.h"
#include "service/sandbox/reader_host.h"

namespace fogbank::service {

/// From an uploaded EXR file, read in a process of its own. Throws RpcError INVALID_SHA256, BLOBS_MISSING,
/// and INVALID_SETTINGS of the field settings.reference_sha256 for a file that is no EXR with R, G, B in
/// exactly this window.
std::shared_ptr<const render::ReferenceImage> load_reference(const std::string& sha256,
                                                             const scene::Window& window, BlobStore& blobs,
                                                             ReaderHost& readers);

}  // namespace fogbank::service
