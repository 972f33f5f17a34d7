// Checks and names shared by all services.
#pragma once

#include <string>
#include <string_view>

namespace fogbank::service {

/// Throws RpcError INVALID_REQUEST_ID unless 1 to 64 characters of [A-Za-z0-9_-].
void check_request_id(const std::string& request_id);

/// Throws RpcError INVALID_SHA256 unless 64 lower-case hexadecimal digits.
void check_sha256(const std::string& sha256);

/// "scenes/{64 hexadecimal digits}" -> the digits. Throws RpcError INVALID_NAME.
std::string parse_scene_name(const std::string& name);
std::string scene_name(const std::string& id);

/// "jobs/{24 hexadecimal digits}" -> the digits. Throws RpcError INVALID_NAME.
std::string parse_job_name(const std::string& name);
std::string job_name(const std::string& id);

/// "replicas/{24 hexadecimal digits}" -> the digits. Throws RpcError INVALID_NAME.
std::string parse_replica_name(const std::string& name);
std::string replica_name(const std::string& id);

/// "caches/{64 hexadecimal digits}" -> the digits. Throws RpcError INVALID_NAME.
std::string parse_cache_name(const std::string& name);
std::string cache_name(const std::string& fingerprint);

/// A new job id, unused in this process: 14 digits of creation time in microseconds, so that ids sort by age,
/// and 10 random ones.
std::string new_job_id();

/// Throws RpcError INVALID_MANIFEST, naming `field`, unless `path` is a safe logical path: relative, parts
/// separated by '/', none of them empty, "." or "..", no backslash, no control character, at most
/// max_path_bytes.
void check_logical_path(const std::string& path, const std::string& field);

/// Page size to use. Throws RpcError INVALID_PAGE_SIZE for a negative one.
int effective_page_size(int requested);

}  // namespace fogbank::service
