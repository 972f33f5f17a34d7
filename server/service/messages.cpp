#include "service/messages.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/util/json_util.h>
#include <google/protobuf/util/time_util.h>

#include <chrono>

#include "core/files.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace {
constexpr int64_t max_message_file_bytes = 64 << 20;
}

std::string canonical_bytes(const google::protobuf::Message& message) {
  std::string bytes;
  {
    google::protobuf::io::StringOutputStream stream(&bytes);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.SetSerializationDeterministic(true);
    message.SerializeToCodedStream(&coded);
  }
  return bytes;
}

void write_message(const std::filesystem::path& path, const google::protobuf::Message& message) {
  google::protobuf::util::JsonPrintOptions options;
  options.add_whitespace = true;
  options.preserve_proto_field_names = true;
  std::string text;
  const auto status = google::protobuf::util::MessageToJsonString(message, &text, options);
  if (!status.ok()) throw RpcError(grpc::StatusCode::INTERNAL, "INTERNAL_ERROR", status.ToString());
  write_file_durably(path, text);
}

void read_message(const std::filesystem::path& path, google::protobuf::Message& message) {
  google::protobuf::util::JsonParseOptions options;
  options.ignore_unknown_fields = true;  // written by a newer version
  const auto status =
      google::protobuf::util::JsonStringToMessage(read_file(path, max_message_file_bytes), &message, options);
  if (!status.ok()) {
    throw RpcError(grpc::StatusCode::INTERNAL, "STORAGE_ERROR",
                   path.filename().string() + " in the data directory is damaged: " + status.ToString());
  }
}

google::protobuf::Timestamp timestamp_now() {
  // TimeUtil::GetCurrentTime of this protobuf version knows whole seconds only.
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return google::protobuf::util::TimeUtil::NanosecondsToTimestamp(
      std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
}

}  // namespace fogbank::service
