#include "cache/record.h"

#include <cstring>

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
  if (!is_finite(record.normal)) refuse("normal", "finite");
  if (!std::isfinite(record.proxy) || record.proxy < 0) refuse("proxy", "finite and not negative");
  if (!(record.visibility_margin > 0)) refuse("visibility_margin", "positive");
  if (record.samples == 0) refuse("samples", "at least 1");
  if (!std::isfinite(record.variance) || record.variance < 0) refuse("variance", "finite and not negative");
}

}  // namespace fogbank::cache
