// Calls of rpcs as bytes, for the target `request`: the line "fogbank.v1.RenderService/CreateJob", then each
// request message with its length in front, as protobuf's delimited streams have it.
#pragma once

#include <google/protobuf/message.h>

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/random.h"

namespace fogbank::fuzz {

struct Call {
  const google::protobuf::MethodDescriptor* method = nullptr;
  std::vector<std::unique_ptr<google::protobuf::Message>> requests;  ///< one, unless the client streams
};

/// Every rpc of the wire contract, by its descriptors.
const std::vector<const google::protobuf::MethodDescriptor*>& all_methods();

/// Nullopt for what isn't a call: no rpc of ours, or messages that protobuf refuses, before the server sees
/// them.
std::optional<Call> parse_call(const std::string& bytes);
std::string serialize(const Call& call);

/// Names and ids that stand for what only the running server knows; it puts those of the same length in their
/// place. tests/faults/test_requests.py has the same.
namespace placeholder {
inline const std::string scene(64, '2');
inline const std::string cache(64, '3');
inline const std::string blob(64, '4');
inline const std::string ended_job(24, '5');
inline const std::string leased_job(24, '1');
inline const std::string replica(24, '6');
inline const std::string build(16, '7');
inline const std::string request_id(16, '8');
inline const std::string entry_hash(64, '9');
}  // namespace placeholder

/// Changes one field of one message, or adds or drops a message of a stream.
void mutate(Call& call, RandomStream& random);
/// An rpc with a few fields set.
Call random_call(RandomStream& random);

}  // namespace fogbank::fuzz
