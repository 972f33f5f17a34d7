#include "scene/fingerprint.h"

#include <algorithm>
#include <bit>
#include <map>

#include "core/sha256.h"

namespace fogbank::scene {
namespace {

/// Raised whenever the same description begins to mean another radiance field.
constexpr const char* format = "fogbank radiance field 1";
constexpr const char* transport_format = "fogbank transport 1";

std::string bits(double value) {
  // -0 and 0 are the same number.
  return std::to_string(std::bit_cast<uint64_t>(value == 0 ? 0.0 : value)) + " ";
}

/// The property of an emitter that all it sends out is proportional to; null where it has none.
const Property* scale_of(const ObjectDescription& emitter) {
  const Property* scale = nullptr;
  for (const char* name : {"radiance", "irradiance", "intensity", "scale"})
    if (const Property* found = emitter.find(name)) scale = found;
  return scale != nullptr && std::holds_alternative<ObjectPointer>(scale->value) ? nullptr : scale;
}

Spectrum emission_scale(const ObjectDescription& emitter) {
  const Property* scale = scale_of(emitter);
  if (scale == nullptr) return Spectrum(1);
  if (const auto* spectrum = std::get_if<Spectrum>(&scale->value)) return *spectrum;
  if (const auto* number = std::get_if<double>(&scale->value)) return Spectrum(static_cast<float>(*number));
  if (const auto* number = std::get_if<int64_t>(&scale->value)) return Spectrum(static_cast<float>(*number));
  return Spectrum(1);
}

enum class Emission : uint8_t { with_scale, without_scale };

class Canonical {
 public:
  explicit Canonical(SceneFileReader& files, Emission emission = Emission::with_scale)
      : files_(files), emission_(emission) {}

  /// Hash over hashes, each object once: a few references to references would else multiply without bound.
  const std::string& hash(const ObjectPointer& object) {
    if (const auto known = known_.find(object); known != known_.end()) return known->second;
    std::vector<std::string> lines;
    const Property* left_out = nullptr;
    if (emission_ == Emission::without_scale && object->tag == "emitter") {
      left_out = scale_of(*object);
      // What is black in a channel stays black under any factor.
      const Spectrum scale = emission_scale(*object);
      for (int channel = 0; channel < 3; ++channel)
        lines.emplace_back(scale[channel] == 0 ? "black in " + std::to_string(channel) : "");
    }
    for (const Property& property : object->properties)
      if (&property != left_out)
        lines.push_back(property.name + "\n" + std::to_string(property.value.index()) + " " +
                        value(property));
    std::sort(lines.begin(), lines.end());
    Sha256 digest;
    add(digest, object->tag);
    add(digest, object->type);
    for (const std::string& line : lines) add(digest, line);
    return known_[object] = digest.finish();
  }

  /// Lengths keep neighbouring texts apart.
  static void add(Sha256& digest, const std::string& text) {
    digest.update(std::to_string(text.size()) + ":");
    digest.update(text);
  }

 private:
  std::string value(const Property& property) {
    struct Visitor {
      Canonical& canonical;
      const Property& property;
      std::string operator()(bool v) const { return v ? "true" : "false"; }
      std::string operator()(int64_t v) const { return std::to_string(v); }
      std::string operator()(double v) const { return bits(v); }
      std::string operator()(const std::string& v) const {
        return property.name == "filename" ? canonical.files_.hash(v) : v;
      }
      std::string operator()(const Vec3d& v) const { return bits(v.x) + bits(v.y) + bits(v.z); }
      std::string operator()(const Spectrum& v) const { return (*this)(Vec3d(v)); }
      std::string operator()(const Mat4d& v) const {
        std::string text;
        for (int column = 0; column < 4; ++column)
          for (int row = 0; row < 4; ++row) text += bits(v[column][row]);
        return text;
      }
      std::string operator()(const ObjectPointer& v) const { return canonical.hash(v); }
    };
    return std::visit(Visitor{*this, property}, property.value);
  }

  SceneFileReader& files_;
  Emission emission_;
  std::map<ObjectPointer, std::string> known_;
};

/// Hashes of all that light meets, in file order, the medium around the camera among them.
std::vector<std::string> parts_of(const std::vector<ObjectPointer>& objects, Canonical& canonical) {
  std::vector<std::string> parts;
  bool has_sensor = false;
  for (const ObjectPointer& object : objects) {
    if (object->tag == "shape" || object->tag == "emitter") parts.push_back(canonical.hash(object));
    if (object->tag != "sensor" || has_sensor) continue;
    has_sensor = true;
    for (const Property& property : object->properties)
      if (const auto* nested = std::get_if<ObjectPointer>(&property.value);
          nested && (*nested)->tag == "medium")
        parts.push_back("camera in " + canonical.hash(*nested));
  }
  return parts;
}

}  // namespace

std::string radiance_fingerprint(const std::vector<ObjectPointer>& objects, SceneFileReader& files) {
  Canonical canonical(files);
  std::vector<std::string> parts = parts_of(objects, canonical);
  std::sort(parts.begin(), parts.end());
  Sha256 digest;
  Canonical::add(digest, format);
  for (const std::string& part : parts) Canonical::add(digest, part);
  return digest.finish();
}

FieldIdentity field_identity(const std::vector<ObjectPointer>& objects,
                             const std::vector<ObjectPointer>& media,
                             const std::vector<ObjectPointer>& emitters, SceneFileReader& files) {
  Canonical canonical(files, Emission::without_scale);
  FieldIdentity identity;
  Sha256 digest;
  Canonical::add(digest, transport_format);
  for (const std::string& part : parts_of(objects, canonical)) Canonical::add(digest, part);
  for (const ObjectPointer& medium : media) Canonical::add(digest, "medium " + canonical.hash(medium));
  for (const ObjectPointer& emitter : emitters) identity.emission.push_back(emission_scale(*emitter));
  identity.transport = digest.finish();
  return identity;
}

}  // namespace fogbank::scene
