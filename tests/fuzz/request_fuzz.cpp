// Requests of every rpc, as the descriptors have them: whatever they say, the answer is a canonical code with
// a reason, never INTERNAL, and the server goes on. It is the whole server, with its jobs, caches and
// replicas.
#include <algorithm>
#include <cstring>

#include "fuzz.h"
#include "request_call.h"
#include "request_server.h"
#include "service/rpc_error.h"

#include "google/rpc/status.pb.h"

using namespace fogbank;

namespace {

std::unique_ptr<fuzz::RequestServer> server;

void check(const grpc::Status& status) {
  switch (status.error_code()) {
    case grpc::StatusCode::OK:
    case grpc::StatusCode::CANCELLED:
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return;
    default:
      break;
  }
  google::rpc::Status details;
  const bool parsed = details.ParseFromString(status.error_details());
  const std::string reason = parsed ? service::reason_of(details) : "";
  const bool canonical = status.error_code() != grpc::StatusCode::INTERNAL &&
                         status.error_code() != grpc::StatusCode::UNKNOWN &&
                         status.error_code() != grpc::StatusCode::UNAVAILABLE;
  if (!canonical || reason.empty() || reason == "SCENE_READER_CRASHED")
    std::fprintf(stderr, "code %d, %s: %s\n", status.error_code(), reason.c_str(),
                 status.error_message().c_str());
  fuzz::require(canonical, "a request is refused for what it says");
  fuzz::require(!reason.empty(), "an error has a reason");
  fuzz::require(reason != "SCENE_READER_CRASHED", "files are read to their end");
}

}  // namespace

int LLVMFuzzerInitialize(int*, char***) {
  server = std::make_unique<fuzz::RequestServer>();
  std::atexit([] { server.reset(); });
  return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes = fuzz::bytes_of(data, size);
  if (!fuzz::parse_call(bytes)) return -1;  // not worth a place in the corpus
  auto call = fuzz::parse_call(server->with_names(bytes));
  if (!call) return -1;
  check(server->call(*call));
  return 0;
}

/// Bytes that libFuzzer changes at random are hardly ever a message.
extern "C" size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size, size_t most, unsigned int seed) {
  RandomStream random(seed, 0, 0, 0);
  auto call = fuzz::parse_call(fuzz::bytes_of(data, size));
  if (!call || random.next_uint() % 16 == 0) call = fuzz::random_call(random);
  for (uint32_t changes = 1 + random.next_uint() % 4; changes > 0; --changes) fuzz::mutate(*call, random);
  const std::string changed = fuzz::serialize(*call);
  if (changed.size() > most) return size;
  std::memcpy(data, changed.data(), changed.size());
  return changed.size();
}
