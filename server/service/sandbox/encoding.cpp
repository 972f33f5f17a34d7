#include "service/sandbox/encoding.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <type_traits>

#include "scene/image_reader.h"
#include "scene/utf8.h"

namespace fogbank::service {
namespace {

using scene::LoadLimits;
using scene::ObjectDescription;
using scene::ObjectPointer;
using scene::ParsedScene;
using scene::Property;
using scene::PropertyValue;

/// An object's own level counts, and those of what old files leave out are added.
constexpr int most_levels = LoadLimits::depth + 1;
constexpr uint64_t most_triangles = LoadLimits::triangles;

class Encoder {
 public:
  template <typename T>
  void put(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
  }
  void put(std::string_view text) {
    put(static_cast<uint64_t>(text.size()));
    bytes_.append(text);
  }
  void put(const std::string& text) { put(std::string_view(text)); }
  void put(const SourceLocation& where) {
    put(where.file);
    put(where.line);
    put(where.element);
  }
  std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

class Decoder {
 public:
  explicit Decoder(std::string_view bytes) : rest_(bytes) {}

  std::string_view take(uint64_t size) {
    if (size > rest_.size()) throw BadMessage("a message ends too soon");
    const std::string_view taken = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return taken;
  }
  template <typename T>
  T get() {
    T value;
    std::memcpy(static_cast<void*>(&value), take(sizeof(T)).data(), sizeof(T));
    return value;
  }
  bool get_bool() { return get<uint8_t>() != 0; }
  std::string get_text() {
    const std::string_view text = take(get<uint64_t>());
    if (!scene::is_valid_utf8(text)) throw BadMessage("a text is not UTF-8");
    return std::string(text);
  }
  /// Number of elements of at least `smallest` bytes each.
  uint64_t get_count(size_t smallest) {
    const auto count = get<uint64_t>();
    if (count > rest_.size() / smallest) throw BadMessage("a message ends too soon");
    return count;
  }
  SourceLocation get_location() {
    SourceLocation where;
    where.file = get_text();
    where.line = get<int32_t>();
    where.element = get_text();
    return where;
  }
  void finish() const {
    if (!rest_.empty()) throw BadMessage("a message is longer than it says");
  }

 private:
  std::string_view rest_;
};

/// Objects in an order in which each comes after those that it refers to, by number.
class SceneEncoder {
 public:
  std::string encode(const ParsedScene& scene) {
    std::vector<uint64_t> roots;
    for (const ObjectPointer& object : scene.objects) roots.push_back(number_of(object));
    Encoder head;
    head.put(static_cast<uint64_t>(numbers_.size()));
    std::string bytes = head.take() + objects_.take();
    Encoder tail;
    tail.put(static_cast<uint64_t>(roots.size()));
    for (const uint64_t root : roots) tail.put(root);
    tail.put(static_cast<uint64_t>(scene.warnings.size()));
    for (const std::string& warning : scene.warnings) tail.put(warning);
    return bytes + tail.take();
  }

 private:
  uint64_t number_of(const ObjectPointer& object) {
    if (const auto known = numbers_.find(object.get()); known != numbers_.end()) return known->second;
    for (const Property& property : object->properties)
      if (const auto* nested = std::get_if<ObjectPointer>(&property.value)) number_of(*nested);
    objects_.put(object->tag);
    objects_.put(object->type);
    objects_.put(object->id);
    objects_.put(object->where);
    objects_.put(static_cast<uint64_t>(object->properties.size()));
    for (const Property& property : object->properties) {
      objects_.put(property.name);
      objects_.put(property.where);
      objects_.put(static_cast<uint8_t>(property.value.index()));
      std::visit([this](const auto& value) { put(value); }, property.value);
    }
    return numbers_.emplace(object.get(), numbers_.size()).first->second;
  }
  void put(const ObjectPointer& object) { objects_.put(number_of(object)); }
  template <typename T>
  void put(const T& value) {
    objects_.put(value);
  }

  Encoder objects_;
  std::map<const ObjectDescription*, uint64_t> numbers_;
};

class SceneDecoder {
 public:
  explicit SceneDecoder(std::string_view bytes) : decoder_(bytes) {}

  ParsedScene decode() {
    constexpr size_t smallest_object = 5 * sizeof(uint64_t);
    const uint64_t count = decoder_.get_count(smallest_object);
    for (uint64_t i = 0; i < count; ++i) decode_object();
    ParsedScene scene;
    const uint64_t roots = decoder_.get_count(sizeof(uint64_t));
    for (uint64_t i = 0; i < roots; ++i) scene.objects.push_back(earlier_object().object);
    const uint64_t warnings = decoder_.get_count(sizeof(uint64_t));
    for (uint64_t i = 0; i < warnings; ++i) scene.warnings.push_back(decoder_.get_text());
    decoder_.finish();
    return scene;
  }

 private:
  struct Known {
    ObjectPointer object;
    int levels = 1;
  };

  const Known& earlier_object() {
    const auto number = decoder_.get<uint64_t>();
    if (number >= objects_.size()) throw BadMessage("an object that is not there");
    return objects_[number];
  }

  void decode_object() {
    auto object = std::make_shared<ObjectDescription>();
    object->tag = decoder_.get_text();
    object->type = decoder_.get_text();
    object->id = decoder_.get_text();
    object->where = decoder_.get_location();
    constexpr size_t smallest_property = 3 * sizeof(uint64_t);
    const uint64_t count = decoder_.get_count(smallest_property);
    levels_ = 1;
    for (uint64_t i = 0; i < count; ++i) {
      Property property;
      property.name = decoder_.get_text();
      property.where = decoder_.get_location();
      property.value = decode_value();
      object->properties.push_back(std::move(property));
    }
    if (levels_ > most_levels) throw BadMessage("objects are nested too deep");
    objects_.push_back({std::move(object), levels_});
  }

  PropertyValue decode_value() {
    switch (decoder_.get<uint8_t>()) {
      case 0:
        return decoder_.get_bool();
      case 1:
        return decoder_.get<int64_t>();
      case 2:
        return decoder_.get<double>();
      case 3:
        return decoder_.get_text();
      case 4:
        return decoder_.get<Vec3d>();
      case 5:
        return decoder_.get<Spectrum>();
      case 6:
        return decoder_.get<Mat4d>();
      case 7: {
        const Known& nested = earlier_object();
        levels_ = std::max(levels_, nested.levels + 1);
        return nested.object;
      }
      default:
        throw BadMessage("a property of no type");
    }
  }

  Decoder decoder_;
  std::vector<Known> objects_;
  int levels_ = 1;  ///< of the object that is being decoded
};
static_assert(std::is_same_v<std::variant_alternative_t<7, PropertyValue>, ObjectPointer> &&
              std::variant_size_v<PropertyValue> == 8);

}  // namespace

std::string encode(const ParseRequest& request) {
  Encoder encoder;
  encoder.put(request.main_path);
  encoder.put(static_cast<uint64_t>(request.options.parameters.size()));
  for (const auto& [name, value] : request.options.parameters) {
    encoder.put(name);
    encoder.put(value);
  }
  encoder.put(static_cast<uint8_t>(request.options.lenient));
  return encoder.take();
}

ParseRequest decode_parse_request(std::string_view bytes) {
  Decoder decoder(bytes);
  ParseRequest request;
  request.main_path = decoder.get_text();
  const uint64_t parameters = decoder.get_count(2 * sizeof(uint64_t));
  for (uint64_t i = 0; i < parameters; ++i) {
    const std::string name = decoder.get_text();
    request.options.parameters[name] = decoder.get_text();
  }
  request.options.lenient = decoder.get_bool();
  decoder.finish();
  return request;
}

std::string encode(const MeshRequest& request) {
  const scene::MeshReadOptions& options = request.file.options;
  Encoder encoder;
  encoder.put(request.file.type);
  encoder.put(request.file.shape_index);
  encoder.put(options.path);
  encoder.put(static_cast<uint8_t>(options.face_normals));
  encoder.put(static_cast<uint8_t>(options.flip_tex_coords));
  encoder.put(static_cast<uint8_t>(options.max_smooth_angle_degrees.has_value()));
  encoder.put(options.max_smooth_angle_degrees.value_or(0.0));
  encoder.put(request.where);
  return encoder.take();
}

MeshRequest decode_mesh_request(std::string_view bytes) {
  Decoder decoder(bytes);
  MeshRequest request;
  request.file.type = decoder.get_text();
  request.file.shape_index = decoder.get<int64_t>();
  scene::MeshReadOptions& options = request.file.options;
  options.path = decoder.get_text();
  options.face_normals = decoder.get_bool();
  options.flip_tex_coords = decoder.get_bool();
  const bool has_angle = decoder.get_bool();
  const auto angle = decoder.get<double>();
  if (has_angle) options.max_smooth_angle_degrees = angle;
  request.where = decoder.get_location();
  decoder.finish();
  return request;
}

std::string encode(const ImageRequest& request) {
  Encoder encoder;
  encoder.put(request.path);
  encoder.put(static_cast<uint8_t>(request.raw));
  encoder.put(request.where);
  return encoder.take();
}

ImageRequest decode_image_request(std::string_view bytes) {
  Decoder decoder(bytes);
  ImageRequest request;
  request.path = decoder.get_text();
  request.raw = decoder.get_bool();
  request.where = decoder.get_location();
  decoder.finish();
  return request;
}

std::string encode(const ParsedScene& scene) { return SceneEncoder().encode(scene); }
ParsedScene decode_scene(std::string_view bytes) { return SceneDecoder(bytes).decode(); }

std::string encode(const std::vector<std::string>& texts) {
  Encoder encoder;
  encoder.put(static_cast<uint64_t>(texts.size()));
  for (const std::string& text : texts) encoder.put(text);
  return encoder.take();
}

std::vector<std::string> decode_texts(std::string_view bytes) {
  Decoder decoder(bytes);
  std::vector<std::string> texts(decoder.get_count(sizeof(uint64_t)));
  for (std::string& text : texts) text = decoder.get_text();
  decoder.finish();
  return texts;
}

std::string encode(const Error& error) {
  Encoder encoder;
  encoder.put(static_cast<uint8_t>(error.kind()));
  encoder.put(error.reason());
  const auto* in_scene = dynamic_cast<const SceneError*>(&error);
  encoder.put(static_cast<uint8_t>(in_scene != nullptr));
  const SourceLocation where = in_scene != nullptr ? in_scene->where() : SourceLocation{};
  encoder.put(where);
  std::string message = error.what();
  if (in_scene != nullptr) message.erase(0, where.to_string().size() + 2);  // ": "
  encoder.put(message);
  return encoder.take();
}

void throw_decoded_error(std::string_view bytes) {
  Decoder decoder(bytes);
  const auto kind = static_cast<ErrorKind>(decoder.get<uint8_t>());
  const std::string reason = decoder.get_text();
  const bool in_scene = decoder.get_bool();
  const SourceLocation where = decoder.get_location();
  // May quote any bytes of a file; whoever shows it makes it presentable.
  const std::string message(decoder.take(decoder.get<uint64_t>()));
  decoder.finish();
  if (kind > ErrorKind::internal) throw BadMessage("an error of no kind");
  if (in_scene) throw SceneError(kind, reason, where, message);
  throw Error(kind, reason, message);
}

uint64_t MeshHeader::bytes() const {
  return (positions + normals) * sizeof(Vec3f) + uvs * sizeof(Vec2f) + triangles * sizeof(Vec3u);
}

MeshHeader header_of(const scene::Mesh& mesh) {
  return {mesh.positions.size(), mesh.normals.size(),    mesh.uvs.size(),
          mesh.triangles.size(), mesh.dropped_triangles, uint64_t{mesh.faceted}};
}

void check(const MeshHeader& header) {
  const auto fits = [&](uint64_t count) { return count == 0 || count == header.positions; };
  if (header.triangles == 0 || header.triangles > most_triangles || header.positions == 0 ||
      header.positions > UINT32_MAX || !fits(header.normals) || !fits(header.uvs) ||
      header.dropped_triangles > most_triangles || header.faceted > 1)
    throw BadMessage("a mesh contradicts itself");
}

void check(const scene::Mesh& mesh) {
  const auto vertices = static_cast<uint32_t>(mesh.positions.size());
  bool holds = true;
  for (const Vec3u& triangle : mesh.triangles)
    holds &= triangle.x < vertices && triangle.y < vertices && triangle.z < vertices;
  for (const Vec3f& position : mesh.positions) holds &= is_finite(position);
  for (const Vec3f& normal : mesh.normals) holds &= is_finite(normal);
  for (const Vec2f& uv : mesh.uvs) holds &= std::isfinite(uv.x) && std::isfinite(uv.y);
  if (!holds) throw BadMessage("a mesh has indices out of range or numbers that are not finite");
}

uint64_t ImageHeader::values() const {
  return static_cast<uint64_t>(width) * static_cast<uint64_t>(height) * static_cast<uint64_t>(channels);
}

ImageHeader header_of(const scene::Image& image) {
  return {image.width, image.height, image.channels, uint32_t{!image.bytes.empty()}};
}

void check(const ImageHeader& header) {
  if (header.width < 1 || header.height < 1 || header.width > LoadLimits::image_side ||
      header.height > LoadLimits::image_side || (header.channels != 1 && header.channels != 3) ||
      header.is_bytes > 1 ||
      header.values() * (header.is_bytes != 0 ? 1 : sizeof(float)) > LoadLimits::image_bytes)
    throw BadMessage("an image contradicts itself");
}

void complete(scene::Image& image, bool raw) {
  if (!image.bytes.empty()) {
    image.decode = scene::byte_decoding(raw);
    const auto [lowest, highest] = std::minmax_element(image.bytes.begin(), image.bytes.end());
    image.lowest = (*image.decode)[*lowest];
    image.highest = (*image.decode)[*highest];
    return;
  }
  bool finite = true;
  image.lowest = image.highest = image.data.front();
  for (const float value : image.data) {
    finite &= std::isfinite(value);
    image.lowest = std::min(image.lowest, value);
    image.highest = std::max(image.highest, value);
  }
  if (!finite) throw BadMessage("an image has texels that are not finite");
}

}  // namespace fogbank::service
