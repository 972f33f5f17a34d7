#include "scene/fingerprint.h"

#include <algorithm>
#include <bit>
#include <map>

namespace fogbank::scene {
namespace {

/// Raised whenever the same description begins to mean another radiance field.
constexpr const char* format = "fogbank radiance field 1";

std::string bits(double value) {
  // -0 and 0 are the same number.
  return std::to_string(std::bit_cast<uint64_t>(value == 0 ? 0.0 : value)) + " ";
}

class Canonical {
 public:
  explicit Canonical(ContentHashes& hashes) : hashes_(hashes) {}

  /// Hash over hashes, each object once: a few references to references would else multiply without bound.
  const std::string& hash(const ObjectPointer& object) {
    if (const auto known = known_.find(object); known != known_.end()) return known->second;
    std::vector<std::string> lines;
    for (const Property& property : object->properties)
      lines.push_back(property.name + "\n" + std::to_string(property.value.index()) + " " + value(property));
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
        return property.name == "filename" ? canonical.hashes_.hash(v) : v;
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

  ContentHashes& hashes_;
  std::map<ObjectPointer, std::string> known_;
};

}  // namespace

std::string radiance_fingerprint(const std::vector<ObjectPointer>& objects, ContentHashes& hashes) {
  Canonical canonical(hashes);
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
  std::sort(parts.begin(), parts.end());
  Sha256 digest;
  Canonical::add(digest, format);
  for (const std::string& part : parts) Canonical::add(digest, part);
  return digest.finish();
}

}  // namespace fogbank::scene
