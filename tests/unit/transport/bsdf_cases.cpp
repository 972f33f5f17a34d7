#include "transport/bsdf_cases.h"

#include <fstream>
#include <stdexcept>

#include "scene/scene_file_reader.h"

namespace fogbank::test {

namespace {

/// The pictures of the table, from memory.
class TableFiles final : public scene::FileSource {
 public:
  bool exists(const std::string& path) const override { return bsdf_vectors()["files"].contains(path); }
  std::string read(const std::string& path) const override {
    return decode(bsdf_vectors()["files"].at(path).get<std::string>());
  }

 private:
  static std::string decode(const std::string& base64) {
    const std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string bytes;
    uint32_t bits = 0;
    int count = 0;
    for (const char c : base64) {
      const size_t value = alphabet.find(c);
      if (value == std::string::npos) break;
      bits = (bits << 6) | static_cast<uint32_t>(value);
      count += 6;
      if (count >= 8) {
        count -= 8;
        bytes.push_back(static_cast<char>((bits >> count) & 0xFFu));
      }
    }
    return bytes;
  }
};

SourceLocation location(const std::string& element) { return {"table.xml", 1, element}; }

scene::PropertyValue value_of(const nlohmann::json& value) {
  if (value.is_boolean()) return value.get<bool>();
  if (value.is_number()) return value.get<double>();
  if (value.is_array()) return Spectrum(value[0].get<float>(), value[1].get<float>(), value[2].get<float>());
  auto text = value.get<std::string>();
  if (!text.ends_with(".png")) return text;
  auto texture = std::make_shared<scene::ObjectDescription>();
  texture->tag = "texture";
  texture->type = "bitmap";
  texture->where = location("<texture type=\"bitmap\">");
  texture->properties.push_back({"filename", text, texture->where});
  texture->properties.push_back({"raw", true, texture->where});
  return scene::ObjectPointer(texture);
}

}  // namespace

const nlohmann::json& bsdf_vectors() {
  static const nlohmann::json table = [] {
    const char* path = "tests/unit/transport/bsdf_vectors.json";
    std::ifstream file(path);
    if (!file)
      throw std::runtime_error(std::string("can't read ") + path + "; run from the repository's root");
    return nlohmann::json::parse(file);
  }();
  return table;
}

scene::ObjectPointer describe_bsdf(const nlohmann::json& description) {
  auto object = std::make_shared<scene::ObjectDescription>();
  object->tag = "bsdf";
  object->type = description.at("type").get<std::string>();
  object->where = location("<bsdf type=\"" + object->type + "\">");
  if (description.contains("parameters"))
    for (const auto& [name, value] : description.at("parameters").items())
      object->properties.push_back({name, value_of(value), object->where});
  if (description.contains("nested"))
    for (const nlohmann::json& nested : description.at("nested"))
      object->properties.push_back({"", describe_bsdf(nested), object->where});
  return object;
}

BsdfWorkshop::BsdfWorkshop(bool lenient)
    : textures_(scene::read_in_process(std::make_shared<TableFiles>())),
      builder_(textures_, lenient, warnings_) {}

transport::BsdfPointer BsdfWorkshop::build(const nlohmann::json& description) {
  return builder_.build(describe_bsdf(description));
}

transport::ShadingPoint table_point() {
  const nlohmann::json& table = bsdf_vectors();
  const auto vector = [&](const char* name) {
    const auto values = table.at(name).get<std::vector<float>>();
    return Vec3f(values[0], values[1], values[2]);
  };
  transport::ShadingPoint point;
  point.dp_du = vector("dp_du");
  point.dp_dv = vector("dp_dv");
  const auto uv = table.at("uv").get<std::vector<float>>();
  point.uv = {uv[0], uv[1]};
  return point;
}

std::vector<std::pair<std::string, nlohmann::json>> all_bsdf_descriptions() {
  std::vector<std::pair<std::string, nlohmann::json>> all;
  for (const nlohmann::json& entry : bsdf_vectors()["cases"])
    all.emplace_back(entry["name"].get<std::string>(), entry["bsdf"]);
  for (const char* type : {"roughconductor", "roughdielectric", "roughplastic"})
    for (const char* distribution : {"beckmann", "ggx"})
      for (const double alpha : {0.05, 1.0})
        all.emplace_back(std::string(type) + "_" + distribution + (alpha < 0.5 ? "_sharp" : "_rough"),
                         nlohmann::json{{"type", type},
                                        {"parameters", {{"alpha", alpha}, {"distribution", distribution}}}});
  return all;
}

}  // namespace fogbank::test
