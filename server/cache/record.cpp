#include "cache/record.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "cache/packed_normal.h"
#include "core/error.h"
#include "core/sha256.h"

namespace fogbank::cache {
namespace {

/// Appends the bytes of a number, lowest first on every machine that this runs on (x86-64, AArch64).
template <typename T>
void append(std::string& bytes, T value) {
  char buffer[sizeof(T)];
  std::memcpy(buffer, &value, sizeof(T));
  bytes.append(buffer, sizeof(T));
}

[[noreturn]] void refuse(const std::string& field, const std::string& range) {
  throw Error(ErrorKind::invalid_argument, "INVALID_RECORD", "record: " + field + " must be " + range);
}

}  // namespace

uint64_t content_id(const Vec3f& position, const Component& component, const std::string& settings,
                    uint64_t seed) {
  std::string bytes;
  // + 0 turns -0 into 0: the same place.
  for (int axis = 0; axis < 3; ++axis) append(bytes, position[axis] + 0.0f);
  append(bytes, component.medium);
  append(bytes, component.light_group);
  append(bytes, component.scattering_order);
  append(bytes, component.quantity);
  append(bytes, seed);
  bytes += settings;
  return std::stoull(sha256(bytes).substr(0, 16), nullptr, 16);
}

void validate(const Record& record) {
  if (!is_finite(record.position)) refuse("position", "finite");
  if (!is_finite(record.radiance) || min_component(record.radiance) < 0)
    refuse("radiance", "finite and not negative");
  for (const Vec3f& gradient : record.gradient)
    if (!is_finite(gradient)) refuse("gradient", "finite");
  for (const float entry : record.hessian.entries)
    if (!std::isfinite(entry)) refuse("hessian", "finite");
  if (record.component.quantity == Quantity::irradiance) {
    if (!(std::fabs(glm::length(record.normal) - 1) < 1e-3f)) refuse("normal", "a unit vector");
  } else if (record.normal != Vec3f(0)) {
    refuse("normal", "0 off surfaces");
  }
  if (!std::isfinite(record.proxy) || record.proxy < 0) refuse("proxy", "finite and not negative");
  if (record.proxy != 0 && record.component.quantity != Quantity::ratio &&
      !is_unaware(record.component.quantity))
    refuse("proxy", "0 unless the quantity is the ratio to it or the rival's");
  if (!(record.visibility_margin > 0)) refuse("visibility_margin", "positive");
  if (record.samples == 0) refuse("samples", "at least 1");
  if (!record.shape.is_valid()) refuse("shape", "of the form that its file describes");
  if (!has_shape(record.component.quantity) && !record.shape.is_even())
    refuse("shape", "even unless the quantity has one");
  if (!std::isfinite(record.variance) || record.variance < 0) refuse("variance", "finite and not negative");
}

Record canonical(const Record& record) {
  Record result = record;
  // -0 is 0, and so is what some threads' arithmetic takes for 0: the same place.
  for (int axis = 0; axis < 3; ++axis)
    if (std::fabs(result.position[axis]) < std::numeric_limits<float>::min()) result.position[axis] = 0;
  unpack_particular(pack_particular(record), result);
  result.visibility_margin = unpack_margin(pack_margin(record.visibility_margin));
  return result;
}

bool has_particular(Quantity quantity) {
  return quantity == Quantity::irradiance || quantity == Quantity::ratio || is_unaware(quantity);
}

uint32_t pack_particular(const Record& record) {
  if (record.component.quantity == Quantity::irradiance) return pack_normal(record.normal);
  return std::bit_cast<uint32_t>(record.proxy + 0.0f);
}

void unpack_particular(uint32_t packed, Record& record) {
  const bool on_surface = record.component.quantity == Quantity::irradiance;
  record.normal = on_surface ? unpack_normal(packed) : Vec3f(0);
  record.proxy = on_surface ? 0.0f : std::bit_cast<float>(packed);
}

uint16_t pack_margin(float margin) {
  return std::max<uint16_t>(static_cast<uint16_t>(std::bit_cast<uint32_t>(margin) >> 16), 1);
}

float unpack_margin(uint16_t packed) { return std::bit_cast<float>(uint32_t{packed} << 16); }

}  // namespace fogbank::cache
