// The scene file as typed objects, before anything is built from it: one `ObjectDescription` per plugin
// element, with defaults, references, includes and old syntax already resolved. Folders above (`transport`)
// build their objects from these, so that a new BSDF or emitter is one new file there and the loader does not
// change.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/error.h"
#include "core/vector.h"

namespace fogbank::scene {

struct ObjectDescription;
using ObjectPointer = std::shared_ptr<const ObjectDescription>;

/// bool `<boolean>`, int64 `<integer>`, double `<float>`, string (a `filename` is already a logical path),
/// Vec3d `<point>`/`<vector>`, Spectrum
/// `<rgb>`/`<spectrum>` (already linear sRGB), Mat4d `<transform>`, object (a nested plugin or a resolved
/// `<ref>`).
using PropertyValue = std::variant<bool, int64_t, double, std::string, Vec3d, Spectrum, Mat4d, ObjectPointer>;

struct Property {
  std::string name;  ///< "" for a nested object without a name
  PropertyValue value;
  SourceLocation where;
};

/// One plugin element, e.g. `<bsdf type="roughplastic" id="floor">`. A `<ref>` to it shares the pointer.
struct ObjectDescription {
  std::string tag;   ///< bsdf, shape, emitter, texture, medium, phase, sensor, film, rfilter, sampler,
                     ///< integrator, volume
  std::string type;  ///< plugin name
  std::string id;    ///< "" when it has none
  SourceLocation where;
  std::vector<Property> properties;  ///< in file order

  const Property* find(std::string_view name) const;
};

/// Typed reading of one object's properties that remembers what was read, so that `finish` can refuse what
/// was not. Every getter throws SceneError naming file, line, element and property when the type is wrong, or
/// the value is not finite or out of the stated range.
class PropertyReader {
 public:
  explicit PropertyReader(const ObjectDescription& object);

  const ObjectDescription& object() const { return object_; }
  bool has(std::string_view name) const;

  bool boolean(std::string_view name, bool fallback);
  int64_t integer(std::string_view name, int64_t fallback, int64_t lowest, int64_t highest);
  /// `<float>` or `<integer>`; a one-valued `<spectrum>`/`<rgb>` is accepted too (old files write it so).
  double number(std::string_view name, double fallback, double lowest, double highest);
  std::optional<double> number_if_given(std::string_view name, double lowest, double highest);
  std::string text(std::string_view name, const std::string& fallback);
  /// As `text`, but must be one of `choices`.
  std::string choice(std::string_view name, const std::string& fallback,
                     const std::vector<std::string>& choices);
  Vec3d vector(std::string_view name, const Vec3d& fallback);
  /// `<rgb>`, `<spectrum>` or `<float>`; each channel within [lowest, highest].
  Spectrum spectrum(std::string_view name, const Spectrum& fallback, float lowest, float highest);
  Mat4d transform(std::string_view name);  ///< identity when absent
  /// Nested object called `name`, null when absent; throws when its tag is not `tag`.
  ObjectPointer child(std::string_view name, std::string_view tag);
  /// All nested objects with this tag whatever their name, in file order.
  std::vector<ObjectPointer> children(std::string_view tag);
  /// Raw access (a property that may be a number or a texture).
  const PropertyValue* raw(std::string_view name);

  [[noreturn]] void fail(const std::string& reason, const std::string& message) const;
  [[noreturn]] void fail_at(std::string_view property, const std::string& reason,
                            const std::string& message) const;

  /// Throws (or, if `warnings` is given, i.e. lenient loading, appends a warning) for every property that was
  /// never read.
  void finish(std::vector<std::string>* warnings = nullptr);

 private:
  const Property* take(std::string_view name);

  const ObjectDescription& object_;
  std::vector<bool> used_;
  std::set<std::string, std::less<>> known_;  ///< every name that was asked for: what `finish` offers instead
};

}  // namespace fogbank::scene
