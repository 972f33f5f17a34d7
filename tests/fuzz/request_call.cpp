#include "request_call.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/util/delimited_message_util.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <sstream>

// Of libFuzzer.
extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);

namespace fogbank::fuzz {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::MethodDescriptor;
using google::protobuf::Reflection;

namespace {

constexpr size_t most_requests = 8;  ///< of a stream
constexpr size_t most_text_bytes = 512;
constexpr int deepest = 6;  ///< submessage that is descended into

std::map<std::string, const MethodDescriptor*> find_methods() {
  std::map<std::string, const MethodDescriptor*> methods;
  std::istringstream files(FOGBANK_PROTOCOL_FILES);
  for (std::string file; std::getline(files, file, ',');) {
    const auto* const description = google::protobuf::DescriptorPool::generated_pool()->FindFileByName(file);
    for (int s = 0; description != nullptr && s < description->service_count(); ++s) {
      const auto* const service = description->service(s);
      for (int m = 0; m < service->method_count(); ++m)
        methods.emplace(service->full_name() + "/" + service->method(m)->name(), service->method(m));
    }
  }
  return methods;
}

const std::map<std::string, const MethodDescriptor*>& methods_by_name() {
  static const std::map<std::string, const MethodDescriptor*> methods = find_methods();
  return methods;
}

std::unique_ptr<Message> new_request(const MethodDescriptor& method) {
  const Message* const prototype =
      google::protobuf::MessageFactory::generated_factory()->GetPrototype(method.input_type());
  return std::unique_ptr<Message>(prototype->New());
}

size_t pick(RandomStream& random, size_t count) { return random.next_uint() % count; }

template <typename Values>
auto one_of(RandomStream& random, const Values& values) {
  return values[pick(random, std::size(values))];
}

int64_t integer(RandomStream& random) {
  static constexpr std::array<int64_t, 14> extremes = {
      0, 1, -1, 2, 7, 8, 255, 4096, 1 << 20, INT32_MAX, INT32_MIN, int64_t{UINT32_MAX}, INT64_MAX, INT64_MIN};
  if (pick(random, 4) == 0) return static_cast<int64_t>(pick(random, 64));
  return one_of(random, extremes);
}

double number(RandomStream& random) {
  static const std::array<double, 14> extremes = {0.0,   -0.0, 1.0,   -1.0, 0.5,  0.1,      1e-320,
                                                  1e-30, 1e30, 1e308, 60.0, 1e-3, INFINITY, std::nan("")};
  return one_of(random, extremes);
}

/// What was there, changed by libFuzzer.
std::string changed(std::string bytes) {
  const size_t size = std::min(bytes.size(), most_text_bytes);
  bytes.resize(most_text_bytes);
  bytes.resize(LLVMFuzzerMutate(reinterpret_cast<uint8_t*>(bytes.data()), size, bytes.size()));
  return bytes;
}

std::string text(RandomStream& random, const std::string& before) {
  static const std::vector<std::string> known = {"",
                                                 "x",
                                                 "../../etc/passwd",
                                                 "scene.xml",
                                                 "volpath",
                                                 "radiance-cache",
                                                 "photon-beams",
                                                 "\xe2\x80\xae\n\x1b[2J",
                                                 "scenes/" + placeholder::scene,
                                                 "caches/" + placeholder::cache,
                                                 placeholder::blob,
                                                 "jobs/" + placeholder::ended_job,
                                                 "jobs/" + placeholder::leased_job,
                                                 placeholder::leased_job + "-0",
                                                 "replicas/" + placeholder::replica,
                                                 placeholder::build,
                                                 placeholder::request_id,
                                                 placeholder::entry_hash};
  if (pick(random, 3) != 0) return one_of(random, known);
  std::string bytes = changed(before);
  for (char& byte : bytes) byte = static_cast<char>(byte & 0x7f);  // or protobuf refuses it
  return bytes;
}

/// Sets a field that is no message to something; appends to one that is repeated.
void put(Message& message, const FieldDescriptor& field, RandomStream& random) {
  const Reflection& reflection = *message.GetReflection();
  const bool repeated = field.is_repeated();
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32: {
      const auto value = static_cast<int32_t>(integer(random));
      repeated ? reflection.AddInt32(&message, &field, value) : reflection.SetInt32(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_UINT32: {
      const auto value = static_cast<uint32_t>(integer(random));
      repeated ? reflection.AddUInt32(&message, &field, value)
               : reflection.SetUInt32(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_INT64: {
      const int64_t value = integer(random);
      repeated ? reflection.AddInt64(&message, &field, value) : reflection.SetInt64(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_UINT64: {
      const auto value = static_cast<uint64_t>(integer(random));
      repeated ? reflection.AddUInt64(&message, &field, value)
               : reflection.SetUInt64(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_DOUBLE: {
      const double value = number(random);
      repeated ? reflection.AddDouble(&message, &field, value)
               : reflection.SetDouble(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_FLOAT: {
      // 1e308 becomes an infinity without undefined behaviour of the conversion.
      const double wide = number(random);
      const float value = std::abs(wide) > std::numeric_limits<float>::max()
                              ? std::numeric_limits<float>::infinity()
                              : static_cast<float>(wide);
      repeated ? reflection.AddFloat(&message, &field, value) : reflection.SetFloat(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_BOOL: {
      const bool value = pick(random, 2) == 0;
      repeated ? reflection.AddBool(&message, &field, value) : reflection.SetBool(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_ENUM: {
      const auto count = static_cast<size_t>(field.enum_type()->value_count());
      const size_t index = pick(random, count + 1);
      const int value = index == count ? 99 : field.enum_type()->value(static_cast<int>(index))->number();
      repeated ? reflection.AddEnumValue(&message, &field, value)
               : reflection.SetEnumValue(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_STRING: {
      const std::string before = repeated ? "" : reflection.GetString(message, &field);
      const std::string value =
          field.type() == FieldDescriptor::TYPE_BYTES ? changed(before) : text(random, before);
      repeated ? reflection.AddString(&message, &field, value)
               : reflection.SetString(&message, &field, value);
      return;
    }
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return;
  }
}

void mutate(Message& message, RandomStream& random, int depth) {
  const int fields = message.GetDescriptor()->field_count();
  if (fields == 0) return;
  const FieldDescriptor& field =
      *message.GetDescriptor()->field(static_cast<int>(pick(random, static_cast<size_t>(fields))));
  const Reflection& reflection = *message.GetReflection();
  const bool is_message = field.cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
  const size_t choice = pick(random, 8);
  if (is_message && depth >= deepest) return;
  if (!field.is_repeated()) {
    if (choice == 0) {
      reflection.ClearField(&message, &field);
    } else if (is_message) {
      mutate(*reflection.MutableMessage(&message, &field), random, depth + 1);
    } else {
      put(message, field, random);
    }
    return;
  }
  const int size = reflection.FieldSize(message, &field);
  const bool add = size == 0 || choice < 2;
  if (!add) {
    const int element = static_cast<int>(pick(random, static_cast<size_t>(size)));
    if (is_message && choice < 7) {
      mutate(*reflection.MutableRepeatedMessage(&message, &field, element), random, depth + 1);
      return;
    }
    reflection.SwapElements(&message, &field, element, size - 1);
    reflection.RemoveLast(&message, &field);
    if (choice == 7) return;
  }
  if (is_message) {
    mutate(*reflection.AddMessage(&message, &field), random, depth + 1);
  } else {
    put(message, field, random);
  }
}

}  // namespace

const std::vector<const MethodDescriptor*>& all_methods() {
  static const std::vector<const MethodDescriptor*> methods = [] {
    std::vector<const MethodDescriptor*> found;
    for (const auto& [name, method] : methods_by_name()) found.push_back(method);
    return found;
  }();
  return methods;
}

std::optional<Call> parse_call(const std::string& bytes) {
  const size_t line = bytes.find('\n');
  const auto method = methods_by_name().find(bytes.substr(0, line));
  if (line == std::string::npos || method == methods_by_name().end()) return std::nullopt;
  Call call{.method = method->second, .requests = {}};
  google::protobuf::io::ArrayInputStream stream(bytes.data() + line + 1,
                                                static_cast<int>(bytes.size() - line - 1));
  for (bool ended = false; !ended;) {
    auto request = new_request(*call.method);
    if (google::protobuf::util::ParseDelimitedFromZeroCopyStream(request.get(), &stream, &ended)) {
      call.requests.push_back(std::move(request));
    } else if (!ended) {
      return std::nullopt;
    }
  }
  const bool enough = call.method->client_streaming() || call.requests.size() == 1;
  return enough && call.requests.size() <= most_requests ? std::optional(std::move(call)) : std::nullopt;
}

std::string serialize(const Call& call) {
  std::ostringstream bytes;
  bytes << call.method->service()->full_name() << '/' << call.method->name() << '\n';
  for (const auto& request : call.requests)
    google::protobuf::util::SerializeDelimitedToOstream(*request, &bytes);
  return bytes.str();
}

void mutate(Call& call, RandomStream& random) {
  if (call.method->client_streaming()) {
    const size_t choice = pick(random, 8);
    if (call.requests.empty() || (choice == 0 && call.requests.size() < most_requests)) {
      call.requests.push_back(new_request(*call.method));
    } else if (choice == 1) {
      call.requests.pop_back();
      return;
    }
  }
  mutate(*call.requests[pick(random, call.requests.size())], random, 0);
}

Call random_call(RandomStream& random) {
  Call call{.method = one_of(random, all_methods()), .requests = {}};
  call.requests.push_back(new_request(*call.method));
  for (size_t i = 0; i < 4; ++i) mutate(*call.requests[0], random, 0);
  return call;
}

}  // namespace fogbank::fuzz
