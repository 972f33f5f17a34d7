// BSDFs for tests, built from the descriptions in bsdf_vectors.json.
#pragma once

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "scene/texture_library.h"
#include "transport/bsdf.h"

namespace fogbank::test {

/// The table that make_bsdf_vectors.py wrote.
const nlohmann::json& bsdf_vectors();

/// `{"type": ..., "parameters": {name: value}, "nested": [...]}` as the loader would describe it: numbers
/// become
/// `<float>`, triples `<rgb>`, names of the table's pictures `<texture type="bitmap">`.
scene::ObjectPointer describe_bsdf(const nlohmann::json& description);

/// Builds what `describe_bsdf` describes; owns what the BSDFs need.
class BsdfWorkshop {
 public:
  explicit BsdfWorkshop(bool lenient = false);
  transport::BsdfPointer build(const nlohmann::json& description);
  transport::BsdfPointer build(const scene::ObjectPointer& description) {
    return builder_.build(description);
  }
  const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  std::vector<std::string> warnings_;
  scene::TextureLibrary textures_;
  transport::BsdfBuilder builder_;
};

/// The surface point of the table: skewed parametrisation, axis-aligned frame.
transport::ShadingPoint table_point();

/// All BSDFs of the table that aren't made of Dirac lobes only, by name, plus sharp and rough extremes.
std::vector<std::pair<std::string, nlohmann::json>> all_bsdf_descriptions();

}  // namespace fogbank::test
