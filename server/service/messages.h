// Protobuf messages in files and as keys.
#pragma once

#include <google/protobuf/message.h>
#include <google/protobuf/timestamp.pb.h>

#include <filesystem>
#include <string>

namespace fogbank::service {

/// Bytes that are the same for equal messages (maps in the order of their keys).
std::string canonical_bytes(const google::protobuf::Message& message);

/// Written as JSON, durably. Throws as `write_file_durably`.
void write_message(const std::filesystem::path& path, const google::protobuf::Message& message);

/// Throws RpcError STORAGE_ERROR when the file can't be read or is no such message.
void read_message(const std::filesystem::path& path, google::protobuf::Message& message);

/// The time now.
google::protobuf::Timestamp timestamp_now();

}  // namespace fogbank::service
