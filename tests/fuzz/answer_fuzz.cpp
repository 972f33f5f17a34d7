// What a process that reads scene files, and that a hostile file has taken over, may tell the server.
#include "fuzz.h"
#include "service/sandbox/encoding.h"

using namespace fogbank;

namespace {

/// False where the bytes are refused as they should be.
template <typename Action>
bool decodes(const Action& action) {
  try {
    action();
    return true;
  } catch (const service::BadMessage&) {
    return false;
  } catch (const Error& error) {
    return !error.reason().empty();
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes = fuzz::bytes_of(data, size);
  decodes([&] {
    const std::string again = service::encode(service::decode_scene(bytes));
    fuzz::require(service::encode(service::decode_scene(again)) == again, "a scene reads back the same");
  });
  decodes([&] { service::decode_texts(bytes); });
  decodes([&] { service::throw_decoded_error(bytes); });
  decodes([&] { service::decode_mesh_request(bytes); });
  decodes([&] { service::decode_parse_request(bytes); });
  return 0;
}
