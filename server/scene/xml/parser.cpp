#include "scene/xml/parser.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "scene/text.h"
#include "scene/xml/expand.h"
#include "scene/xml/file_locator.h"
#include "scene/xml/schema.h"
#include "scene/xml/spectrum.h"
#include "scene/xml/transform.h"
#include "scene/xml/values.h"

namespace fogbank::scene {
namespace {

/// Candidates for a "did you mean" are compared one by one, so only so many are.
constexpr size_t most_suggestions = 2000;

[[noreturn]] void fail(const XmlElement& element, const std::string& reason, const std::string& message) {
  throw SceneError(ErrorKind::invalid_argument, reason, element.where, message);
}

template <typename T>
T required_value(const XmlElement& element, const std::optional<T>& value, const char* what) {
  if (!value)
    fail(element, "INVALID_VALUE",
         std::string("'value' must be ") + what + ", is " + quote(element.get("value")));
  return *value;
}

double finite(const XmlElement& element, double value) {
  if (!std::isfinite(value))
    fail(element, "NOT_FINITE", "'value' must be finite, is " + quote(element.get("value")));
  return value;
}

Spectrum finite(const XmlElement& element, const Spectrum& value) {
  // Also catches what is finite as a double and not as a float.
  if (!is_finite(value))
    fail(element, "NOT_FINITE", "'value' must be finite, is " + quote(element.get("value")));
  return value;
}

/// Builds descriptions from the expanded tree on demand, so that references may point forwards.
class DescriptionBuilder {
 public:
  DescriptionBuilder(const XmlElement& scene, const std::vector<SceneAlias>& aliases, FileLocator& locator,
                     bool is_lenient, std::vector<std::string>& warnings)
      : scene_(scene), locator_(locator), is_lenient_(is_lenient), warnings_(warnings) {
    for (const XmlElement& child : scene.children) index(child);
    for (const SceneAlias& alias : aliases) add_alias(alias);
  }

  std::vector<ObjectPointer> build() {
    std::vector<ObjectPointer> objects;
    check_attributes(scene_, is_lenient_, warnings_);
    for (const XmlElement& child : scene_.children) {
      if (is_plugin_tag(child.tag)) {
        objects.push_back(object(child, false));
      } else if (child.tag == "ref") {
        objects.push_back(referenced(child));
      } else if (!accepts_tag(child)) {
        continue;
      } else {
        fail(child, "MISPLACED_ELEMENT", "may not stand directly in <scene>");
      }
    }
    if (missing_file_) throw SceneError(*missing_file_);
    return objects;
  }

 private:
  void index(const XmlElement& element) {
    if (is_plugin_tag(element.tag))
      if (const std::string* id = element.find("id")) {
        const auto [entry, is_new] = by_id_.emplace(*id, &element);
        if (!is_new) duplicate_id(*id, entry->second->where, element.where);
      }
    for (const XmlElement& child : element.children) index(child);
  }

  void add_alias(const SceneAlias& alias) {
    const auto target = by_id_.find(alias.id);
    if (target == by_id_.end()) unknown_id(alias.id, alias.where);
    const auto [entry, is_new] = by_id_.emplace(alias.as, target->second);
    if (!is_new) duplicate_id(alias.as, entry->second->where, alias.where);
  }

  [[noreturn]] void duplicate_id(const std::string& id, const SourceLocation& first,
                                 const SourceLocation& second) const {
    throw SceneError(
        ErrorKind::invalid_argument, "DUPLICATE_ID", second,
        "id " + quote(id) + " is already used at " + first.file + ":" + std::to_string(first.line));
  }

  [[noreturn]] void unknown_id(const std::string& id, const SourceLocation& where) const {
    std::vector<std::string> ids;
    for (const auto& entry : by_id_) {
      if (ids.size() == most_suggestions) break;
      ids.push_back(entry.first);
    }
    throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_ID", where,
                     "there is no object with id " + quote(id) + did_you_mean(id, ids));
  }

  /// False (lenient, with a warning) for an element that the language doesn't have.
  bool accepts_tag(const XmlElement& element) {
    if (is_known_tag(element.tag)) return true;
    const std::vector<std::string> tags = known_tags();
    if (!is_lenient_)
      fail(element, "UNKNOWN_ELEMENT",
           "unknown element; supported: " + list_names(tags) + did_you_mean(element.tag, tags));
    warnings_.push_back(element.where.to_string() + ": unknown element is ignored");
    return false;
  }

  ObjectPointer referenced(const XmlElement& ref) {
    check_attributes(ref, is_lenient_, warnings_);
    const std::string& id = required_attribute(ref, "id");
    const auto found = by_id_.find(id);
    if (found == by_id_.end()) unknown_id(id, ref.where);
    if (open_.count(found->second)) fail(ref, "REFERENCE_CYCLE", "object " + quote(id) + " refers to itself");
    return object(*found->second, false);
  }

  ObjectPointer object(const XmlElement& element, bool within_emitter) {
    if (const auto built = built_.find(&element); built != built_.end()) return built->second;
    if (open_.size() >= static_cast<size_t>(LoadLimits::depth)) too_deep(element);
    check_attributes(element, is_lenient_, warnings_);
    open_.insert(&element);
    auto description = std::make_shared<ObjectDescription>();
    description->tag = element.tag;
    description->type = required_attribute(element, "type");
    description->id = element.get("id");
    description->where = element.where;
    for (const XmlElement& child : element.children)
      add_property(*description, child, within_emitter || element.tag == "emitter");
    if (element.is_legacy && element.tag == "shape") complete_legacy_shape(*description);
    open_.erase(&element);
    note_depth(*description, element);
    built_.emplace(&element, description);
    return description;
  }

  [[noreturn]] static void too_deep(const XmlElement& element) {
    throw SceneError(
        ErrorKind::resource_exhausted, "XML_TOO_DEEP", element.where,
        "objects are nested more than " + std::to_string(LoadLimits::depth) + " deep through references");
  }

  /// An object may refer to one that is complete already, and that to another, for as long as the file goes
  /// on; whatever walks down objects later must come to an end on its stack.
  void note_depth(const ObjectDescription& description, const XmlElement& element) {
    int depth = 1;
    for (const Property& property : description.properties)
      if (const auto* nested = std::get_if<ObjectPointer>(&property.value)) {
        const auto known = depths_.find(nested->get());
        depth = std::max(depth, 1 + (known == depths_.end() ? 1 : known->second));
      }
    if (depth > LoadLimits::depth) too_deep(element);
    depths_[&description] = depth;
  }

  /// In 0.x, a shape with a medium and without a BSDF is an index-matched boundary; since 2.0 it is diffuse.
  static void complete_legacy_shape(ObjectDescription& shape) {
    bool has_bsdf = false;
    bool has_medium = false;
    for (const Property& property : shape.properties)
      if (const auto* nested = std::get_if<ObjectPointer>(&property.value)) {
        has_bsdf = has_bsdf || (*nested)->tag == "bsdf";
        has_medium = has_medium || (*nested)->tag == "medium";
      }
    if (has_bsdf || !has_medium) return;
    auto boundary = std::make_shared<ObjectDescription>();
    boundary->tag = "bsdf";
    boundary->type = "null";
    boundary->where = shape.where;
    shape.properties.push_back({"", ObjectPointer(boundary), shape.where});
  }

  void add_property(ObjectDescription& parent, const XmlElement& element, bool within_emitter) {
    std::optional<PropertyValue> value = read_value(parent, element, within_emitter);
    if (!value) return;
    const std::string& name = element.get("name");
    if (name.empty() && !std::holds_alternative<ObjectPointer>(*value))
      fail(element, "MISSING_ATTRIBUTE", "attribute 'name' is missing");
    if (!name.empty() && parent.find(name)) {
      if (!is_lenient_)
        fail(element, "DUPLICATE_PARAMETER",
             "parameter " + quote(name) + " is already given in line " +
                 std::to_string(parent.find(name)->where.line));
      warnings_.push_back(element.where.to_string() + ": given twice; the first one counts");
      return;
    }
    parent.properties.push_back({name, std::move(*value), element.where});
  }

  /// nullopt for an unknown element that is passed over.
  std::optional<PropertyValue> read_value(const ObjectDescription& parent, const XmlElement& element,
                                          bool within_emitter) {
    if (is_plugin_tag(element.tag)) return object(element, within_emitter);
    if (element.tag == "ref") return referenced(element);
    if (!accepts_tag(element)) return std::nullopt;
    check_attributes(element, is_lenient_, warnings_);
    if (element.tag == "transform") return read_transform_checked(element);
    if (element.tag == "point" || element.tag == "vector") return read_point(element);
    if (element.tag == "rgb" || element.tag == "srgb") return read_colour(element);
    if (element.tag == "spectrum") return read_spectrum(element, within_emitter);
    if (element.tag == "boolean")
      return required_value(element, parse_boolean(required_attribute(element, "value")),
                            "'true' or 'false'");
    if (element.tag == "integer")
      return required_value(element, parse_integer(required_attribute(element, "value")), "an integer");
    if (element.tag == "float")
      return finite(element,
                    required_value(element, parse_number(required_attribute(element, "value")), "a number"));
    if (element.tag == "string") return read_string(parent, element);
    fail(element, "MISPLACED_ELEMENT", "may not stand in " + parent.where.element);
  }

  PropertyValue read_transform_checked(const XmlElement& element) {
    for (const XmlElement& step : element.children) check_attributes(step, is_lenient_, warnings_);
    return read_transform(element);
  }

  static PropertyValue read_point(const XmlElement& element) {
    const Vec3d value = read_vector(element, 0.0);
    if (!is_finite(Vec3f(value))) fail(element, "NOT_FINITE", "the components must be finite");
    return value;
  }

  static PropertyValue read_colour(const XmlElement& element) {
    Vec3d colour = required_value(element, parse_colour(required_attribute(element, "value")),
                                  "one or three numbers or #rrggbb");
    if (element.tag == "srgb")
      for (int channel = 0; channel < 3; ++channel) colour[channel] = srgb_to_linear(colour[channel]);
    return finite(element, Spectrum(colour));
  }

  PropertyValue read_spectrum(const XmlElement& element, bool within_emitter) {
    if (element.find("type")) return read_spectrum_plugin(element, within_emitter);
    if (element.find("filename")) return read_spectrum_file(element, within_emitter);
    const std::string& text = required_attribute(element, "value");
    const auto numbers = parse_numbers(text);
    if (numbers && numbers->size() == 1) {
      const Spectrum flat(static_cast<float>((*numbers)[0]));
      // A flat emission spectrum is equal-energy white, which is not the white of sRGB. Version 0.x in its
      // usual build for RGB rendering took it as grey.
      return finite(element, within_emitter && !element.is_legacy ? flat * equal_energy_white() : flat);
    }
    if (numbers && numbers->size() == 3 && element.is_legacy) {
      warnings_.push_back(element.where.to_string() + ": three values are taken as linear sRGB");
      return finite(element, Spectrum(static_cast<float>((*numbers)[0]), static_cast<float>((*numbers)[1]),
                                      static_cast<float>((*numbers)[2])));
    }
    const auto sampled =
        required_value(element, parse_sampled_spectrum(text), "a number or ascending wavelength:value pairs");
    return spectrum_colour(element, sampled, within_emitter);
  }

  static PropertyValue spectrum_colour(const XmlElement& element, const SampledSpectrum& sampled,
                                       bool within_emitter) {
    for (const double value : sampled.values)
      if (!std::isfinite(value) || value < 0)
        fail(element, "OUT_OF_RANGE", "the spectrum's values must be finite and at least 0");
    return finite(element, within_emitter ? emission_to_srgb(sampled) : reflectance_to_srgb(sampled));
  }

  /// Lines of "wavelength value"; '#' begins a comment.
  PropertyValue read_spectrum_file(const XmlElement& element, bool within_emitter) {
    const FileLocator::Located located =
        locator_.locate(required_attribute(element, "filename"), element.where);
    if (!located.exists) throw FileLocator::not_found(located, element.where);
    const std::string bytes = locator_.read(located.path, element.where);
    std::string pairs;
    size_t begin = 0;
    while (begin < bytes.size()) {
      const size_t end = std::min(bytes.find('\n', begin), bytes.size());
      const std::string_view line = trim(std::string_view(bytes).substr(begin, end - begin));
      begin = end + 1;
      if (line.empty() || line.starts_with('#')) continue;
      const size_t gap = line.find_first_of(" \t");
      if (gap == std::string_view::npos)
        fail(element, "INVALID_VALUE",
             "file " + quote(located.path) + ": line " + quote(line) + " is no pair of numbers");
      pairs += std::string(line.substr(0, gap)) + ":" + std::string(trim(line.substr(gap))) + " ";
    }
    const auto sampled = parse_sampled_spectrum(pairs);
    if (!sampled)
      fail(element, "INVALID_VALUE",
           "file " + quote(located.path) + " must have lines of a wavelength and a value, ascending");
    return spectrum_colour(element, *sampled, within_emitter);
  }

  /// `<spectrum type="uniform|d65|srgb">`.
  PropertyValue read_spectrum_plugin(const XmlElement& element, bool within_emitter) {
    ObjectDescription description;
    description.tag = element.tag;
    description.type = element.get("type");
    description.where = element.where;
    for (const XmlElement& child : element.children) add_property(description, child, within_emitter);
    PropertyReader reader(description);
    constexpr float largest = std::numeric_limits<float>::max();
    Spectrum value(1);
    if (description.type == "uniform") {
      value = Spectrum(static_cast<float>(reader.number("value", 1.0, -largest, largest)));
      if (within_emitter && !element.is_legacy) value *= equal_energy_white();
    } else if (description.type == "d65") {
      value = reader.spectrum("color", Spectrum(1), -largest, largest) *
              static_cast<float>(reader.number("scale", 1.0, -largest, largest));
    } else if (description.type == "srgb") {
      value = reader.spectrum("color", Spectrum(1), -largest, largest);
    } else {
      fail(element, "UNKNOWN_PLUGIN",
           "spectrum " + quote(description.type) + " is not supported; supported: d65, srgb, uniform");
    }
    reader.finish(is_lenient_ ? &warnings_ : nullptr);
    return finite(element, value);
  }

  PropertyValue read_string(const ObjectDescription& parent, const XmlElement& element) {
    const std::string& text = required_attribute(element, "value");
    const bool is_file = element.get("name") == "filename" && parent.tag != "film";
    if (!is_file) return text;
    const FileLocator::Located located = locator_.locate(text, element.where);
    // All missing files are to be noted, so the error waits for the end.
    if (!located.exists && !missing_file_) missing_file_ = FileLocator::not_found(located, element.where);
    return located.path;
  }

  const XmlElement& scene_;
  FileLocator& locator_;
  bool is_lenient_;
  std::vector<std::string>& warnings_;
  std::map<std::string, const XmlElement*> by_id_;
  std::map<const XmlElement*, ObjectPointer> built_;
  std::set<const XmlElement*> open_;
  std::map<const ObjectDescription*, int> depths_;  ///< objects on the longest way down, itself included
  std::optional<SceneError> missing_file_;
};

/// References of the elements below `element`, without building anything.
void locate_files(const XmlElement& element, FileLocator& locator) {
  for (const XmlElement& child : element.children) {
    const std::string* reference = nullptr;
    if (child.tag == "spectrum") reference = child.find("filename");
    if (child.tag == "string" && child.get("name") == "filename" && element.tag != "film")
      reference = child.find("value");
    if (reference && reference->find('$') == std::string::npos) locator.locate(*reference, child.where);
    locate_files(child, locator);
  }
}

}  // namespace

ParsedScene parse_scene(const std::string& main_path, FileSource& files, const LoadOptions& options) {
  const std::string path = resolve_path("", main_path);
  FileLocator locator(files, path);
  SceneExpander expander(locator, options, false);
  const XmlElement scene = expander.expand(path);
  ParsedScene parsed;
  parsed.warnings = std::move(expander.warnings());
  DescriptionBuilder builder(scene, expander.aliases(), locator, options.lenient, parsed.warnings);
  parsed.objects = builder.build();
  return parsed;
}

std::vector<std::string> list_references(const std::string& main_path, std::shared_ptr<FileSource> files,
                                         const LoadOptions& options) {
  const std::string path = resolve_path("", main_path);
  FileLocator locator(*files, path);
  SceneExpander expander(locator, options, true);
  const XmlElement scene = expander.expand(path);
  locate_files(scene, locator);
  return locator.references();
}

}  // namespace fogbank::scene
