#include "cache/record_bytes.h"

#include <cmath>

#include "core/error.h"

namespace fogbank::cache {

namespace {

void append_vector(std::string& bytes, const Vec3f& vector) {
  for (int axis = 0; axis < 3; ++axis) append_bytes(bytes, vector[axis]);
}

Vec3f take_vector(ByteReader& bytes) {
  Vec3f vector;
  for (int axis = 0; axis < 3; ++axis) vector[axis] = bytes.take<float>();
  return vector;
}

}  // namespace

void refuse_poisoned(const std::string& why) {
  throw Error(ErrorKind::invalid_argument, "POISONED_RESULT", "unusable bytes: " + why);
}

uint32_t take_count(ByteReader& bytes, size_t smallest) {
  const auto count = bytes.take<uint32_t>();
  if (!bytes.ok() || count > bytes.left() / smallest) refuse_poisoned("it ends too soon");
  return count;
}

void expect_end(const ByteReader& bytes) {
  if (!bytes.ok()) refuse_poisoned("it ends too soon");
  if (bytes.left() > 0) refuse_poisoned("it is longer than it says");
}

void append_component(std::string& bytes, const Component& component) {
  append_bytes(bytes, component.medium);
  append_bytes(bytes, component.light_group);
  append_bytes(bytes, component.scattering_order);
  append_bytes(bytes, static_cast<uint8_t>(component.quantity));
}

Component take_component(ByteReader& bytes) {
  Component component;
  component.medium = bytes.take<int32_t>();
  component.light_group = bytes.take<uint16_t>();
  component.scattering_order = bytes.take<uint8_t>();
  const auto quantity = bytes.take<uint8_t>();
  if (!bytes.ok()) refuse_poisoned("it ends too soon");
  if (quantity > static_cast<uint8_t>(last_quantity))
    refuse_poisoned("there is no quantity " + std::to_string(quantity));
  component.quantity = static_cast<Quantity>(quantity);
  return component;
}

void append_wish(std::string& bytes, const Wish& wish) {
  append_vector(bytes, wish.position);
  append_vector(bytes, wish.normal);
  append_component(bytes, wish.component);
}

Wish take_wish(ByteReader& bytes) {
  Wish wish;
  wish.position = take_vector(bytes);
  wish.normal = take_vector(bytes);
  wish.component = take_component(bytes);
  if (!is_finite(wish.position)) refuse_poisoned("a position is not finite");
  const float length = glm::length(wish.normal);
  const bool on_surface = wish.component.quantity == Quantity::irradiance;
  if (on_surface ? !(std::fabs(length - 1) < 1e-3f) : length != 0)
    refuse_poisoned("a normal is not what its quantity asks for");
  return wish;
}

void append_wish(std::string& bytes, const SpacedWish& wish) {
  append_wish(bytes, wish.wish);
  append_bytes(bytes, wish.spacing);
}

SpacedWish take_spaced_wish(ByteReader& bytes) {
  SpacedWish wish{.wish = take_wish(bytes), .spacing = bytes.take<float>()};
  if (!bytes.ok()) refuse_poisoned("it ends too soon");
  if (!(wish.spacing > 0) || !std::isfinite(wish.spacing)) refuse_poisoned("a spacing is not positive");
  return wish;
}

void append_record(std::string& bytes, const Record& record) {
  append_bytes(bytes, record.id);
  append_vector(bytes, record.position);
  append_component(bytes, record.component);
  append_vector(bytes, record.radiance);
  for (const Vec3f& gradient : record.gradient) append_vector(bytes, gradient);
  for (const float entry : record.hessian.entries) append_bytes(bytes, entry);
  append_vector(bytes, record.normal);
  append_bytes(bytes, record.proxy);
  for (const uint8_t code : record.depth.codes) append_bytes(bytes, code);
  append_bytes(bytes, record.visibility_margin);
  append_bytes(bytes, record.samples);
  append_bytes(bytes, record.variance);
  if (has_shape(record.component.quantity)) append_bytes(bytes, record.shape);
}

Record take_record(ByteReader& bytes) {
  Record record;
  record.id = bytes.take<uint64_t>();
  record.position = take_vector(bytes);
  record.component = take_component(bytes);
  record.radiance = take_vector(bytes);
  for (Vec3f& gradient : record.gradient) gradient = take_vector(bytes);
  for (float& entry : record.hessian.entries) entry = bytes.take<float>();
  record.normal = take_vector(bytes);
  record.proxy = bytes.take<float>();
  for (uint8_t& code : record.depth.codes) code = bytes.take<uint8_t>();
  record.visibility_margin = bytes.take<float>();
  record.samples = bytes.take<uint32_t>();
  record.variance = bytes.take<float>();
  if (has_shape(record.component.quantity)) record.shape = bytes.take<DirectionalShape>();
  if (!bytes.ok()) refuse_poisoned("it ends too soon");
  try {
    validate(record);
  } catch (const Error& error) {
    refuse_poisoned(error.what());
  }
  return record;
}

void append_record(std::string& bytes, const std::optional<Record>& record) {
  append_bytes(bytes, static_cast<uint8_t>(record.has_value()));
  if (record) append_record(bytes, *record);
}

std::optional<Record> take_optional_record(ByteReader& bytes) {
  const auto flag = bytes.take<uint8_t>();
  if (!bytes.ok() || flag > 1) refuse_poisoned("a flag is neither 0 nor 1");
  return flag != 0 ? std::optional(take_record(bytes)) : std::nullopt;
}

}  // namespace fogbank::cache
