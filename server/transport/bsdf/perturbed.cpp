#include "transport/bsdf/perturbed.h"

#include "transport/bsdf/parameters.h"

namespace fogbank::transport {

namespace {

/// The point as the nested BSDF sees it: with the tilted frame in world space.
ShadingPoint tilted_point(const ShadingPoint& point, const Frame& tilted) {
  ShadingPoint result = point;
  result.frame = {point.frame.to_world(tilted.tangent), point.frame.to_world(tilted.bitangent),
                  point.frame.to_world(tilted.normal)};
  return result;
}

float tangent_squared(const Vec3f& w) { return (w.x * w.x + w.y * w.y) / (w.z * w.z); }

}  // namespace

PerturbedBsdf::PerturbedBsdf(scene::PropertyReader& reader, BsdfBuilder& builder)
    : nested_(read_nested(reader, builder, 1, 1).front()),
      flip_invalid_normals_(reader.boolean("flip_invalid_normals", true)),
      use_shadowing_function_(reader.boolean("use_shadowing_function", true)) {}

Frame PerturbedBsdf::tilted_frame(const ShadingPoint& point, const Vec3f& wo) const {
  Vec3f n = normal(point);
  const float length = glm::length(n);
  if (!(length > 0.0f) || !std::isfinite(length)) return {};
  n /= length;
  if (flip_invalid_normals_ && wo.z * glm::dot(wo, n) <= 0.0f) n = {-n.x, -n.y, n.z};
  return Frame::from_normal_and_tangent(n, {1, 0, 0});
}

float PerturbedBsdf::shadowing(const Vec3f& normal, const Vec3f& wi) const {
  if (!use_shadowing_function_ || (normal.x == 0.0f && normal.y == 0.0f)) return 1.0f;
  const float alpha_squared = std::fmin(1.0f, 0.125f * tangent_squared(normal));
  return 2.0f / (1.0f + std::sqrt(1.0f + alpha_squared * tangent_squared(wi)));
}

BsdfValue PerturbedBsdf::evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo,
                                           const Vec3f& wi) const {
  const Frame tilted = tilted_frame(point, wo);
  const Vec3f nested_wi = tilted.to_local(wi);
  // On different sides of the two surfaces light would leak through.
  if (!(wi.z * nested_wi.z > 0.0f)) return {};
  BsdfValue value = nested_->evaluate_with_pdf(tilted_point(point, tilted), tilted.to_local(wo), nested_wi);
  value.value *= shadowing(tilted.normal, wi);
  return value;
}

std::optional<BsdfSample> PerturbedBsdf::sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                                const Vec2f& direction) const {
  const Frame tilted = tilted_frame(point, wo);
  std::optional<BsdfSample> sample =
      nested_->sample(tilted_point(point, tilted), tilted.to_local(wo), lobe, direction);
  if (!sample) return sample;
  if (sample->null) {  // goes straight on whatever the normal; rounding must not bend it
    sample->wi = -wo;
    return sample;
  }
  const Vec3f wi = tilted.to_world(sample->wi);
  if (!(wi.z * sample->wi.z > 0.0f)) return std::nullopt;
  sample->wi = wi;
  sample->weight *= shadowing(tilted.normal, wi);
  return sample;
}

Spectrum PerturbedBsdf::null_transmission(const ShadingPoint& point, const Vec3f& wo) const {
  const Frame tilted = tilted_frame(point, wo);
  return nested_->null_transmission(tilted_point(point, tilted), tilted.to_local(wo));
}

}  // namespace fogbank::transport
