#include "service/names.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <mutex>
#include <random>

#include "service/limits.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace {

bool is_hexadecimal(std::string_view text) {
  return std::ranges::all_of(text, [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

std::string parse_name(const std::string& name, std::string_view collection, size_t digits) {
  const std::string prefix = std::string(collection) + "/";
  if (!name.starts_with(prefix) || name.size() != prefix.size() + digits ||
      !is_hexadecimal(std::string_view(name).substr(prefix.size()))) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_NAME",
                   "\"" + name.substr(0, 100) + "\" is not a name of the form " + prefix + "{" +
                       std::to_string(digits) + " hexadecimal digits}",
                   {{"name", name}});
  }
  return name.substr(prefix.size());
}

}  // namespace

void check_request_id(const std::string& request_id) {
  const bool valid =
      !request_id.empty() && request_id.size() <= 64 && std::ranges::all_of(request_id, [](char c) {
        return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' ||
               c == '_';
      });
  if (!valid) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_REQUEST_ID",
                   "request_id must be 1 to 64 characters of [A-Za-z0-9_-]", {{"field", "request_id"}});
  }
}

void check_sha256(const std::string& sha256) {
  if (sha256.size() != 64 || !is_hexadecimal(sha256)) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_SHA256",
                   "sha256 must be 64 lower-case hexadecimal digits", {{"sha256", sha256}});
  }
}

std::string parse_scene_name(const std::string& name) { return parse_name(name, "scenes", 64); }
std::string scene_name(const std::string& id) { return "scenes/" + id; }
std::string parse_job_name(const std::string& name) { return parse_name(name, "jobs", 24); }
std::string parse_replica_name(const std::string& name) { return parse_name(name, "replicas", 24); }
std::string replica_name(const std::string& id) { return "replicas/" + id; }
std::string parse_cache_name(const std::string& name) { return parse_name(name, "caches", 64); }
std::string cache_name(const std::string& fingerprint) { return "caches/" + fingerprint; }
std::string job_name(const std::string& id) { return "jobs/" + id; }

std::string new_job_id() {
  static std::mutex mutex;
  static std::random_device random;
  static int64_t last = 0;
  const std::lock_guard lock(mutex);
  const int64_t now = std::chrono::duration_cast<std::chrono::microseconds>(
                          std::chrono::system_clock::now().time_since_epoch())
                          .count();
  last = std::max(now, last + 1);  // strictly growing even when the machine's clock is set back
  const uint64_t entropy = ((uint64_t{random()} << 32) | random()) & 0xff'ffff'ffffu;
  char text[32];
  std::snprintf(text, sizeof text, "%014llx%010llx", static_cast<unsigned long long>(last),
                static_cast<unsigned long long>(entropy));
  return text;
}

void check_logical_path(const std::string& path, const std::string& field) {
  auto refuse = [&](const std::string& why) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_MANIFEST", field + ": path " + why,
                   {{"field", field}, {"path", path}});
  };
  if (path.empty()) refuse("is empty");
  if (path.size() > static_cast<size_t>(limits::max_path_bytes)) {
    refuse("is longer than " + std::to_string(limits::max_path_bytes) + " bytes");
  }
  for (const char c : path) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) refuse("contains a control character");
    if (c == '\\') refuse("contains a backslash; parts are separated by '/'");
  }
  size_t begin = 0;
  while (true) {
    const size_t end = std::min(path.find('/', begin), path.size());
    const std::string_view part = std::string_view(path).substr(begin, end - begin);
    if (part.empty()) refuse("has an empty part or begins or ends with '/'");
    if (part == "." || part == "..") refuse("has a part that is '.' or '..'");
    if (end == path.size()) break;
    begin = end + 1;
  }
}

int effective_page_size(int requested) {
  if (requested < 0) {
    throw RpcError(grpc::StatusCode::INVALID_ARGUMENT, "INVALID_PAGE_SIZE", "page_size must not be negative",
                   {{"field", "page_size"}});
  }
  if (requested == 0) return static_cast<int>(limits::default_page_size);
  return std::min(requested, static_cast<int>(limits::max_page_size));
}

}  // namespace fogbank::service
