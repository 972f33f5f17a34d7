// What cached light is a function of.
#pragma once

#include <string>
#include <vector>

#include "core/vector.h"

namespace fogbank::scene {

/// Light is linear in emission, so how bright emitters are stands apart from everything else.
struct FieldIdentity {
  /// SHA-256, as 64 lower-case hexadecimal digits, over all that the transport of light depends on: shapes,
  /// media, BSDFs, emitters but for their scale, files by content, and the order that indices follow.
  std::string transport;
  /// Scale of the emission of each of Scene::emitters, >= 0: its radiance, irradiance or intensity; of what
  /// an image describes the factor before it.
  std::vector<Spectrum> emission;
};

}  // namespace fogbank::scene
